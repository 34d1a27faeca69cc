// The report as a whole: who solved what, the tables, and every episode at a glance.

import { el, link } from "./dom.js";
import { toEntrant, toFlight } from "./route.js";
import { episodes, index, of, rate } from "./store.js";
import { outcomeWords, percent } from "./words.js";

export function reportView() {
  const flown = episodes.length;
  const { of: counted } = rate(episodes);
  const element = el(
    "article",
    {},
    el("h1", {}, "Report"),
    el("p", { class: "quiet" }, `${flown} flights of ${new Set(episodes.map((each) => each.id)).size} episodes in ${index.runs.length} ${index.runs.length > 1 ? "runs" : "run"}; ${counted} are scored. Made by ${index.made}.`),
    solved(),
    glance(),
    index.tables.map(table),
  );
  return { element, title: "Report", keys: {} };
}

function solved() {
  const heads = [...index.cells, "all"];
  const rows = index.entrants.map((entrant, number) =>
    el(
      "tr",
      {},
      el("th", { scope: "row" }, link(toEntrant(entrant.key), { "data-row": "" }, entrant.title), entrant.model ? null : el("span", { class: "tag" }, "built-in pilot, no model")),
      heads.map((cell) => {
        const named = cell === "all" ? "" : cell;
        const { won, of: counted, all } = rate(of(number, named));
        if (!all) return el("td", { class: "number" }, "–");
        const share = counted ? won / counted : 0;
        return el("td", { class: "number" }, link(toEntrant(entrant.key, named), { class: "rate", "aria-label": `${entrant.title}, ${cell}: ${won} of ${counted} solved` },
          el("b", {}, percent(won, counted)), el("small", {}, `${won}/${counted}`), el("i", { class: "gauge", style: { "--share": share } })));
      }),
    ),
  );
  return el(
    "section",
    {},
    el("h2", {}, "Solved"),
    el("div", { class: "wide" }, el("table", { class: "solved" }, el("thead", {}, el("tr", {}, el("th", { scope: "col" }, "Who flew"), heads.map((cell) => el("th", { scope: "col", class: "number" }, cell)))), el("tbody", {}, rows))),
  );
}

// a table of the report: its numbers are words already, and a line leads to whose it is
function table(told) {
  const groups = [];
  for (const column of told.columns) {
    const last = groups[groups.length - 1];
    // the first column has a head of its own: it stays when the others are scrolled
    if (last && last.words === column.group && (last.words || groups.length > 1)) last.span += 1;
    else groups.push({ words: column.group, span: 1 });
  }
  const grouped = groups.some((group) => group.words);
  const arrow = { more: " ↑", less: " ↓" };
  const head = el("tr", {}, told.columns.map((column) => el("th", { scope: "col", class: column.align === "right" ? "number" : "" }, `${column.title}${arrow[column.better] || ""}`, column.unit ? el("small", {}, ` ${column.unit}`) : null)));
  return el(
    "section",
    {},
    el("h2", {}, told.title),
    el("p", { class: "quiet" }, told.caption),
    el(
      "div",
      { class: "wide" },
      el(
        "table",
        {},
        el("thead", {}, grouped ? el("tr", {}, groups.map((group) => el(group.words ? "th" : "td", { scope: group.words ? "colgroup" : null, colspan: group.span, class: "group" }, group.words))) : null, head),
        told.blocks.map((block) =>
          el("tbody", {}, block.title ? el("tr", {}, el("th", { scope: "rowgroup", colspan: told.columns.length, class: "block" }, el("span", {}, block.title))) : null, block.rows.map((row) => line(told, row))),
        ),
      ),
    ),
    told.notes.map((note) => el("p", { class: "quiet" }, note)),
    told.command ? el("p", { class: "quiet" }, el("code", {}, told.command)) : null,
  );
}

function line(told, row) {
  return el("tr", {}, row.cells.map((cell, number) => {
    const column = told.columns[number];
    const entrant = row.entrant === undefined ? null : index.entrants[row.entrant];
    const leads = entrant && (number === 0 || column.cell);
    const words = [
      leads ? link(toEntrant(entrant.key, column.cell || ""), {}, cell.text) : cell.text,
      cell.interval ? el("small", {}, ` ${cell.interval}`) : null,
    ];
    return el(number ? "td" : "th", { scope: number ? null : "row", class: [column.align === "right" ? "number" : "", cell.best ? "best" : ""].join(" ").trim() || null, title: cell.counted }, words);
  }));
}

// made when it is unfolded: as many links as there are flights
function glance() {
  const folded = el("details", { class: "glance" }, el("summary", {}, "Every episode at a glance"));
  folded.addEventListener("toggle", () => folded.childElementCount === 1 && folded.append(el("div", { class: "wide" }, marks())), { once: true });
  return el("section", {}, folded);
}

function marks() {
  const ids = [...new Map(episodes.map((each) => [each.id, each.cell])).entries()].sort((a, b) => index.cells.indexOf(a[1]) - index.cells.indexOf(b[1]) || a[0].localeCompare(b[0]));
  const found = new Map();
  for (const each of episodes) {
    const key = `${each.id}\n${each.entrant}`;
    if (!found.has(key)) found.set(key, []);
    found.get(key).push(each);
  }
  return el(
    "table",
    {},
    el("thead", {}, el("tr", {}, el("th", { scope: "col" }, "Episode"), index.entrants.map((entrant) => el("th", { scope: "col" }, entrant.title)))),
    el("tbody", {}, ids.map(([id]) => el("tr", {}, el("th", { scope: "row" }, id), index.entrants.map((_, entrant) => el("td", {}, (found.get(`${id}\n${entrant}`) || []).map(mark)))))),
  );
}

function mark(episode) {
  const [sign, words] = outcomeWords(episode.outcome);
  const shown = { class: `outcome mark ${episode.outcome}`, title: words, "aria-label": `${episode.id}: ${words}` };
  return episode.shown ? link(toFlight(episode.runKey, episode.key), shown, sign) : el("span", shown, sign);
}
