// Formats numbers and metrics.

const NOTHING = "–";
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

export function percent(count, total) {
  return total ? `${Math.round((100 * count) / total)} %` : NOTHING;
}

export function kindOf(step) {
  return step.action ? String(step.action.action) : "none";
}
