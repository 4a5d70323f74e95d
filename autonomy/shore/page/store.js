// What the page knows of each vehicle: asked for once, then kept up to date by the news.

import * as api from "./api.js";

const TRACK_ROWS = 4000;
const LOG_LINES = 200;
const SERIES_ROWS = 3000; // then the server is asked for its thinner ones

/** One vehicle. Dispatches "change"; `detail` is what has changed: "all", "model", "plan", "health", … */
export class Vehicle extends EventTarget {
  #loading = null;
  #waiting = null;
  #meanwhile = []; // news that came while everything was on its way, which may be from before them

  constructor(name) {
    super();
    this.name = name;
    this.summary = null;
    this.heard = null; // ms of this page's clock when it was last heard
    this.survey = this.model = this.plan = this.health = this.history = null;
    this.track = [];
    this.log = [];
  }

  /** Everything there is; also after the line was broken, for what was missed. Asked for anew if it is on its way:
   *  what comes may be from before what was missed. */
  load() {
    const before = this.#loading;
    if (this.#waiting) return this.#waiting;
    if (before) {
      this.#waiting = before.catch(() => {}).then(() => { this.#waiting = null; return this.load(); });
      return this.#waiting;
    }
    this.#loading = this.#fetch().finally(() => { this.#loading = null; });
    return this.#loading;
  }

  async #fetch() {
    this.#meanwhile = [];
    const [all, history] = await Promise.all([api.latest(this.name), api.history(this.name)]);
    const { survey, model, plan, health, track, log } = all;
    Object.assign(this, { survey, model, plan, health, track: track.filter(placed), log, history });
    for (const [kind, data] of this.#meanwhile) this.#accept(kind, this.#fresh(kind, data));
    this.#meanwhile = [];
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
    // Should the first answer have failed, this is the time to ask again.
    if (this.#loading) this.#meanwhile.push([kind, data]);
    if (!this.history) this.load().catch(() => {});
    else if (this.#accept(kind, data)) this.#tell(kind);
  }

  /** What of a piece of news is not in the answer that it met on its way. */
  #fresh(kind, data) {
    if (kind === "observations") {
      const known = new Set(this.track.map(([t, lat, lon]) => `${t} ${lat} ${lon}`));
      return data.filter(([t, lat, lon]) => !known.has(`${t} ${lat} ${lon}`));
    }
    if (kind === "log") return [data].flat().filter((line) => !this.log.some((each) => each.utc_s === line.utc_s && each.text === line.text));
    const held = this[kind];
    return held && stamp(held) > stamp(data) ? held : data;
  }

  #accept(kind, data) {
    if (kind === "model") this.#acceptModel(data);
    else if (kind === "plan") this.#acceptPlan(data);
    else if (kind === "health") this.health = data;
    else if (kind === "survey") this.survey = data;
    else if (kind === "observations") this.track = thinned([...this.track, ...data.filter(placed)]);
    else if (kind === "log") this.log = [...this.log, ...[data].flat()].slice(-LOG_LINES);
    else return false;
    return true;
  }

  #acceptModel(model) {
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

  #acceptPlan(plan) {
    const { utc_s, mutual_information, planner, reason, expected_rmse } = plan;
    this.plan = plan;
    if (this.history.plans.at(-1)?.utc_s === utc_s) return;
    this.history.plans.push({ utc_s, mutual_information, planner, reason, expected_rmse });
  }

  #tell(kind) {
    this.dispatchEvent(new CustomEvent("change", { detail: kind }));
  }
}

const stamp = ({ stamp_s, utc_s }) => stamp_s ?? utc_s ?? 0;
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
