// A flight, step by step, alone or beside another run of its episode.

import { el } from "./dom.js";
import { details, exchangesOf, list } from "./details.js";
import { Flight } from "./flight.js";
import { Plan } from "./plan.js";
import { toFlight } from "./route.js";
import { episodeAt, flightOf, flightsOf, index, outcomeWords, rivals, runTitle } from "./store.js";
import { Timeline } from "./timeline.js";
import { Views } from "./views.js";
import { kindOf, metricText, number } from "./words.js";

const SPEED = 4; // times real time
const TICK_MS = 100;

export async function flightView(route, place) {
  const episode = episodeAt(route.run, route.episode);
  if (!episode) return missing(`There is no flight ${route.run}/${route.episode} in this report.`);
  if (!episode.shown) return missing(`${episode.id}, ${runTitle(episode)}: ${episode.error || "its logs are damaged."}`);
  const other = route.other ? rivals(episode).find((rival) => rival.runKey === route.other) : null;
  const wanted = other ? [episode, other] : [episode];
  const flights = (await Promise.all(wanted.map(flightOf))).map((data, i) => new Flight(wanted[i], data));
  return new FlightView(flights, route, place);
}

function missing(words) {
  return { element: el("p", { class: "fault" }, words), title: "Not here", keys: {} };
}

class FlightView {
  // place(hash): called to update the address
  constructor(flights, route, place) {
    this.place = place;
    this.sides = flights.map((flight, i) => ({ flight, side: flights.length > 1 ? "ab"[i] : "", title: runTitle(flight.episode) }));
    this.chosen = 0;
    this.playing = null;
    const first = flights[0];
    const { episode } = first;
    this.title = `${episode.id} · ${runTitle(episode)}`;
    this.plan = new Plan(this.sides, index.grounds[episode.ground]);
    this.timeline = new Timeline(this.sides, (t) => this.at(t));
    this.views = this.sides.map(({ flight, side }) => new Views(flight, side, (drone) => this.choose(drone)));
    this.facts = this.sides.map(({ side }) => el("div", { class: `words-of ${side}` }));
    this.steps = this.sides.length === 1 ? this.table(first) : null;
    this.play = el("button", { type: "button", class: "tool", "aria-pressed": "false", onclick: () => this.plays() }, "Play");
    this.element = this.layout(episode);
    this.keys = {
      next: () => this.go(1), previous: () => this.go(-1), far: (by) => this.go(10 * by),
      first: () => this.moment(0), last: () => this.moment(first.moments.length - 1),
      play: () => this.plays(), drone: (drone) => this.choose(drone),
      beside: () => this.rival && this.rival.focus(),
      nextEpisode: () => this.follow(1), previousEpisode: () => this.follow(-1),
    };
    if (first.moments.length) this.moment(route.step === null ? 0 : first.momentOf(route.step), false);
    else this.at(0);
  }

  layout(episode) {
    const alone = this.sides.length === 1;
    const views = this.views.map((view) => view.element);
    const facts = this.facts;
    return el(
      "article",
      { class: alone ? "flight" : "flight two" },
      this.head(episode),
      alone
        ? el("div", { class: "stage" }, views[0], this.plan.element)
        : el("div", { class: "stage" }, views[0], this.plan.element, views[1]),
      el("div", { class: "pilotage" }, el("div", { class: "deck" }, this.buttons(), this.timeline.caption), this.timeline.element),
      el("div", { class: "below" }, facts[0], alone ? this.steps : facts[1]),
      this.sides.map(({ flight }) => exchangesOf(flight, (t) => this.at(t))),
      this.measures(),
    );
  }

  head(episode) {
    const outcome = (flown, side) => {
      const [mark, words] = outcomeWords(flown.outcome);
      const ne = index.metrics.findIndex((metric) => metric.name === "ne_m");
      const away = ne < 0 || typeof flown.values[ne] !== "number" ? "" : `, ${number(flown.values[ne], 1)} m from the target`;
      return el("p", { class: "outcome-line" }, side ? el("b", { class: `side ${side}` }, side.toUpperCase()) : null,
        el("span", { class: `outcome ${flown.outcome}` }, `${mark} ${words}${flown.mode && flown.mode !== words ? `: ${flown.mode}` : ""}${flown.counted ? "" : ", not counted"}`), `${runTitle(flown)}${away}${flown.error ? `: ${flown.error}` : ""}`);
    };
    const others = rivals(episode);
    this.rival = el(
      "select",
      { id: "rival", onchange: () => { location.hash = toFlight(episode.runKey, episode.key, this.step, this.rival.value); } },
      el("option", { value: "" }, others.length ? "nobody" : "no other run has it"),
      others.map((other) => {
        const option = el("option", { value: other.runKey }, `${runTitle(other)}: ${outcomeWords(other.outcome)[1]}`);
        option.selected = this.sides.length > 1 && other.runKey === this.sides[1].flight.episode.runKey;
        return option;
      }),
    );
    const { flight } = this.sides[0];
    return el(
      "header",
      { class: "head" },
      el("div", {}, el("h1", {}, episode.id), el("p", { class: "told" }, flight.instruction ? `“${flight.instruction}”` : "", el("span", { class: "quiet" }, ` ${[episode.cell, episode.map].filter(Boolean).join(" · ")}`))),
      el("div", {}, this.sides.map(({ flight: own, side }) => outcome(own.episode, side)), el("p", { class: "beside" }, el("label", { for: "rival" }, "Compare with: "), this.rival)),
    );
  }

  buttons() {
    const button = (words, name, act) => el("button", { type: "button", class: "tool", title: name, "aria-label": name, onclick: act }, words);
    return el(
      "div",
      { class: "buttons" },
      button("⇤", "First step", () => this.keys.first()),
      button("←", "Previous step", () => this.go(-1)),
      this.play,
      button("→", "Next step", () => this.go(1)),
      button("⇥", "Last step", () => this.keys.last()),
    );
  }

  table(flight) {
    const many = flight.drones > 1;
    this.rows = new Map();
    const rows = flight.moments.flatMap((moment, at) =>
      moment.places.map((place) => {
        const step = flight.steps[place];
        const choose = () => {
          this.chosen = step.drone;
          this.moment(at);
        };
        const good = step.truth ? step.truth.qualifies : undefined;
        const row = el(
          "tr",
          { onclick: choose, class: good === undefined ? kindOf(step) : good ? "good" : "bad" },
          el("td", {}, el("button", { type: "button", class: "row" }, String(step.step))),
          el("td", { class: "number" }, number(step.t, 1)),
          many ? el("td", {}, el("span", { class: `who d${step.drone % 8}` }, String(step.drone + 1))) : null,
          el("td", {}, step.does),
          el("td", { class: "number" }, step.truth && step.truth.distance !== undefined ? number(step.truth.distance, 1) : "–"),
        );
        this.rows.set(`${step.step}/${step.drone}`, row);
        return row;
      }),
    );
    const head = (words, numeric) => el("th", { scope: "col", class: numeric ? "number" : null }, words);
    const heads = [head("Step"), head("s", true), many ? head("Drone") : null, head("Action"), head("Distance, m (the judge’s)", true)];
    this.scroller = el(
      "div",
      { class: "scroller", tabindex: "0", role: "region", "aria-label": "All steps" },
      el("table", { class: "steps" }, el("thead", {}, el("tr", {}, heads)), el("tbody", {}, rows)),
    );
    return el("section", { class: "all-steps" }, el("h2", {}, "Steps"), this.scroller);
  }

  measures() {
    const heads = this.sides.map(({ side, title }) => el("th", { scope: "col" }, side ? `${side.toUpperCase()}: ${title}` : "Value"));
    const rows = index.metrics.map((metric, i) =>
      el("tr", {}, el("th", { scope: "row", title: metric.definition }, metric.title), this.sides.map(({ flight }) => el("td", { class: "number" }, metricText(metric, flight.episode.values[i]))), el("td", { class: "quiet" }, metric.definition)),
    );
    const settings = index.runs[this.sides[0].flight.episode.run].settings;
    return el(
      "section",
      { class: "measures" },
      el("details", {}, el("summary", {}, "Every metric of this flight"), el("div", { class: "wide" }, el("table", {}, el("thead", {}, el("tr", {}, el("th", { scope: "col" }, "Metric"), heads, el("th", { scope: "col" }, "What it is"))), el("tbody", {}, rows)))),
      el("details", {}, el("summary", {}, "Settings of the run"), list(settings)),
      index.pictures ? el("p", { class: "quiet" }, index.pictures) : null,
    );
  }

  get moments() {
    return this.sides[0].flight.moments;
  }

  go(by) {
    this.moment(Math.min(this.moments.length - 1, Math.max(0, this.now + by)));
  }

  moment(place, addressed = true) {
    if (!this.moments.length) return;
    this.now = place;
    this.show(this.moments[place].t, addressed);
  }

  at(t) {
    this.now = this.moments.length ? this.sides[0].flight.momentAt(t) : 0;
    this.show(Math.min(this.timeline.end, Math.max(0, t)), true);
  }

  choose(drone) {
    if (drone >= this.sides[0].flight.drones) return;
    this.chosen = drone;
    this.show(this.t, true);
  }

  show(t, addressed) {
    this.t = t;
    const newest = this.sides.map(({ flight }, i) => flight.newest(i ? flight.momentAt(t) : this.now));
    this.sides.forEach(({ flight }, i) => {
      const moment = flight.moments[i ? flight.momentAt(t) : this.now];
      // of drones that decide alone, choose that of the step, unless the reader chose another
      const alone = moment && moment.places.length === 1 && flight.drones > 1;
      if (!i && alone && this.stepped !== moment.step) this.chosen = moment.drone;
      const drone = Math.min(this.chosen, flight.drones - 1);
      if (!i && moment) this.stepped = moment.step;
      this.views[i].show(newest[i], moment ? moment.step : -1, drone);
      this.facts[i].replaceChildren(...[this.sides[i].side ? el("h2", { class: "whose" }, el("b", { class: `side ${this.sides[i].side}` }, this.sides[i].side.toUpperCase()), this.sides[i].title) : "", this.kept(i, details(flight, newest[i][drone]))].filter(Boolean));
      preload(flight, i ? flight.momentAt(t) : this.now);
    });
    this.plan.show(t, newest);
    const { step } = this.moments[this.now] || { step: 0 };
    this.step = step;
    this.timeline.show(t, step);
    this.mark(step);
    if (addressed) {
      const { episode } = this.sides[0].flight;
      this.place(toFlight(episode.runKey, episode.key, step, this.sides.length > 1 ? this.sides[1].flight.episode.runKey : ""));
    }
  }

  // The prompt of the next step is unfolded if that of the last one was.
  kept(side, made) {
    const last = this.facts[side].querySelector("details.prompt");
    const next = made.querySelector("details.prompt");
    if (last && next) next.open = last.open;
    return made;
  }

  shown() {
    this.mark(this.step);
  }

  mark(step) {
    if (!this.rows) return;
    if (this.marked) this.marked.removeAttribute("aria-current");
    this.marked = this.rows.get(`${step}/${this.chosen}`) || this.rows.get(`${step}/${(this.moments[this.now] || { drone: 0 }).drone}`);
    if (!this.marked) return;
    this.marked.setAttribute("aria-current", "step");
    const { offsetTop: top, offsetHeight: high } = this.marked;
    const room = this.scroller.clientHeight;
    if (top - high < this.scroller.scrollTop) this.scroller.scrollTop = top - 2 * high;
    else if (top + 2 * high > this.scroller.scrollTop + room) this.scroller.scrollTop = top + 2 * high - room;
  }

  plays() {
    if (this.playing) return this.stop();
    if (this.t >= this.timeline.end - 0.1) this.at(0);
    this.play.textContent = "Stop";
    this.play.setAttribute("aria-pressed", "true");
    this.playing = setInterval(() => {
      const t = this.t + (SPEED * TICK_MS) / 1000;
      this.at(Math.min(t, this.timeline.end));
      if (t >= this.timeline.end) this.stop();
    }, TICK_MS);
  }

  stop() {
    clearInterval(this.playing);
    this.playing = null;
    this.play.textContent = "Play";
    this.play.setAttribute("aria-pressed", "false");
  }

  follow(by) {
    const { episode } = this.sides[0].flight;
    const list = flightsOf(episode.entrant, "").filter((flight) => flight.shown);
    const next = list[list.findIndex((flight) => flight.number === episode.number) + by];
    if (next) location.hash = toFlight(next.runKey, next.key);
  }
}

function preload(flight, moment) {
  const next = flight.moments[moment + 1];
  for (const place of next ? next.places : []) {
    const { picture } = flight.steps[place];
    if (picture && !picture.startsWith("data:")) new Image().src = picture;
  }
}
