// The way back in time: every model that the server has kept is a stop; at the end of it is now.

import { element, icon } from "./dom.js";
import { duration, utc } from "./format.js";

const PLAY_MS = 160;

/** Calls `moved(stamp)` with the stop that is shown, or null for the newest, whatever comes. */
export class Timeline {
  #stops = [];
  #stamp = null; // null: live
  #playing = null;

  constructor(name, moved) {
    this.moved = moved;
    this.slider = element("input", { type: "range", min: 0, max: 0, value: 0, class: "slider", "aria-label": `Time of ${name}'s map` });
    this.time = element("output", { class: "timeline-time" });
    this.note = element("span", { class: "timeline-note" });
    this.live = element("button", { type: "button", class: "live-button" }, element("span", { class: "live-dot" }), "Live");
    this.play = element("button", { type: "button", class: "icon-button" });
    this.element = element(
      "div", { class: "timeline", role: "group", "aria-label": "Time" },
      this.play, this.slider, element("div", { class: "timeline-text" }, this.time, this.note), this.live,
    );
    this.slider.addEventListener("input", () => {
      const index = Number(this.slider.value);
      this.#pause();
      this.#go(index);
    });
    this.live.addEventListener("click", () => { this.#pause(); this.#show(null); });
    this.play.addEventListener("click", () => (this.#playing ? this.#pause() : this.#start()));
    this.#draw();
  }

  get stamp() {
    return this.#stamp;
  }

  /** The stops as they are now. */
  update(stops) {
    this.#stops = stops;
    this.#draw();
  }

  /** Nobody will look any more. */
  dispose() {
    clearInterval(this.#playing);
  }

  #go(index) {
    this.#show(index >= this.#stops.length - 1 ? null : this.#stops[index]);
  }

  #show(stamp) {
    if (stamp === this.#stamp) return this.#draw();
    this.#stamp = stamp;
    this.#draw();
    this.moved(stamp);
  }

  #start() {
    let index = this.#index();
    if (index >= this.#stops.length - 1) index = -1;
    // However long the history, it passes in about half a minute.
    const step = Math.max(1, Math.round((this.#stops.length * PLAY_MS) / 30_000));
    this.#playing = setInterval(() => {
      index += step;
      this.#go(index);
      if (index >= this.#stops.length - 1) this.#pause();
    }, PLAY_MS);
    this.#draw();
  }

  #pause() {
    clearInterval(this.#playing);
    this.#playing = null;
    this.#draw();
  }

  #index() {
    if (this.#stamp === null) return this.#stops.length - 1;
    const after = this.#stops.findIndex((stop) => stop > this.#stamp + 1e-6);
    return after < 0 ? this.#stops.length - 1 : Math.max(0, after - 1);
  }

  #draw() {
    const newest = this.#stops.at(-1);
    const shown = this.#stamp ?? newest;
    this.slider.max = Math.max(0, this.#stops.length - 1);
    this.slider.value = this.#index();
    this.slider.disabled = this.play.disabled = this.#stops.length < 2;
    this.time.textContent = shown === undefined ? "no map yet" : `${utc(shown)} UTC`;
    const behind = this.#stamp === null ? null : `${duration(newest - this.#stamp)} before the newest`;
    this.element.classList.toggle("past", behind !== null);
    this.note.textContent = behind ?? (this.#stops.length ? `newest of ${this.#stops.length} maps` : "");
    this.slider.setAttribute("aria-valuetext", behind ? `${this.time.textContent}, ${behind}` : "live");
    this.live.setAttribute("aria-pressed", String(this.#stamp === null));
    const label = this.#playing ? "Pause" : "Play the history";
    if (this.play.getAttribute("aria-label") !== label) {
      this.play.replaceChildren(icon(this.#playing ? "pause" : "play"));
      this.play.setAttribute("aria-label", label);
      this.play.title = label;
    }
  }
}
