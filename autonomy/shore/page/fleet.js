// The list of all vehicles: which are there, how they are, and which of them are on show.

import { drawing, element, icon } from "./dom.js";
import { count, duration, sentence } from "./format.js";
import { stateLevel } from "./words.js";

const FILTER_FROM = 10; // with fewer vehicles one finds one's own without

/** A filled disc for a vehicle that is there, a ring for one that isn't: not by colour alone. */
export const presence = (alive) => drawing("0 0 10 10", [
  ["circle", { cx: 5, cy: 5, r: alive ? 4 : 3.2, fill: alive ? "currentColor" : "none", stroke: "currentColor", "stroke-width": alive ? 0 : 1.6 }],
], { class: alive ? "presence there" : "presence gone" });

export class FleetList {
  #rows = new Map();

  /** `choose(name, beside)` is called with what somebody wants to see, alone or beside the others. */
  constructor(box, fleet, choose) {
    this.fleet = fleet;
    this.choose = choose;
    this.shown = [];
    this.count = element("span", { class: "fleet-count" });
    this.filter = element("input", { type: "search", class: "fleet-filter", placeholder: "Find a vehicle", "aria-label": "Find a vehicle", autocomplete: "off", hidden: true });
    this.list = element("ul", { class: "fleet-list" });
    this.filter.addEventListener("input", () => this.draw());
    box.append(element("h2", { class: "fleet-title" }, "Fleet ", this.count), this.filter, this.list);
  }

  draw() {
    const { vehicles } = this.fleet;
    const wanted = this.filter.value.trim().toLowerCase();
    this.filter.hidden = vehicles.size < FILTER_FROM;
    const heard = [...vehicles.values()].filter((each) => each.alive).length;
    this.count.textContent = vehicles.size ? `${heard} of ${vehicles.size} connected` : "";
    for (const [name, row] of this.#rows) if (!vehicles.has(name)) { row.element.remove(); this.#rows.delete(name); }
    if (!vehicles.size) this.list.replaceChildren(element("li", { class: "nothing" }, "No vehicle has been heard of yet."));
    else this.list.querySelector(".nothing")?.remove();
    for (const vehicle of vehicles.values()) {
      const row = this.#row(vehicle.name);
      row.element.hidden = Boolean(wanted) && !vehicle.name.toLowerCase().includes(wanted);
      this.#fill(row, vehicle);
    }
  }

  #row(name) {
    if (this.#rows.has(name)) return this.#rows.get(name);
    const row = {
      presence: element("span", { class: "fleet-presence" }), state: element("span", { class: "fleet-state" }),
      detail: element("span", { class: "fleet-detail" }), age: element("span", { class: "fleet-age" }),
    };
    row.button = element("button", { type: "button", class: "fleet-row", onclick: (event) => this.choose(name, event.ctrlKey || event.metaKey) },
      row.presence, element("b", { class: "fleet-name" }, name), row.age, row.state, row.detail);
    row.beside = element("button", { type: "button", class: "icon-button beside", onclick: () => this.choose(name, true) }, icon("columns"));
    row.element = element("li", { class: "fleet-item" }, row.button, row.beside);
    this.#rows.set(name, row);
    this.list.append(row.element);
    return row;
  }

  #fill(row, { name, summary, alive, age }) {
    const shown = this.shown.includes(name);
    row.button.setAttribute("aria-pressed", String(shown));
    row.beside.setAttribute("aria-pressed", String(shown));
    row.beside.hidden = this.fleet.vehicles.size < 2 || (shown && this.shown.length < 2);
    const words = shown && this.shown.length > 1 ? `Close ${name}` : `Show ${name} side by side`;
    row.beside.setAttribute("aria-label", words);
    row.beside.title = words;
    if (row.alive !== alive) row.presence.replaceChildren(presence(alive));
    row.alive = alive;
    row.state.className = `fleet-state ${alive ? stateLevel(summary?.state) : "bad"}`;
    row.state.textContent = alive ? (summary?.state ?? "connected") : "link lost";
    row.age.textContent = age === null ? "" : duration(age);
    row.age.title = "since anything came";
    row.detail.textContent = summary?.variable
      ? `${sentence(summary.variable)} · ${count(summary.samples)} samples`
      : "no data yet";
  }
}
