// The map from above: traces, target, fields of view, the radius around the target. North is up; metres.

import { drawn, el } from "./dom.js";
import { number } from "./words.js";

const MARGIN_M = 8;
const SMALLEST_M = 24;
const SHAPE = 4 / 3; // width / height
const SIGHT_M = 14; // how far the field of view is drawn
const ZOOMS = [1, 2, 4, 8];
const LENGTHS_M = [100, 50, 20, 10, 5, 2, 1];

export class Plan {
  // sides: [{flight, side}], of one episode; ground: the picture of its map, or nothing
  constructor(sides, ground) {
    this.sides = sides;
    this.ground = ground;
    this.zoom = 0;
    this.svg = drawn("svg", { class: "plan", role: "img", preserveAspectRatio: "xMidYMid meet" });
    const button = (name, words, by) =>
      el("button", { type: "button", class: "tool", title: words, "aria-label": words, onclick: () => this.zoomed(by) }, name);
    this.element = el(
      "div",
      { class: "ground" },
      this.svg,
      el("div", { class: "zoom" }, button("+", "Nearer", 1), button("−", "Farther", -1)),
      legend(sides),
    );
    this.bounds = bounds(sides);
  }

  zoomed(by) {
    this.zoom = Math.min(ZOOMS.length - 1, Math.max(0, this.zoom + by));
    this.show(this.t, this.newest);
  }

  show(t, newest) {
    this.t = t;
    this.newest = newest;
    const frame = this.frame(t);
    const [west, top, wide, high] = frame;
    this.u = wide / 100; // m: a hundredth of the picture
    this.svg.setAttribute("viewBox", frame.map((x) => x.toFixed(2)).join(" "));
    this.svg.setAttribute("aria-label", this.description(t));
    this.svg.replaceChildren(
      ...this.floor(west, top, wide, high),
      ...this.sides.flatMap((side) => this.paths(side, t)),
      ...this.goal(t),
      ...this.sides.flatMap((side, place) => this.drones(side, place, t)),
      ...this.scale(west, top, wide, high),
    );
  }

  frame(t) {
    const { west, south, wide, high } = this.bounds;
    const k = ZOOMS[this.zoom];
    const at = k > 1 ? this.sides[0].flight.pose(0, t) : null;
    const east = at ? at.east : west + wide / 2;
    const north = at ? at.north : south + high / 2;
    return [east - wide / k / 2, -north - high / k / 2, wide / k, high / k];
  }

  floor(west, top, wide, high) {
    const { ground } = this;
    if (ground) {
      const { north, east, half, picture } = ground;
      return [drawn("image", { class: "map", href: picture, x: east - half, y: -north - half, width: 2 * half, height: 2 * half })];
    }
    const lines = [];
    const step = 10;
    for (let x = Math.ceil(west / step) * step; x < west + wide; x += step) {
      lines.push(drawn("line", { class: "grid", x1: x, x2: x, y1: top, y2: top + high }));
    }
    for (let y = Math.ceil(top / step) * step; y < top + high; y += step) {
      lines.push(drawn("line", { class: "grid", x1: west, x2: west + wide, y1: y, y2: y }));
    }
    return lines;
  }

  paths({ flight, side }, t) {
    const marks = [];
    for (const trace of flight.traces) {
      const points = trace.east.map((east, i) => `${east},${-trace.north[i]}`);
      const past = points.filter((_, i) => trace.t[i] <= t);
      const now = flight.pose(trace.drone, t);
      past.push(`${now.east},${-now.north}`);
      const colour = colourOf(side, trace.drone);
      const dashes = side === "b" ? " dashed" : "";
      marks.push(
        drawn("polyline", { class: `trace all ${colour}`, points: points.join(" ") }),
        drawn("polyline", { class: "trace edge", points: past.join(" ") }),
        drawn("polyline", { class: `trace ${colour}${dashes}`, points: past.join(" ") }),
        drawn("circle", { class: `start ${colour}`, cx: trace.east[0], cy: -trace.north[0], r: this.u }),
      );
    }
    for (const step of flight.steps) {
      const { truth } = step;
      if (!truth || truth.qualifies === undefined || truth.north === undefined || step.decided > t + 0.05) continue;
      marks.push(this.declared(truth.east, -truth.north, truth.qualifies));
    }
    return marks;
  }

  declared(x, y, good) {
    const u = this.u * 1.3;
    const path = good
      ? `M${x - u},${y} L${x - u / 3},${y + u * 0.8} L${x + u},${y - u}`
      : `M${x - u},${y - u} L${x + u},${y + u} M${x - u},${y + u} L${x + u},${y - u}`;
    return drawn("g", {}, drawn("path", { class: "declared edge", d: path }), drawn("path", { class: good ? "declared good" : "declared bad", d: path }));
  }

  goal(t) {
    const { flight } = this.sides[0];
    const u = this.u;
    const marks = flight.candidates.map(({ name, north, east }) =>
      drawn("g", { class: "alike" }, drawn("path", { d: diamond(east, -north, u) }), drawn("title", {}, `Look-alike: ${name}`)),
    );
    const at = flight.target(t);
    if (!at) return marks;
    const { north, east } = flight.path;
    if (north.length > 1) {
      marks.push(drawn("polyline", { class: "path", points: east.map((x, i) => `${x},${-north[i]}`).join(" ") }));
    }
    marks.push(
      drawn("circle", { class: "radius edge", cx: at.east, cy: -at.north, r: flight.delta }),
      drawn("circle", { class: "radius", cx: at.east, cy: -at.north, r: flight.delta }),
      drawn("g", { class: "target" }, drawn("path", { d: diamond(at.east, -at.north, u * 1.1) }), drawn("title", {}, `Target: ${flight.named}`)),
    );
    return marks;
  }

  drones({ flight, side }, place, t) {
    const u = this.u;
    const marks = [];
    for (let drone = 0; drone < flight.drones; drone += 1) {
      const pose = flight.pose(drone, t);
      if (!pose) continue;
      const colour = colourOf(side, drone);
      const x = pose.east;
      const y = -pose.north;
      if (pose.yaw !== null) marks.push(drawn("path", { class: `sight ${colour}`, d: wedge(x, y, pose.yaw, flight.hfov) }));
      const step = this.newest[place][drone];
      const aim = step && step.t <= t + 1e-6 ? flight.aim(step) : null;
      if (aim) {
        const cross = `M${aim.east - u},${-aim.north} h${2 * u} M${aim.east},${-aim.north - u} v${2 * u}`;
        marks.push(
          drawn("line", { class: `aim ${colour}`, x1: x, y1: y, x2: aim.east, y2: -aim.north }),
          drawn("path", { class: `cross ${colour}`, d: cross }),
        );
      }
      marks.push(drawn("path", { class: `drone ${colour}`, d: arrow(x, y, pose.yaw ?? 0, u * 1.8) }));
    }
    return marks;
  }

  scale(west, top, wide, high) {
    const u = this.u;
    const length = LENGTHS_M.find((candidate) => candidate <= wide * 0.3) || 1;
    const x = west + 2 * u;
    const y = top + high - 2.4 * u;
    const north = west + wide - 3.5 * u;
    return [
      drawn("path", { class: "scale edge", d: `M${x},${y - u} v${u} h${length} v${-u}` }),
      drawn("path", { class: "scale", d: `M${x},${y - u} v${u} h${length} v${-u}` }),
      drawn("text", { class: "label", x: x + length / 2, y: y - u * 0.8, "font-size": 3 * u, "text-anchor": "middle" }, `${length} m`),
      drawn("text", { class: "label", x: north, y: top + high - 2.4 * u, "font-size": 3.4 * u, "text-anchor": "middle" }, "N ↑"),
    ];
  }

  description(t) {
    const words = this.sides.map(({ flight, side }) => {
      const away = flight.traces.map((trace) => flight.pose(trace.drone, t).distance);
      const list = away.map((m, drone) => `drone ${drone + 1} is ${m === null ? "an unknown way" : `${number(m, 1)} m`} from the target`);
      return `${side ? `${side.toUpperCase()}: ` : ""}${list.join(", ")}`;
    });
    return `Map from above at ${number(t, 1)} s. ${words.join(". ")}.`;
  }
}

function colourOf(side, drone) {
  return side ? `side-${side}` : `d${drone % 8}`;
}

function legend(sides) {
  const { flight } = sides[0];
  const entries = sides[0].side
    ? sides.map(({ side, title }) => el("li", {}, el("i", { class: `line side-${side}` }), `${side.toUpperCase()}: ${title}`))
    : flight.traces.map(({ drone }) => el("li", {}, el("i", { class: `line d${drone % 8}` }), flight.drones > 1 ? `drone ${drone + 1}` : "trace"));
  const sign = (mark, words, tone) => el("li", {}, el("i", { class: `sign ${tone}` }, mark), words);
  return el("ul", { class: "legend" }, [
    ...entries,
    flight.path ? sign("◆", `target, ${flight.delta} m around it`, "pink") : null,
    flight.candidates.length ? sign("◇", "look-alikes", "pink") : null,
    sign("+", "where its point and depth lie", ""),
    sign("✓", "declared in reach", "good"),
    sign("✕", "declared in vain", "bad"),
  ]);
}

function bounds(sides) {
  const norths = [];
  const easts = [];
  for (const { flight } of sides) {
    for (const trace of flight.traces) {
      norths.push(...trace.north);
      easts.push(...trace.east);
    }
    if (flight.path) {
      norths.push(...flight.path.north);
      easts.push(...flight.path.east);
    }
    for (const lookAlike of flight.candidates) {
      norths.push(lookAlike.north);
      easts.push(lookAlike.east);
    }
  }
  if (!norths.length) return { west: -20, south: -15, wide: 40, high: 30 };
  const [south, north] = [Math.min(...norths), Math.max(...norths)];
  const [west, east] = [Math.min(...easts), Math.max(...easts)];
  const high = Math.max(north - south + 2 * MARGIN_M, (east - west + 2 * MARGIN_M) / SHAPE, SMALLEST_M);
  const wide = high * SHAPE;
  return { west: (west + east - wide) / 2, south: (south + north - high) / 2, wide, high };
}

function diamond(x, y, r) {
  return `M${x},${y - r} L${x + r},${y} L${x},${y + r} L${x - r},${y} Z`;
}

function wedge(x, y, yaw, hfov) {
  const ends = [-1, 1].map((side) => {
    const angle = ((yaw + (side * hfov) / 2) * Math.PI) / 180;
    return [x + SIGHT_M * Math.sin(angle), y - SIGHT_M * Math.cos(angle)];
  });
  return `M${x},${y} L${ends[0]} A${SIGHT_M},${SIGHT_M} 0 0 1 ${ends[1]} Z`;
}

function arrow(x, y, yaw, r) {
  const at = (angle, far) => {
    const turned = ((yaw + angle) * Math.PI) / 180;
    return `${x + far * Math.sin(turned)},${y - far * Math.cos(turned)}`;
  };
  return `M${at(0, r)} L${at(140, r * 0.85)} L${at(180, r * 0.35)} L${at(220, r * 0.85)} Z`;
}
