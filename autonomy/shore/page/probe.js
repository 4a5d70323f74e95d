// Pointing at a place: the map's own value at once, the server's a moment later, beside the pointer.

import * as api from "./api.js";
import { element } from "./dom.js";
import { estimate, position } from "./format.js";

const ASK_MS = 120;

export class Probe {
  #timer = null;
  #asking = null;

  /** `state` is the panel's; `moved` is called when the place or its value has changed. */
  constructor(state, moved) {
    this.state = state;
    this.moved = moved;
    this.place = null;
    this.value = element("strong", { class: "probe-value" });
    this.where = element("span", { class: "probe-where" });
    this.tag = element("div", { class: "probe", hidden: true }, this.value, this.where);
    this.spoken = element("p", { class: "unseen", "aria-live": "polite" });
  }

  point(map, lat, lon, kind) {
    this.place = { lat, lon };
    this.map = map;
    this.kind = kind;
    if (this.tag.parentNode !== map.surface) map.surface.append(this.tag);
    this.refresh();
  }

  leave() {
    if (!this.place) return;
    this.#stop();
    this.place = null;
    this.tag.hidden = true;
    this.moved();
  }

  /** Another model, moment or place: show what the cells say, and ask for the exact value. */
  refresh() {
    if (!this.place) return;
    const { lat, lon } = this.place;
    const found = this.state.raster.value(lat, lon);
    this.where.textContent = position(lat, lon);
    if (found) this.#show(estimate(found.mean, found.sd, this.state.described().units), "map", found);
    else this.#show(this.state.raster.whole ? "no estimate here" : "no data yet", "none");
    this.#move();
    this.moved();
    this.#stop();
    if (this.state.model) this.#timer = setTimeout(() => this.#ask(lat, lon), ASK_MS);
  }

  async #ask(lat, lon) {
    this.#asking = new AbortController();
    try {
      const answer = await api.predict(this.state.vehicle, lat, lon, this.state.at(), this.#asking.signal);
      if (this.place?.lat !== lat || this.place.lon !== lon) return;
      if (answer.land) this.#show("land", "none");
      else if (answer.outside) this.#show("outside the survey", "none");
      else if (Number.isFinite(answer.mean)) this.#show(estimate(answer.mean, answer.sd, answer.units), "predict", answer);
      this.#move();
      if (this.kind !== "hover") this.spoken.textContent = `${this.value.textContent} at ${this.where.textContent}`;
    } catch {
      // What the map's cells say is on show already; the connection's state is told at the top of the page.
    }
  }

  /** The numbers behind the text stay with it: for those who script the page, and its tests. */
  #show(text, source, { mean, sd } = {}) {
    this.value.textContent = text;
    Object.assign(this.tag.dataset, { source, ...this.place, mean, sd, moment: this.state.at() });
    this.tag.hidden = false;
  }

  /** Beside the place, on the side where there is room. */
  #move() {
    const { view } = this.state;
    const x = view.x(this.place.lon);
    const y = view.y(this.place.lat);
    const { offsetWidth, offsetHeight } = this.tag;
    const left = x + 16 + offsetWidth > view.width ? x - 16 - offsetWidth : x + 16;
    const top = y + 16 + offsetHeight > view.height ? y - 16 - offsetHeight : y + 16;
    this.tag.style.left = `${Math.max(2, Math.min(view.width - offsetWidth - 2, left))}px`;
    this.tag.style.top = `${Math.max(2, top)}px`;
  }

  #stop() {
    clearTimeout(this.#timer);
    this.#asking?.abort();
  }
}
