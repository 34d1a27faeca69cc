// The address of a view: "", #of/ENTRANT[/CELL], #RUN/EPISODE[/STEP[/OTHER RUN]].

export function parsed(hash) {
  const parts = hash.replace(/^#/, "").split("/").map(decoded).filter((part) => part !== "");
  if (!parts.length) return { view: "report" };
  if (parts[0] === "of") return { view: "entrant", entrant: parts[1] || "", cell: parts[2] || "" };
  const step = /^\d+$/.test(parts[2] || "") ? Number(parts[2]) : null;
  return { view: "flight", run: parts[0], episode: parts[1] || "", step, other: parts[3] || "" };
}

export function toEntrant(entrant, cell = "") {
  return `#${["of", entrant, cell].filter(Boolean).map(encodeURIComponent).join("/")}`;
}

export function toFlight(run, episode, step = null, other = "") {
  const parts = [run, episode];
  if (step !== null || other) parts.push(String(step ?? 0));
  if (other) parts.push(other);
  return `#${parts.map(encodeURIComponent).join("/")}`;
}

function decoded(part) {
  try {
    return decodeURIComponent(part);
  } catch {
    return part;
  }
}
