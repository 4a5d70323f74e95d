// One vehicle: its two maps, the way back in time, the charts and the details.

import { Cards, figures, planText } from "./cards.js";
import { Charts } from "./series.js";
import { element, icon } from "./dom.js";
import { FieldMap } from "./map.js";
import { presence } from "./fleet.js";
import { duration, sentence } from "./format.js";
import { Legend } from "./legend.js";
import { Probe } from "./probe.js";
import { Raster } from "./raster.js";
import { Timeline } from "./slider.js";
import { View } from "./view.js";
import { stateLevel } from "./words.js";

const QUIET_S = 30; // so long nothing came: said, though the line may stand

export class Panel {
  #due = new Set();

  constructor(vehicle, close) {
    this.vehicle = vehicle;
    this.view = new View();
    this.raster = new Raster(vehicle.name, this.view);
    const state = this.state = {
      vehicle: vehicle.name, view: this.view, raster: this.raster,
      layers: { contours: true, limits: true, track: true, plan: true, basis: true },
      described: () => this.#described(), overlay: () => this.#overlay(), notice: () => this.#notice(),
      at: () => this.#at(),
      get model() { return vehicle.model; },
    };
    state.probe = this.probe = new Probe(state, () => this.#redraw());
    this.maps = [new FieldMap("mean", state, this.probe, this.#tools()), new FieldMap("sd", state, this.probe)];
    this.timeline = new Timeline(vehicle.name, () => this.#momentChanged());
    this.legend = new Legend(state.layers, () => this.#redraw());
    this.charts = new Charts(vehicle.name);
    this.cards = new Cards(vehicle.name);
    this.#build(close);
    this.view.addEventListener("change", () => { this.raster.moved(); this.#fitLegend(); });
    this.raster.addEventListener("change", () => this.probe.refresh());
    this.listener = (event) => this.#changed(event.detail);
    vehicle.addEventListener("change", this.listener);
    vehicle.load().catch(() => this.#changed("all"));
    this.#changed("all");
  }

  #build(close) {
    this.dot = element("span", { class: "panel-presence" });
    this.badge = element("span", { class: "badge" });
    this.reason = element("span", { class: "reason" });
    this.figures = element("dl", { class: "figures" });
    this.alert = element("p", { class: "alert", role: "status", hidden: true });
    this.plan = element("p", { class: "plan-text" });
    this.close = element("button", { type: "button", class: "icon-button", "aria-label": `Close ${this.vehicle.name}`, title: "Close", onclick: close }, icon("close"));
    this.element = element(
      "article", { class: "panel", "aria-label": this.vehicle.name, "data-vehicle": this.vehicle.name },
      element("header", { class: "panel-head" },
        element("div", { class: "who" }, this.dot, element("h2", {}, this.vehicle.name), this.badge, this.reason), this.figures, this.close),
      this.alert,
      element("div", { class: "panel-body" },
        element("div", { class: "stage" },
          element("div", { class: "maps" }, ...this.maps.map((map) => map.element)),
          element("div", { class: "below-maps" }, this.legend.element, this.plan),
          this.timeline.element, this.charts.element, this.probe.spoken),
        this.cards.element, this.cards.logElement),
    );
  }

  #tools() {
    const tool = (name, label, act) => element("button", { type: "button", class: "icon-button", "aria-label": label, title: label, onclick: act }, icon(name));
    return element("div", { class: "tools", role: "group", "aria-label": "Zoom of both maps" },
      tool("plus", "Zoom in", () => this.view.zoom(1.6)), tool("minus", "Zoom out", () => this.view.zoom(1 / 1.6)),
      tool("whole", "Show the whole survey", () => this.view.whole()));
  }

  /** Gone from the page. */
  dispose() {
    this.vehicle.removeEventListener("change", this.listener);
    this.charts.dispose();
    this.raster.dispose();
    this.timeline.dispose();
    this.element.remove();
  }

  restyle() {
    for (const map of this.maps) map.fresh();
    this.charts.restyle();
  }

  /** Once a second, and when the line breaks. */
  tick(alone) {
    this.close.hidden = alone;
    const { alive, age, summary, health } = this.vehicle;
    let text = "";
    if (summary && !alive) text = `Link lost: nothing from ${this.vehicle.name} for ${duration(age)}. What is shown is the last that came.`;
    else if (age !== null && age > QUIET_S) text = `Nothing new for ${duration(age)}.`;
    else if (health && !health.link_ok) text = "The software on board does not hear the autopilot.";
    this.alert.textContent = text;
    this.alert.hidden = !text;
    this.alert.classList.toggle("grave", Boolean(summary) && !alive);
  }

  // Several news within a frame cost one drawing.
  #changed(kind) {
    if (!this.#due.size) requestAnimationFrame(() => { const due = this.#due; this.#due = new Set(); this.#apply(due); });
    this.#due.add(kind);
  }

  #apply(due) {
    const has = (...kinds) => due.has("all") || kinds.some((kind) => due.has(kind));
    const { survey, model, health, plan, log, history } = this.vehicle;
    if (survey?.bounds && has("survey", "model")) {
      this.view.setHome(survey.bounds);
      for (const map of this.maps) map.shape(this.view.aspect);
    }
    if (has("model") && model && this.timeline.stamp === null) this.raster.refresh("now");
    if (has("model") && history) this.timeline.update(history.models);
    if (has("model", "plan", "survey") && history) this.#drawCharts();
    if (has("model", "survey")) this.cards.showModel(model, this.#described().units);
    if (has("health")) this.cards.showHealth(health);
    if (has("log")) this.cards.showLog(log);
    if (has("plan", "model")) this.plan.textContent = planText(plan, this.#described().units) ?? "No plan yet.";
    this.#head();
    this.#redraw();
  }

  #head() {
    const { alive, summary, health, model, survey, history } = this.vehicle;
    const state = health?.state ?? summary?.state;
    this.dot.replaceChildren(presence(alive));
    this.badge.textContent = state ?? "no state yet";
    this.badge.className = `badge ${stateLevel(state)}`;
    this.reason.textContent = health?.reason ?? summary?.reason ?? "";
    this.figures.replaceChildren(...figures({ model, health, survey, plans: history?.plans.length }).map(([name, value]) =>
      element("div", {}, element("dt", {}, name), element("dd", {}, value))));
  }

  #drawCharts() {
    const { history, survey } = this.vehicle;
    const { series, plans } = history;
    const rho0 = survey?.rho0 ?? series.rho0 ?? null;
    this.charts.update({ series, plans, rho0, capacity: survey?.capacity ?? this.vehicle.model?.capacity ?? null, units: this.#described().units }, this.timeline.stamp);
  }

  #momentChanged() {
    this.raster.refresh(this.#at());
    if (this.vehicle.history) this.#drawCharts();
    this.#redraw();
  }

  #at() {
    return this.timeline.stamp === null ? "now" : String(this.timeline.stamp);
  }

  #described() {
    const { survey, model, summary } = this.vehicle;
    const variable = survey?.variable ?? model?.variable ?? summary?.variable ?? "";
    return { variable, longName: sentence(survey?.long_name || variable), units: survey?.units ?? model?.units ?? "1" };
  }

  #overlay() {
    const { survey, model, plan, track, health, alive, history } = this.vehicle;
    const stamp = this.timeline.stamp;
    const live = stamp === null;
    const sailed = live ? track : track.filter((row) => row[0] <= this.#vehicleTime(stamp, history));
    const last = sailed.at(-1);
    let vessel = null;
    if (live && health?.lat_deg !== null && health?.lat_deg !== undefined)
      vessel = { lat: health.lat_deg, lon: health.lon_deg, heading: health.heading_deg ?? NaN, heard: alive };
    else if (last) vessel = { lat: last[1], lon: last[2], heading: NaN, heard: live && alive };
    // Of the past only the newest plan and basis vectors are known; drawn over an older map they would mislead.
    return { survey: survey ?? {}, basis: (live && model?.basis) || [], plan: live ? plan : null, track: sailed, vessel };
  }

  /** The vehicle's own clock at one of the stops. */
  #vehicleTime(stamp, { series }) {
    const index = series.utc_s.findLastIndex((each) => each <= stamp + 1e-6);
    return series.model_time_s[Math.max(0, index)];
  }

  #notice() {
    const { model, summary } = this.vehicle;
    if (this.raster.whole) return "";
    if (this.raster.problem && model) return "The map could not be fetched; trying again.";
    if (!model) return summary?.alive === false ? "No data yet, and no link." : "No data yet: the first map comes once the probe's readings are learnt.";
    return "Drawing …";
  }

  #fitLegend() {
    this.legend.update(this.vehicle, this.timeline.stamp === null);
  }

  #redraw() {
    this.#fitLegend();
    for (const map of this.maps) map.draw();
  }
}
