// The page: shows what the address names, and keeps the address true.

import { el, link } from "./dom.js";
import { entrantView } from "./entrant.js";
import { listen } from "./keys.js";
import { reportView } from "./report.js";
import { flightView } from "./steps.js";
import { parsed, toEntrant } from "./route.js";
import { episodeAt, index } from "./store.js";

const main = document.getElementById("main");
let view = { keys: {} };
let shown = null; // address of what is shown
let asked = 0;

async function show() {
  const route = parsed(location.hash);
  if (view.stop) view.stop();
  shown = location.hash;
  asked += 1;
  const mine = asked;
  let made;
  try {
    if (route.view === "report") made = reportView();
    else if (route.view === "entrant") made = entrantView(route);
    else made = await flightView(route, place);
  } catch (error) {
    made = { element: el("p", { class: "fault" }, error.message), title: "Not here", keys: {} };
  }
  if (mine !== asked) return; // somebody has gone on meanwhile
  const moved = view.title !== undefined && view.title !== made.title;
  view = made;
  document.title = `${view.title} · DroneCATS`;
  trail(route);
  main.replaceChildren(view.element);
  if (view.shown) view.shown();
  document.getElementById("said").textContent = view.title;
  if (moved) {
    window.scrollTo(0, 0);
    main.focus({ preventScroll: true });
  }
  document.documentElement.dataset.ready ??= Math.round(performance.now()); // ms until something could be done
}

// the step of a flight changes under one's fingers: no entry in the history for each
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
  const entrant = episode ? index.entrants[episode.entrant] : index.entrants.find((each) => each.key === route.entrant);
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
