// All flights of one entrant, or of one cell: a table that can be sorted and filtered by outcome.

import { el, link } from "./dom.js";
import { toEntrant, toFlight } from "./route.js";
import { flightsOf, index, outcomeWords, rate } from "./store.js";
import { metricText, percent } from "./words.js";

// metrics with a column, if the index has them
const SHOWN = ["ne_m", "min_distance_m", "approach_ratio", "first_acquisition_s", "path_m"];

export function entrantView(route) {
  const number = index.entrants.findIndex((candidate) => candidate.key === route.entrant);
  const entrant = index.entrants[number];
  if (!entrant) return { element: el("p", { class: "fault" }, `There is no entrant ${route.entrant} in this report.`), title: "Not here", keys: {} };
  const view = new EntrantView(entrant, number, route.cell);
  return { element: view.element, title: [entrant.title, route.cell].filter(Boolean).join(" · "), keys: {} };
}

class EntrantView {
  constructor(entrant, number, cell) {
    this.all = flightsOf(number, cell);
    this.runs = entrant.runs;
    this.outcome = "";
    this.sorted = { by: "", down: false };
    this.columns = this.listColumns();
    this.body = el("tbody");
    this.heads = this.columns.map((column) => this.head(column));
    const cells = index.cells.filter((name) => flightsOf(number, name).length);
    const { won, of: counted, all } = rate(this.all);
    this.element = el(
      "article",
      {},
      el("h1", {}, entrant.title, entrant.model ? null : el("span", { class: "tag" }, "built-in pilot, no model")),
      el("nav", { class: "chips", "aria-label": "Cells" },
        link(toEntrant(entrant.key), { "aria-current": cell ? null : "page" }, "all cells"),
        cells.map((name) => link(toEntrant(entrant.key, name), { "aria-current": name === cell ? "page" : null }, name))),
      el("p", {}, `${percent(won, counted)} solved, ${won} of ${counted}`, all > counted ? `; ${all - counted} more are nobody’s score` : ""),
      this.filter(),
      el("div", { class: "wide" }, el("table", { class: "list" }, el("thead", {}, el("tr", {}, this.heads)), this.body)),
    );
    this.fill();
  }

  listColumns() {
    const columns = [
      { name: "Episode", of: (flight) => flight.id, cell: (flight) => el("th", { scope: "row" }, flight.shown ? link(toFlight(flight.runKey, flight.key), { "data-row": "" }, flight.id) : [flight.id, el("span", { class: "fault" }, ` ${flight.error || ""}`)]) },
      { name: "Outcome", of: (flight) => flight.outcome, cell: (flight) => el("td", {}, badge(flight)) },
      { name: "Mode", title: "success, or the failure mode: the first of the paper’s that holds", of: (flight) => flight.mode },
      { name: "Cell", of: (flight) => flight.cell },
      { name: "Map", of: (flight) => flight.map },
    ];
    if (this.runs.length > 1) columns.push({ name: "Flight", of: (flight) => 1 + this.runs.indexOf(flight.run) });
    for (const name of SHOWN) {
      const place = index.metrics.findIndex((metric) => metric.name === name);
      if (place < 0) continue;
      const metric = index.metrics[place];
      columns.push({ name: metric.title, title: metric.definition, of: (flight) => flight.values[place], cell: (flight) => el("td", { class: "number" }, metricText(metric, flight.values[place])) });
    }
    columns.push({ name: "Steps", of: (flight) => flight.steps }, { name: "Declared", of: (flight) => flight.declarations });
    return columns;
  }

  head(column) {
    const button = el("button", { type: "button", title: column.title, onclick: () => this.sort(column.name) }, column.name);
    const numeric = this.all.some((flight) => typeof column.of(flight) === "number");
    return el("th", { scope: "col", "data-column": column.name, class: numeric ? "number" : null }, button);
  }

  filter() {
    const outcomes = [...new Set(this.all.map((flight) => flight.outcome))];
    const select = el("select", { id: "outcome", onchange: () => { this.outcome = select.value; this.fill(); } },
      el("option", { value: "" }, `all ${this.all.length}`),
      outcomes.map((outcome) => el("option", { value: outcome }, `${outcomeWords(outcome)[1]}: ${this.all.filter((flight) => flight.outcome === outcome).length}`)));
    return el("p", { class: "filter" }, el("label", { for: "outcome" }, "Show "), select);
  }

  sort(name) {
    this.sorted = { by: name, down: this.sorted.by === name && !this.sorted.down };
    this.fill();
  }

  fill() {
    const column = this.columns.find((candidate) => candidate.name === this.sorted.by);
    const shown = this.all.filter((flight) => !this.outcome || flight.outcome === this.outcome);
    if (column) shown.sort((a, b) => compared(column.of(a), column.of(b)) * (this.sorted.down ? -1 : 1) || a.number - b.number);
    for (const head of this.heads) {
      const by = head.dataset.column === this.sorted.by;
      if (by) head.setAttribute("aria-sort", this.sorted.down ? "descending" : "ascending");
      else head.removeAttribute("aria-sort");
    }
    this.body.replaceChildren(...shown.map((flight) => el("tr", { class: flight.shown ? "opens" : "", onclick: (event) => open(event, flight) },
      this.columns.map((column) => (column.cell ? column.cell(flight) : el("td", { class: typeof column.of(flight) === "number" ? "number" : "" }, String(column.of(flight) ?? "–")))))));
  }
}

function open(event, episode) {
  if (episode.shown && !event.target.closest("a")) location.hash = toFlight(episode.runKey, episode.key);
}

export function badge(episode) {
  const [mark, words] = outcomeWords(episode.outcome);
  return el("span", { class: `outcome ${episode.outcome}` }, `${mark} ${words}${episode.counted ? "" : ", not counted"}`);
}

// unknown values come last in both directions
function compared(a, b) {
  const none = (x) => x === null || x === undefined;
  if (none(a) || none(b)) return none(a) - none(b);
  return typeof a === "number" && typeof b === "number" ? a - b : String(a).localeCompare(String(b), "en", { numeric: true });
}
