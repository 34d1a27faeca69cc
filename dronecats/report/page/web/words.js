// Numbers and outcomes as people read them.

const NOTHING = "–";
const OUTCOMES = {
  success: ["✓", "success"],
  failure: ["✕", "failure"],
  error: ["!", "error"],
  damaged: ["!", "damaged"],
  censored: ["?", "censored"],
  unknown: ["?", "unknown"],
  "distance only": ["?", "distance only"],
};
const MINUS = "\u2212";

export function number(value, digits = 1) {
  if (value === null || value === undefined) return NOTHING;
  return value.toFixed(digits).replace("-", MINUS);
}

export function measured(value, unit, digits = 1) {
  return value === null || value === undefined ? NOTHING : `${number(value, digits)} ${unit}`;
}

export function metricText(metric, value) {
  if (value === null || value === undefined) return NOTHING;
  if (typeof value === "boolean") return value ? "yes" : "no";
  if (metric.unit === "share") return number(value, 2);
  if (metric.unit === "count") return number(value, 0);
  const digits = Math.abs(value) < 10 ? 2 : 1;
  return metric.unit && metric.unit !== "ratio" ? `${number(value, digits)} ${metric.unit}` : number(value, digits);
}

export function outcomeWords(outcome) {
  return OUTCOMES[outcome] || ["?", outcome];
}

export function scored(episode) {
  return episode.counted;
}

export function percent(part, whole) {
  return whole ? `${Math.round((100 * part) / whole)} %` : NOTHING;
}

export function actionWords(step) {
  const action = step.action;
  if (!action) return "no action";
  if (action.action === "go" && Array.isArray(action.point)) {
    return `go (${number(action.point[0], 0)}, ${number(action.point[1], 0)}) ${number(action.depth_m, 1)} m`;
  }
  if (action.action === "rotate") {
    const side = action.angle_deg < 0 ? "left" : "right";
    return `rotate ${number(Math.abs(action.angle_deg), 0)}° ${side}`;
  }
  if (action.action === "finished") return step.report ? "finished (report)" : "finished";
  return String(action.action);
}

export function kindOf(step) {
  return step.action ? String(step.action.action) : "none";
}
