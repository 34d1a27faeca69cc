// The drones' pictures, each with a ring around the chosen point.

import { el } from "./dom.js";
import { number } from "./words.js";

export class Views {
  constructor(flight, side, choose) {
    this.flight = flight;
    const many = flight.drones > 1;
    this.placeholder = flight.rendered ? "No picture of this step is kept." : "Flown without pictures: the frames were grey.";
    this.views = Array.from({ length: flight.drones }, (_, drone) => this.view(drone, side, many, choose));
    this.element = el("div", { class: many ? "views fleet" : "views" }, this.views.map((view) => view.figure));
  }

  view(drone, side, many, choose) {
    const ring = el("div", { class: "ring", hidden: true, "aria-hidden": "true" });
    const nothing = el("p", { class: "nothing" });
    const image = el("img", { alt: "", decoding: "sync", onerror: () => this.failed(drone) });
    const picture = el("div", { class: "picture", style: { "aspect-ratio": this.flight.aspect } }, image, nothing, ring);
    const button = many
      ? el("button", { type: "button", class: `who d${drone % 8}`, onclick: () => choose(drone) }, `Drone ${drone + 1}`)
      : null;
    const words = el("span", { class: "words" });
    const caption = el("figcaption", {}, side ? el("b", { class: `side ${side}` }, side.toUpperCase()) : null, button, words);
    const figure = el("figure", { class: "view" }, picture, caption);
    if (many) picture.addEventListener("click", () => choose(drone));
    return { figure, image, ring, nothing, button, words };
  }

  failed(drone) {
    const { image, nothing } = this.views[drone];
    image.hidden = true;
    nothing.hidden = false;
    nothing.textContent = "The picture is not where this page looks for it.";
  }

  // newest: the decision of each drone; now: the shown step; chosen: the drone whose facts are shown
  show(newest, now, chosen) {
    this.views.forEach((view, drone) => {
      const step = newest[drone];
      view.figure.classList.toggle("earlier", Boolean(step) && step.step !== now);
      view.figure.classList.toggle("chosen", this.flight.drones > 1 && drone === chosen);
      if (view.button) view.button.setAttribute("aria-pressed", String(drone === chosen));
      this.look(view, step);
    });
  }

  look(view, step) {
    const { image, ring, nothing, words } = view;
    const picture = step && step.picture;
    if (picture && image.getAttribute("src") !== picture) image.src = picture;
    if (!picture) image.removeAttribute("src");
    image.hidden = !picture;
    nothing.hidden = Boolean(picture);
    nothing.textContent = step ? this.placeholder : "No decision of this drone.";
    image.alt = step ? `What drone ${step.drone + 1} saw at ${number(step.t, 1)} s` : "";
    const point = step && step.action && step.action.action === "go" ? step.action.point : null;
    ring.hidden = !point;
    if (point) {
      ring.style.setProperty("left", `${point[0] / 10}%`);
      ring.style.setProperty("top", `${point[1] / 10}%`);
    }
    words.textContent = step ? `Step ${step.step} · ${number(step.t, 1)} s · ${step.does}` : "";
  }
}
