// The report: success rates, the tables, and every episode at a glance.

import { el, link } from "./dom.js";
import { toEntrant, toFlight } from "./route.js";
import { episodes, flightsOf, index, outcomeWords, rate } from "./store.js";
import { percent } from "./words.js";

export function reportView() {
  const many = (count, noun) => `${count} ${noun}${count === 1 ? "" : "s"}`;
  const { of: scored } = rate(episodes);
  const element = el(
    "article",
    {},
    el("h1", {}, "Report"),
    el("p", { class: "quiet" }, `${many(episodes.length, "flight")} of ${many(new Set(episodes.map((episode) => episode.id)).size, "episode")} in ${many(index.runs.length, "run")}, ${scored} of them scored. Made by ${index.made}.`),
    solved(),
    glance(),
    document.getElementById("tables").content.cloneNode(true),
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
        const name = cell === "all" ? "" : cell;
        const { won, of: counted, all } = rate(flightsOf(number, name));
        if (!all) return el("td", { class: "number" }, "–");
        const share = counted ? won / counted : 0;
        return el("td", { class: "number" }, link(toEntrant(entrant.key, name), { class: "rate", "aria-label": `${entrant.title}, ${cell}: ${won} of ${counted} solved` },
          el("b", {}, percent(won, counted)), el("small", {}, `${won}/${counted}`), el("i", { class: "gauge", style: { "--share": share } })));
      }),
    ),
  );
  return el(
    "section",
    {},
    el("h2", {}, "Solved"),
    el("div", { class: "wide" }, el("table", { class: "solved" }, el("thead", {}, el("tr", {}, el("th", { scope: "col" }, "Pilots"), heads.map((cell) => el("th", { scope: "col", class: "number" }, cell)))), el("tbody", {}, rows))),
  );
}

// built on first opening: it has a link for each flight
function glance() {
  const folded = el("details", { class: "glance" }, el("summary", {}, "Every episode at a glance"));
  folded.addEventListener("toggle", () => folded.childElementCount === 1 && folded.append(el("div", { class: "wide" }, marks())), { once: true });
  return el("section", {}, folded);
}

function marks() {
  const ids = [...new Map(episodes.map((episode) => [episode.id, episode.cell])).entries()].sort((a, b) => index.cells.indexOf(a[1]) - index.cells.indexOf(b[1]) || a[0].localeCompare(b[0]));
  const byKey = new Map();
  for (const episode of episodes) {
    const key = `${episode.id}\n${episode.entrant}`;
    if (!byKey.has(key)) byKey.set(key, []);
    byKey.get(key).push(episode);
  }
  return el(
    "table",
    {},
    el("thead", {}, el("tr", {}, el("th", { scope: "col" }, "Episode"), index.entrants.map((entrant) => el("th", { scope: "col" }, entrant.title)))),
    el("tbody", {}, ids.map(([id]) => el("tr", {}, el("th", { scope: "row" }, id), index.entrants.map((_, entrant) => el("td", {}, (byKey.get(`${id}\n${entrant}`) || []).map(mark)))))),
  );
}

function mark(episode) {
  const [sign, words] = outcomeWords(episode.outcome);
  const shown = { class: `outcome mark ${episode.outcome}`, title: words, "aria-label": `${episode.id}: ${words}` };
  return episode.shown ? link(toFlight(episode.runKey, episode.key), shown, sign) : el("span", shown, sign);
}
