// The page: shows the view of the address, and updates the address.

import { el, link } from "./dom.js";
import { entrantView } from "./entrant.js";
import { listen } from "./keys.js";
import { reportView } from "./report.js";
import { flightView } from "./steps.js";
import { parsed, toEntrant } from "./route.js";
import { episodeAt, index } from "./store.js";

const main = document.getElementById("main");
let view = { keys: {} };
let shown = null; // address of the view
let requests = 0;

async function show() {
  const route = parsed(location.hash);
  if (view.stop) view.stop();
  shown = location.hash;
  requests += 1;
  const request = requests;
  let next;
  try {
    if (route.view === "report") next = reportView();
    else if (route.view === "entrant") next = entrantView(route);
    else next = await flightView(route, place);
  } catch (error) {
    next = { element: el("p", { class: "fault" }, error.message), title: "Not here", keys: {} };
  }
  if (request !== requests) return; // a newer request has begun
  const moved = view.title !== undefined && view.title !== next.title;
  view = next;
  document.title = `${view.title} · DroneCATS`;
  trail(route);
  main.replaceChildren(view.element);
  if (view.shown) view.shown();
  document.getElementById("said").textContent = view.title;
  if (moved) {
    window.scrollTo(0, 0);
    main.focus({ preventScroll: true });
  }
  document.documentElement.dataset.ready ??= Math.round(performance.now()); // ms until the page was usable
}

// a step of a flight makes no entry in the browser's history
function place(hash) {
  if (hash === location.hash) return;
  shown = hash;
  history.replaceState(null, "", hash);
}

function above(route) {
  if (route.view === "entrant") return route.cell ? toEntrant(route.entrant) : "#";
  if (route.view === "report") return null;
  const episode = episodeAt(route.run, route.episode);
  return episode ? toEntrant(index.entrants[episode.entrant].key, episode.cell) : "#";
}

function trail(route) {
  const stops = [["Report", "#"]];
  const episode = route.view === "flight" ? episodeAt(route.run, route.episode) : null;
  const entrant = episode ? index.entrants[episode.entrant] : index.entrants.find((candidate) => candidate.key === route.entrant);
  const cell = episode ? episode.cell : route.cell;
  if (entrant) stops.push([entrant.title, toEntrant(entrant.key)]);
  if (entrant && cell) stops.push([cell, toEntrant(entrant.key, cell)]);
  if (episode) stops.push([episode.id, null]);
  const last = stops.length - 1;
  document.getElementById("trail").replaceChildren(...stops.map(([words, hash], i) => el("li", {}, i === last ? el("span", { "aria-current": "page" }, words) : link(hash, {}, words))));
}

window.addEventListener("hashchange", () => location.hash !== shown && show());
listen(
  () => view,
  () => {
    const hash = above(parsed(location.hash));
    if (hash !== null) location.hash = hash;
    return hash !== null;
  },
);
show();
