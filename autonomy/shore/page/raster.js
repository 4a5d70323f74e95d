// The map's cells: asked for at the resolution of the zoom, kept until better ones have come.

import * as api from "./api.js";

const PIXELS_PER_CELL = 2;
const MOST_CELLS = 360; // along a side
const SETTLE_MS = 140;
const RETRY_MS = 3000;
const MARGIN = 0.08; // beyond the edge, so that a small pan shows no seam

/** Fetches what a view shows of one vehicle at a time; at most one request is under way, the newest wish wins. */
export class Raster extends EventTarget {
  #timer = null;
  #flying = false;
  #again = false;
  #over = new AbortController();

  constructor(vehicle, view) {
    super();
    this.vehicle = vehicle;
    this.view = view;
    this.at = "now";
    this.whole = null; // the survey at low resolution: behind a pan, and for the colours' range
    this.part = null; // what is in sight
    this.shown = null; // the moment that both are of
    this.problem = null;
  }

  /** A new model, or another moment: everything anew. */
  refresh(at = this.at) {
    this.at = at;
    this.#wish(0);
  }

  /** The view has moved. */
  moved() {
    this.#wish(SETTLE_MS);
  }

  /** Nobody will look any more. */
  dispose() {
    this.#over.abort();
    clearTimeout(this.#timer);
  }

  #wish(delay) {
    if (!this.view.home || this.#over.signal.aborted) return;
    clearTimeout(this.#timer);
    this.#timer = setTimeout(() => this.#go(), delay);
  }

  async #go() {
    if (this.#flying) {
      this.#again = true;
      return;
    }
    this.#flying = true;
    const at = this.at;
    try {
      // Shown even if another moment has been wished for meanwhile: a history that is played would stand still.
      Object.assign(this, await this.#fetch(at), { shown: at, problem: null });
    } catch (error) {
      this.problem = error;
      this.#wish(RETRY_MS);
    }
    this.#flying = false;
    this.dispatchEvent(new Event("change"));
    if (this.#again) {
      this.#again = false;
      this.#wish(0);
    }
  }

  async #fetch(at) {
    const { home, atHome, width, height } = this.view;
    const { signal } = this.#over;
    const wide = (home.east - home.west) * this.view.cosine;
    const high = home.north - home.south;
    const side = atHome ? MOST_CELLS : 120;
    const most = Math.min(side, Math.ceil(Math.max(width, height) / (atHome ? PIXELS_PER_CELL : 4)));
    const scale = most / Math.max(wide, high);
    const whole = await api.map(this.vehicle, at, home, cells(high * scale), cells(wide * scale), signal);
    if (atHome) return { whole, part: null };
    const window = inside(widened(this.view.window()), home);
    if (!window) return { whole, part: null };
    const columns = Math.abs(this.view.x(window.east) - this.view.x(window.west)) / PIXELS_PER_CELL;
    const rows = Math.abs(this.view.y(window.south) - this.view.y(window.north)) / PIXELS_PER_CELL;
    return { whole, part: await api.map(this.vehicle, at, window, cells(rows), cells(columns), signal) };
  }

  /** The drawn value at a place, between the four cells about it; null where there is none. */
  value(lat, lon) {
    for (const cells of [this.part, this.whole]) {
      const found = cells && between(cells, lat, lon);
      if (found) return found;
    }
    return null;
  }
}

const cells = (wanted) => Math.max(2, Math.min(MOST_CELLS, Math.round(wanted)));

function widened({ south, west, north, east }) {
  const dy = MARGIN * (north - south);
  const dx = MARGIN * (east - west);
  return { south: south - dy, west: west - dx, north: north + dy, east: east + dx };
}

function inside(a, b) {
  const window = {
    south: Math.max(a.south, b.south), west: Math.max(a.west, b.west),
    north: Math.min(a.north, b.north), east: Math.min(a.east, b.east),
  };
  return window.north > window.south && window.east > window.west ? window : null;
}

function between({ window, rows, columns, mean, sd }, lat, lon) {
  const x = ((lon - window.west) / (window.east - window.west)) * columns - 0.5;
  const y = ((window.north - lat) / (window.north - window.south)) * rows - 0.5;
  if (x < -0.5 || y < -0.5 || x > columns - 0.5 || y > rows - 0.5) return null;
  const left = Math.max(0, Math.min(columns - 2, Math.floor(x)));
  const top = Math.max(0, Math.min(rows - 2, Math.floor(y)));
  const mixed = (values) => {
    let sum = 0;
    let weight = 0;
    for (const [row, column] of [[top, left], [top, left + 1], [top + 1, left], [top + 1, left + 1]]) {
      const share = Math.max(0, 1 - Math.abs(x - column)) * Math.max(0, 1 - Math.abs(y - row));
      const value = values[row * columns + column];
      if (value === value) { sum += share * value; weight += share; }
    }
    return weight > 0.3 ? sum / weight : NaN;
  };
  const found = { mean: mixed(mean), sd: mixed(sd) };
  return Number.isFinite(found.mean) ? found : null;
}
