// The timeline: a slider below the distance to the target, with a mark for every step.

import { drawn, el } from "./dom.js";
import { kindOf, measured, number } from "./words.js";

const WIDE = 1000;
const HIGH = 100;
const KINDS = ["none", "think", "rotate", "go", "finished", "bad", "good"];

export class Timeline {
  // move(t): called with a chosen time
  constructor(sides, move) {
    this.sides = sides;
    this.end = Math.max(1, ...sides.map(({ flight }) => flight.end));
    const farthest = Math.max(10, ...sides.flatMap(({ flight }) => flight.traces.flatMap((trace) => trace.distance.map((m) => m ?? 0))));
    this.top = Math.ceil(farthest / 10) * 10;
    this.cursor = drawn("line", { class: "cursor", y1: 0, y2: HIGH });
    this.input = el("input", {
      type: "range", id: "time", min: 0, max: this.end.toFixed(1), step: 0.1, "aria-label": "Time of the flight",
      oninput: () => move(Number(this.input.value)),
    });
    const chart = drawn(
      "svg",
      { class: "chart", viewBox: `0 0 ${WIDE} ${HIGH}`, preserveAspectRatio: "none", "aria-hidden": "true" },
      ...this.lines(),
      this.cursor,
    );
    chart.addEventListener("click", (event) => {
      const box = chart.getBoundingClientRect();
      move(((event.clientX - box.left) / box.width) * this.end);
    });
    this.caption = el("p", { class: "judges" }, "Distance to the target", el("span", { class: "tag" }, "the judge’s: the model never saw it"));
    this.element = el(
      "div",
      { class: "timeline" },
      el("div", { class: "scaled" }, chart, el("span", { class: "axis top" }, `${this.top} m`), el("span", { class: "axis low" }, "0")),
      sides.map(({ flight, side }) => this.marks(flight, side, move)),
      this.input,
      el("p", { class: "times" }, el("span", {}, "0 s"), el("span", {}, `${number(this.end, 0)} s`)),
    );
  }

  lines() {
    const { delta } = this.sides[0].flight;
    const level = HIGH * (1 - delta / this.top);
    const marks = [drawn("line", { class: "delta", x1: 0, x2: WIDE, y1: level, y2: level })];
    for (const { flight, side } of this.sides) {
      for (const trace of flight.traces) {
        const points = trace.t.map((t, i) => (trace.distance[i] === null ? null : `${((WIDE * t) / this.end).toFixed(1)},${(HIGH * (1 - trace.distance[i] / this.top)).toFixed(1)}`));
        const colour = side ? `side-${side}` : `d${trace.drone % 8}`;
        marks.push(drawn("polyline", { class: `curve ${colour}`, points: points.filter(Boolean).join(" ") }));
      }
    }
    return marks;
  }

  marks(flight, side, move) {
    const ticks = drawn("svg", { class: "ticks", viewBox: `0 0 ${WIDE} 10`, preserveAspectRatio: "none", "aria-hidden": "true" });
    const ticked = flight.steps.map((step) => {
      const good = step.truth ? step.truth.qualifies : undefined;
      return [step, good === undefined ? kindOf(step) : good ? "good" : "bad"];
    });
    // of simultaneous decisions of a fleet, the more important is on top
    ticked.sort((a, b) => KINDS.indexOf(a[1]) - KINDS.indexOf(b[1]));
    for (const [step, kind] of ticked) {
      const tick = drawn("line", { class: `tick ${kind}`, x1: (WIDE * step.t) / this.end, x2: (WIDE * step.t) / this.end, y1: 0, y2: 10 });
      tick.append(drawn("title", {}, `Step ${step.step}: ${step.does}`));
      tick.addEventListener("click", () => move(step.t));
      ticks.append(tick);
    }
    return el("div", { class: "ticked" }, side ? el("b", { class: `side ${side}` }, side.toUpperCase()) : null, ticks);
  }

  show(t, step) {
    const x = (WIDE * t) / this.end;
    this.cursor.setAttribute("x1", x);
    this.cursor.setAttribute("x2", x);
    this.input.value = t;
    this.input.setAttribute("aria-valuetext", `${measured(t, "s")}, step ${step}`);
  }
}
