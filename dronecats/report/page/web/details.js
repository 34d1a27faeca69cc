// The facts of one decision: prompt, reply and action, and apart from them the judge's measurements.

import { el } from "./dom.js";
import { kindOf, measured, number } from "./words.js";

export function details(flight, step) {
  if (!step) return el("section", { class: "facts" }, el("p", { class: "quiet" }, "No decision is in the log."));
  return el("section", { class: "facts" }, decisionSection(flight, step), judgeSection(flight, step), replySection(flight, step));
}

function decisionSection(flight, step) {
  const drone = flight.drones > 1 ? `, drone ${step.drone + 1}` : "";
  const tokens = step.tokens_in === undefined && step.tokens_out === undefined ? null : `${step.tokens_in ?? "?"} in, ${step.tokens_out ?? "?"} out`;
  return el(
    "div",
    { class: "decided" },
    el("h2", {}, `Step ${step.step}${drone}`),
    el("p", { class: `action ${kindOf(step)}` }, step.does),
    step.error ? el("p", { class: "fault" }, step.error) : null,
    list([
      ["Latency", measured(step.latency, "s", 2)],
      ["Picture taken", measured(step.t, "s", 2)],
      ["Decided", measured(step.decided, "s", 2)],
      ["Rate", step.rate === undefined ? null : measured(step.rate, "Hz", 2)],
      ["Tokens", tokens],
      ["Reasoning", step.thinking ? "lifted" : null],
      ["In the history as", step.says],
      ["Reply ended", step.finish],
      ["Mended", step.mended ? step.mended.join(", ") : null],
      ["Declared by", step.confirmed_by === undefined ? null : `the commander, exchange ${step.confirmed_by}`],
    ]),
  );
}

function judgeSection(flight, step) {
  const truth = step.truth;
  const seen = truth && truth.visible !== undefined ? (truth.visible ? `yes${truth.share === undefined ? "" : `, ${number(100 * truth.share, 0)} % of it`}` : "no") : null;
  const verdict = truth && truth.qualifies !== undefined ? (truth.qualifies ? "counts: near enough, and in view" : "does not count") : null;
  return el(
    "div",
    { class: "judge" },
    el("h3", {}, flight.estimated ? "The autopilot’s own estimate" : "The judge’s", el("span", { class: "tag" }, "the model never saw this")),
    truth
      ? list([
          ["Distance", measured(truth.distance, "m", 2)],
          ["… to its box", truth.box === undefined ? null : measured(truth.box, "m", 2)],
          ["In view", seen],
          ["Bearing", bearing(truth.bearing)],
          ["True depth", truth.depth === undefined ? null : measured(truth.depth, "m", 2)],
          ["Declaration", verdict],
        ])
      : el("p", { class: "quiet" }, "This picture was not measured."),
  );
}

function bearing(degrees) {
  if (degrees === undefined) return null;
  const degreesShown = Math.round(Math.abs(degrees));
  return degreesShown ? `${degreesShown}° ${degrees < 0 ? "left" : "right"}` : "ahead";
}

function replySection(flight, step) {
  const reply = flight.text(step.reply);
  const prompt = flight.prompt(step);
  const missing = step.confirmed_by === undefined
    ? "The run folder has no prompts.jsonl: it was flown by an older version, or by an agent that logs no prompts."
    : "The commander was asked: see its exchanges.";
  return el(
    "div",
    { class: "said" },
    el("h3", {}, "Reply"),
    reply === null ? el("p", { class: "quiet" }, "None of its own.") : el("pre", { class: "reply", tabindex: "0" }, reply),
    el(
      "details",
      { class: "prompt" },
      el("summary", {}, "Prompt"),
      prompt === null
        ? el("p", { class: "quiet" }, missing)
        : [el("p", { class: "quiet" }, "As it was sent; then the picture."), el("pre", { tabindex: "0" }, prompt)],
    ),
  );
}

export function exchangesOf(flight, move) {
  if (!flight.exchanges.length) return null;
  return el(
    "section",
    { class: "exchanges" },
    el("h2", {}, "The commander"),
    flight.exchanges.map((exchange) =>
      el(
        "details",
        {},
        el(
          "summary",
          {},
          `${number(exchange.asked, 1)} s: ${exchange.causes.join(", ")} → ${summary(exchange)}`,
        ),
        el("button", { type: "button", class: "tool", onclick: () => move(exchange.asked) }, "Go to this time"),
        list([
          ["Model", exchange.model],
          ["Answered", measured(exchange.answered, "s", 2)],
          ["Latency", measured(exchange.latency, "s", 2)],
          ["Orders", exchange.orders.length ? exchange.orders.join("; ") : null],
          ["Confirms", exchange.confirms.length ? exchange.confirms.map((drone) => `drone ${drone + 1}`).join(", ") : null],
          ["Changed nothing", exchange.error],
        ]),
        exchange.reply === undefined ? null : el("pre", { tabindex: "0" }, exchange.reply),
        exchange.prompt === undefined ? null : el("details", { class: "prompt" }, el("summary", {}, "Prompt"), el("pre", { tabindex: "0" }, exchange.prompt)),
      ),
    ),
  );
}

function summary(exchange) {
  const words = [];
  if (exchange.orders.length) words.push(`${exchange.orders.length} ${exchange.orders.length > 1 ? "orders" : "order"}`);
  if (exchange.confirms.length) words.push(`confirms ${exchange.confirms.map((drone) => `drone ${drone + 1}`).join(", ")}`);
  return words.join(", ") || (exchange.reply === undefined ? "no reply in time" : "nothing");
}

export function list(pairs) {
  return el("dl", {}, pairs.filter(([, value]) => value !== null && value !== undefined).map(([name, value]) => el("div", {}, el("dt", {}, name), el("dd", {}, value))));
}
