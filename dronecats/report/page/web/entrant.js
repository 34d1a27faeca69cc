// All flights of one entrant, or those of one cell: a table that can be sorted, and narrowed to an outcome.

import { el, link } from "./dom.js";
import { toEntrant, toFlight } from "./route.js";
import { index, of, outcomeWords, rate } from "./store.js";
import { metricText, percent } from "./words.js";

// metrics that have a column, as far as there are any of this name
const SHOWN = ["ne_m", "min_distance_m", "approach_ratio", "first_acquisition_s", "path_m"];

export function entrantView(route) {
  const number = index.entrants.findIndex((each) => each.key === route.entrant);
  const entrant = index.entrants[number];
  if (!entrant) return { element: el("p", { class: "fault" }, `There is no entrant ${route.entrant} in this report.`), title: "Not here", keys: {} };
  const view = new EntrantView(entrant, number, route.cell);
  return { element: view.element, title: [entrant.title, route.cell].filter(Boolean).join(" · "), keys: {} };
}

class EntrantView {
  constructor(entrant, number, cell) {
    this.all = of(number, cell);
    this.flights = entrant.runs;
    this.outcome = "";
    this.sorted = { by: "", down: false };
    this.columns = this.told();
    this.body = el("tbody");
    this.heads = this.columns.map((column) => this.head(column));
    const cells = index.cells.filter((each) => of(number, each).length);
    const { won, of: counted, all } = rate(this.all);
    this.element = el(
      "article",
      {},
      el("h1", {}, entrant.title, entrant.model ? null : el("span", { class: "tag" }, "built-in pilot, no model")),
      el("nav", { class: "chips", "aria-label": "Cells" },
        link(toEntrant(entrant.key), { "aria-current": cell ? null : "page" }, "all cells"),
        cells.map((each) => link(toEntrant(entrant.key, each), { "aria-current": each === cell ? "page" : null }, each))),
      el("p", {}, `${percent(won, counted)} solved, ${won} of ${counted}`, all > counted ? `; ${all - counted} more are nobody’s score` : ""),
      this.filter(),
      el("div", { class: "wide" }, el("table", { class: "list" }, el("thead", {}, el("tr", {}, this.heads)), this.body)),
    );
    this.fill();
  }

  told() {
    const columns = [
      { name: "Episode", of: (each) => each.id, cell: (each) => el("th", { scope: "row" }, each.shown ? link(toFlight(each.runKey, each.key), { "data-row": "" }, each.id) : [each.id, el("span", { class: "fault" }, ` ${each.error || ""}`)]) },
      { name: "Outcome", of: (each) => each.outcome, cell: (each) => el("td", {}, badge(each)) },
      { name: "Mode", title: "success, or the failure mode: the first of the paper’s that holds", of: (each) => each.mode },
      { name: "Cell", of: (each) => each.cell },
      { name: "Map", of: (each) => each.map },
    ];
    if (this.flights.length > 1) columns.push({ name: "Flight", of: (each) => 1 + this.flights.indexOf(each.run) });
    for (const name of SHOWN) {
      const place = index.metrics.findIndex((metric) => metric.name === name);
      if (place < 0) continue;
      const metric = index.metrics[place];
      columns.push({ name: metric.title, title: metric.definition, of: (each) => each.values[place], cell: (each) => el("td", { class: "number" }, metricText(metric, each.values[place])) });
    }
    columns.push({ name: "Steps", of: (each) => each.steps }, { name: "Declared", of: (each) => each.declarations });
    return columns;
  }

  head(column) {
    const button = el("button", { type: "button", title: column.title, onclick: () => this.sort(column.name) }, column.name);
    const numeric = this.all.some((each) => typeof column.of(each) === "number");
    return el("th", { scope: "col", "data-column": column.name, class: numeric ? "number" : null }, button);
  }

  filter() {
    const outcomes = [...new Set(this.all.map((each) => each.outcome))];
    const select = el("select", { id: "outcome", onchange: () => { this.outcome = select.value; this.fill(); } },
      el("option", { value: "" }, `all ${this.all.length}`),
      outcomes.map((outcome) => el("option", { value: outcome }, `${outcomeWords(outcome)[1]}: ${this.all.filter((each) => each.outcome === outcome).length}`)));
    return el("p", { class: "filter" }, el("label", { for: "outcome" }, "Show "), select);
  }

  sort(name) {
    this.sorted = { by: name, down: this.sorted.by === name && !this.sorted.down };
    this.fill();
  }

  fill() {
    const column = this.columns.find((each) => each.name === this.sorted.by);
    const some = this.all.filter((each) => !this.outcome || each.outcome === this.outcome);
    if (column) some.sort((a, b) => compared(column.of(a), column.of(b)) * (this.sorted.down ? -1 : 1) || a.number - b.number);
    for (const head of this.heads) {
      const by = head.dataset.column === this.sorted.by;
      if (by) head.setAttribute("aria-sort", this.sorted.down ? "descending" : "ascending");
      else head.removeAttribute("aria-sort");
    }
    this.body.replaceChildren(...some.map((each) => el("tr", { class: each.shown ? "opens" : "" , onclick: (event) => open(event, each) },
      this.columns.map((one) => (one.cell ? one.cell(each) : el("td", { class: typeof one.of(each) === "number" ? "number" : "" }, String(one.of(each) ?? "–")))))));
  }
}

function open(event, episode) {
  if (episode.shown && !event.target.closest("a")) location.hash = toFlight(episode.runKey, episode.key);
}

export function badge(episode) {
  const [mark, words] = outcomeWords(episode.outcome);
  return el("span", { class: `outcome ${episode.outcome}` }, `${mark} ${words}${episode.counted ? "" : ", not counted"}`);
}

// what is not known comes last, whichever way it is sorted
function compared(a, b) {
  const none = (x) => x === null || x === undefined;
  if (none(a) || none(b)) return none(a) - none(b);
  return typeof a === "number" && typeof b === "number" ? a - b : String(a).localeCompare(String(b), "en", { numeric: true });
}
