// What the page knows of each vehicle: asked for once, then kept up to date by the news.

import * as api from "./api.js";

const TRACK_ROWS = 4000;
const LOG_LINES = 200;
const SERIES_ROWS = 3000; // then the server is asked for its thinner ones

/** One vehicle. Dispatches "change"; `detail` is what has changed: "all", "model", "plan", "health", … */
export class Vehicle extends EventTarget {
  #loading = null;

  constructor(name) {
    super();
    this.name = name;
    this.summary = null;
    this.heard = null; // ms of this page's clock when it was last heard
    this.survey = this.model = this.plan = this.health = this.history = null;
    this.track = [];
    this.log = [];
  }

  /** Everything there is; also after the line was broken, for what was missed. */
  load() {
    this.#loading ??= this.#fetch().finally(() => { this.#loading = null; });
    return this.#loading;
  }

  async #fetch() {
    const [all, history] = await Promise.all([api.latest(this.name), api.history(this.name)]);
    const { survey, model, plan, health, track, log } = all;
    Object.assign(this, { survey, model, plan, health, track: track.filter(placed), log, history });
    this.#tell("all");
  }

  summarise(summary) {
    const before = this.summary;
    this.summary = summary;
    this.heard = summary.age_s === null ? null : Date.now() - 1000 * summary.age_s;
    if (before?.alive !== summary.alive || before?.state !== summary.state) this.#tell("summary");
  }

  get alive() {
    return this.summary?.alive ?? false;
  }

  /** Seconds since anything came from it. */
  get age() {
    return this.heard === null ? null : Math.max(0, (Date.now() - this.heard) / 1000);
  }

  take(kind, data) {
    this.heard = Date.now();
    // News that overtake the first answer are in it; and should it have failed, they are the time to ask again.
    if (!this.history) {
      this.load().catch(() => {});
      return;
    }
    if (kind === "model") this.#takeModel(data);
    else if (kind === "plan") this.#takePlan(data);
    else if (kind === "health") this.health = data;
    else if (kind === "survey") this.survey = data;
    else if (kind === "observations") this.track = thinned([...this.track, ...data.filter(placed)]);
    else if (kind === "log") this.log = [...this.log, ...(Array.isArray(data) ? data : [data])].slice(-LOG_LINES);
    else return;
    this.#tell(kind);
  }

  #takeModel(model) {
    const first = !this.model || !this.survey;
    this.model = model;
    const { models, series } = this.history;
    if (!(model.stamp_s > (models.at(-1) ?? -Infinity))) return;
    models.push(model.stamp_s);
    series.utc_s.push(model.stamp_s);
    series.model_time_s.push(model.model_time_s);
    series.rho.push(model.rho);
    series.basis_size.push(model.basis.length);
    series.lengthscales_m.push(model.kernel.flatMap((each) => each.lengthscales_m));
    series.noise_sd.push(model.noise_sd);
    series.samples.push(model.samples);
    if (first || series.utc_s.length > SERIES_ROWS) this.load().catch(() => {});
  }

  #takePlan(plan) {
    const { utc_s, mutual_information, planner, reason, expected_rmse } = plan;
    this.plan = plan;
    this.history.plans.push({ utc_s, mutual_information, planner, reason, expected_rmse });
  }

  #tell(kind) {
    this.dispatchEvent(new CustomEvent("change", { detail: kind }));
  }
}

const placed = ([, lat, lon]) => Number.isFinite(lat) && Number.isFinite(lon);

/** Of too long a track every second row goes, the newest hundred excepted. */
function thinned(track) {
  if (track.length <= TRACK_ROWS) return track;
  const old = track.slice(0, -100);
  return [...old.filter((_, index) => index % 2 === 0), ...track.slice(-100)];
}

/** All vehicles by name, in the order of the server's list. Dispatches "list". */
export class Fleet extends EventTarget {
  vehicles = new Map();

  get(name) {
    if (!this.vehicles.has(name)) this.vehicles.set(name, new Vehicle(name));
    return this.vehicles.get(name);
  }

  list(summaries) {
    const known = new Set(summaries.map((each) => each.vehicle));
    for (const name of this.vehicles.keys()) if (!known.has(name)) this.vehicles.delete(name);
    for (const summary of summaries) this.get(summary.vehicle).summarise(summary);
    this.dispatchEvent(new Event("list"));
  }

  take({ type, vehicle, data }) {
    if (type === "vehicles") this.list(data);
    else if (typeof vehicle === "string") this.get(vehicle).take(type, data);
  }
}
