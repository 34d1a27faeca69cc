// The keyboard: a table of keys and actions, from which the help is made.

import { el } from "./dom.js";
import { nextTheme } from "./bar.js";

const KEYS = [
  ["→  j", "next step; in a table, the next line", ["ArrowRight", "j"], (view) => (view.keys.next ? view.keys.next() : line(1))],
  ["←  k", "previous step, or line", ["ArrowLeft", "k"], (view) => (view.keys.previous ? view.keys.previous() : line(-1))],
  ["↓  ↑", "in a table: next and previous line", ["ArrowDown", "ArrowUp"], (view, key) => !view.keys.next && line(key === "ArrowDown" ? 1 : -1)],
  ["Enter", "open the line", [], null],
  ["u  Esc", "up: from a step to its cell, to the report", ["u", "Escape"], (view, key, up) => up()],
  ["PgDn  PgUp", "ten steps on, or back", ["PageDown", "PageUp"], (view, key) => view.keys.far && view.keys.far(key === "PageDown" ? 1 : -1)],
  ["Home  End", "first and last step", ["Home", "End"], (view, key) => view.keys.first && (key === "Home" ? view.keys.first() : view.keys.last())],
  ["Space", "play, four times as fast as it was, and stop", [" "], (view) => view.keys.play && view.keys.play()],
  ["1 … 8", "look at this drone", ["1", "2", "3", "4", "5", "6", "7", "8"], (view, key) => view.keys.drone && view.keys.drone(Number(key) - 1)],
  ["]  [", "next and previous episode", ["]", "["], (view, key) => view.keys.nextEpisode && (key === "]" ? view.keys.nextEpisode() : view.keys.previousEpisode())],
  ["c", "choose a run to put beside it", ["c"], (view) => view.keys.beside && view.keys.beside()],
  ["t", "light, dark, or as the system", ["t"], () => nextTheme()],
  ["?", "this help", ["?"], () => help()],
];

// current(): the view; up(): go one level up
export function listen(current, up) {
  const acts = new Map(KEYS.flatMap(([, , names, act]) => names.map((name) => [name, act])));
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || document.getElementById("help").open) return;
    const on = event.target;
    if (on.matches("select, textarea, input:not([type=range])")) return;
    if (event.key === " " && on.closest("button, summary, a")) return;
    if (on.closest("pre, .scroller") && ["PageDown", "PageUp", "Home", "End"].includes(event.key)) return;
    const act = acts.get(event.key);
    if (act && act(current(), event.key, up) !== false) event.preventDefault();
  });
  document.getElementById("keys").addEventListener("click", help);
}

export function help() {
  const dialog = document.getElementById("help");
  dialog.replaceChildren(
    el("h2", { id: "help-title" }, "Keys"),
    el("dl", { class: "keys" }, KEYS.map(([names, words]) => el("div", {}, el("dt", {}, names.split("  ").map((name) => el("kbd", {}, name))), el("dd", {}, words)))),
    el("p", { class: "quiet" }, "The address says where you are, down to the step: it can be kept and sent."),
    el("form", { method: "dialog" }, el("button", { class: "tool", autofocus: true }, "Close")),
  );
  dialog.showModal();
}

function line(by) {
  const lines = [...document.querySelectorAll("main [data-row]")];
  if (!lines.length) return false;
  const now = lines.indexOf(document.activeElement);
  lines[now < 0 ? (by > 0 ? 0 : lines.length - 1) : Math.min(lines.length - 1, Math.max(0, now + by))].focus();
  return true;
}
