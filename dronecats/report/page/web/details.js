// The words of one decision: what was asked, answered and done; and apart from it what only the judge knows.

import { el } from "./dom.js";
import { kindOf, measured, number } from "./words.js";

export function details(flight, step) {
  if (!step) return el("section", { class: "facts" }, el("p", { class: "quiet" }, "No decision is in the log."));
  return el("section", { class: "facts" }, decided(flight, step), judged(flight, step), said(flight, step));
}

function decided(flight, step) {
  const who = flight.drones > 1 ? `, drone ${step.drone + 1}` : "";
  const tokens = step.tokens_in === undefined && step.tokens_out === undefined ? null : `${step.tokens_in ?? "?"} in, ${step.tokens_out ?? "?"} out`;
  return el(
    "div",
    { class: "decided" },
    el("h2", {}, `Step ${step.step}${who}`),
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

function judged(flight, step) {
  const at = step.truth;
  const seen = at && at.visible !== undefined ? (at.visible ? `yes${at.share === undefined ? "" : `, ${number(100 * at.share, 0)} % of it`}` : "no") : null;
  const verdict = at && at.qualifies !== undefined ? (at.qualifies ? "counts: near enough, and in view" : "does not count") : null;
  return el(
    "div",
    { class: "judge" },
    el("h3", {}, flight.estimated ? "The autopilot’s own estimate" : "The judge’s", el("span", { class: "tag" }, "the model never saw this")),
    at
      ? list([
          ["Distance", measured(at.distance, "m", 2)],
          ["… to its box", at.box === undefined ? null : measured(at.box, "m", 2)],
          ["In view", seen],
          ["Bearing", bearing(at.bearing)],
          ["True depth", at.depth === undefined ? null : measured(at.depth, "m", 2)],
          ["Declaration", verdict],
        ])
      : el("p", { class: "quiet" }, "This picture was not measured."),
  );
}

function bearing(degrees) {
  if (degrees === undefined) return null;
  const whole = Math.round(Math.abs(degrees));
  return whole ? `${whole}° ${degrees < 0 ? "left" : "right"}` : "ahead";
}

function said(flight, step) {
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
    flight.exchanges.map((each) =>
      el(
        "details",
        {},
        el(
          "summary",
          {},
          `${number(each.asked, 1)} s: ${each.causes.join(", ")} → ${summary(each)}`,
        ),
        el("button", { type: "button", class: "tool", onclick: () => move(each.asked) }, "Go to this time"),
        list([
          ["Model", each.model],
          ["Answered", measured(each.answered, "s", 2)],
          ["Latency", measured(each.latency, "s", 2)],
          ["Orders", each.orders.length ? each.orders.join("; ") : null],
          ["Confirms", each.confirms.length ? each.confirms.map((drone) => `drone ${drone + 1}`).join(", ") : null],
          ["Changed nothing", each.error],
        ]),
        each.reply === undefined ? null : el("pre", { tabindex: "0" }, each.reply),
        each.prompt === undefined ? null : el("details", { class: "prompt" }, el("summary", {}, "Prompt"), el("pre", { tabindex: "0" }, each.prompt)),
      ),
    ),
  );
}

function summary(each) {
  const words = [];
  if (each.orders.length) words.push(`${each.orders.length} ${each.orders.length > 1 ? "orders" : "order"}`);
  if (each.confirms.length) words.push(`confirms ${each.confirms.map((drone) => `drone ${drone + 1}`).join(", ")}`);
  return words.join(", ") || (each.reply === undefined ? "no reply in time" : "nothing");
}

export function list(pairs) {
  return el("dl", {}, pairs.filter(([, value]) => value !== null && value !== undefined).map(([name, value]) => el("div", {}, el("dt", {}, name), el("dd", {}, value))));
}
