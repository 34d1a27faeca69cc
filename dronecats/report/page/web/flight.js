// The state of a flight at a time: newest decisions, poses, target.

export class Flight {
  constructor(episode, data) {
    this.episode = episode;
    this.rendered = episode.rendered;
    Object.assign(this, data);
    // a moment is a step with its picture's time; a joint step of a fleet has several decisions
    const moments = new Map();
    data.steps.forEach((step, place) => {
      if (!moments.has(step.step)) moments.set(step.step, { step: step.step, t: step.t, drone: step.drone, places: [] });
      moments.get(step.step).places.push(place);
    });
    this.moments = [...moments.values()].sort((a, b) => a.t - b.t || a.step - b.step);
  }

  text(number) {
    return number === undefined ? null : this.texts[number];
  }

  prompt(step) {
    return step.parts ? step.parts.map((part) => this.texts[part]).join(this.texts[step.history]) : null;
  }

  momentOf(step) {
    return Math.max(0, this.moments.findIndex((moment) => moment.step === step));
  }

  momentAt(t) {
    let index = 0;
    while (index + 1 < this.moments.length && this.moments[index + 1].t <= t + 1e-9) index += 1;
    return index;
  }

  // the newest decision of each drone up to a moment, or its first
  newest(moment) {
    const shown = new Array(this.drones).fill(null);
    for (const { places } of this.moments.slice(0, moment + 1)) {
      for (const place of places) shown[this.steps[place].drone] = this.steps[place];
    }
    return shown.map((step, drone) => step || this.steps.find((candidate) => candidate.drone === drone) || null);
  }

  pose(drone, t) {
    const trace = this.traces.find((candidate) => candidate.drone === drone);
    if (!trace || !trace.t.length) return null;
    const [i, j, u] = between(trace.t, t);
    return {
      north: mix(trace.north[i], trace.north[j], u),
      east: mix(trace.east[i], trace.east[j], u),
      height: mix(trace.height[i], trace.height[j], u),
      distance: mix(trace.distance[i], trace.distance[j], u),
      yaw: turned(trace.yaw[i], trace.yaw[j], u),
    };
  }

  target(t) {
    if (!this.path) return null;
    const [i, j, u] = between(this.path.t, t);
    return { north: mix(this.path.north[i], this.path.north[j], u), east: mix(this.path.east[i], this.path.east[j], u) };
  }

  // the place of a go's point at its depth, from above
  aim(step) {
    const { action, truth } = step;
    if (!action || action.action !== "go" || !truth || truth.yaw === undefined || truth.north === undefined) return null;
    const right = (action.point[0] / 500 - 1) * Math.tan((this.hfov * Math.PI) / 360) * action.depth_m;
    const yaw = (truth.yaw * Math.PI) / 180;
    return {
      north: truth.north + action.depth_m * Math.cos(yaw) - right * Math.sin(yaw),
      east: truth.east + action.depth_m * Math.sin(yaw) + right * Math.cos(yaw),
    };
  }
}

function between(times, t) {
  let low = 0;
  let high = times.length - 1;
  if (t <= times[0]) return [0, 0, 0];
  if (t >= times[high]) return [high, high, 0];
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (times[middle] <= t) low = middle;
    else high = middle;
  }
  return [low, high, (t - times[low]) / (times[high] - times[low])];
}

function mix(a, b, u) {
  return a === null || b === null || a === undefined || b === undefined ? null : a + (b - a) * u;
}

function turned(a, b, u) {
  if (a === null || b === null || a === undefined || b === undefined) return null;
  return a + ((((b - a) % 360) + 540) % 360 - 180) * u;
}
