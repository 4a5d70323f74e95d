// What part of the sea is shown: shared by the maps of one vehicle, so that they pan and zoom together.
// Equirectangular about the middle of the survey: true to scale there, and lines of latitude are rows of cells.

const METRES_PER_DEGREE = 111_195;
const NEAREST = 4000; // how much closer than the whole survey one may look

// Degrees of longitude between two places, the short way round: also across the antimeridian.
const nearer = (degrees) => ((((degrees + 180) % 360) + 360) % 360) - 180;

export class View extends EventTarget {
  constructor() {
    super();
    this.home = null;
    this.lat = 0;
    this.lon = 0;
    this.metresPerPixel = 1;
    this.width = 1;
    this.height = 1;
    this.margins = { left: 0, right: 0, top: 0, bottom: 0 };
    this.atHome = true;
  }

  /** The survey area; the view stays where somebody has moved it, otherwise it shows the whole. */
  setHome(bounds) {
    const same = this.home && ["south", "west", "north", "east"].every((side) => this.home[side] === bounds[side]);
    if (same) return;
    this.home = bounds;
    this.cosine = Math.cos((((bounds.south + bounds.north) / 2) * Math.PI) / 180);
    this.whole();
  }

  /** Width by height of the survey, within what looks well on a page. */
  get aspect() {
    const { south, west, north, east } = this.home;
    return Math.min(2.2, Math.max(0.62, ((east - west) * this.cosine) / (north - south)));
  }

  resize(width, height, margins) {
    this.width = Math.max(1, width);
    this.height = Math.max(1, height);
    this.margins = margins;
    if (this.home && this.atHome) this.whole();
    else this.#changed();
  }

  whole() {
    if (!this.home) return;
    const { south, west, north, east } = this.home;
    this.lat = (south + north) / 2;
    this.lon = (west + east) / 2;
    this.metresPerPixel = this.#homeScale();
    this.atHome = true;
    this.#changed();
  }

  #homeScale() {
    const { south, west, north, east } = this.home;
    const { left, right, top, bottom } = this.margins;
    const across = ((east - west) * METRES_PER_DEGREE * this.cosine) / Math.max(40, this.width - left - right);
    const along = ((north - south) * METRES_PER_DEGREE) / Math.max(40, this.height - top - bottom);
    return Math.max(across, along);
  }

  get centreX() { return (this.width + this.margins.left - this.margins.right) / 2; }
  get centreY() { return (this.height + this.margins.top - this.margins.bottom) / 2; }

  x(lon) { return this.centreX + (nearer(lon - this.lon) * METRES_PER_DEGREE * this.cosine) / this.metresPerPixel; }
  y(lat) { return this.centreY - ((lat - this.lat) * METRES_PER_DEGREE) / this.metresPerPixel; }
  lonAt(x) { return this.lon + ((x - this.centreX) * this.metresPerPixel) / (METRES_PER_DEGREE * this.cosine); }
  latAt(y) { return this.lat - ((y - this.centreY) * this.metresPerPixel) / METRES_PER_DEGREE; }

  /** The degrees that are in sight. */
  window() {
    return { south: this.latAt(this.height), west: this.lonAt(0), north: this.latAt(0), east: this.lonAt(this.width) };
  }

  pan(dx, dy) {
    this.lon = this.#within(this.lonAt(this.centreX - dx), "west", "east");
    this.lat = this.#within(this.latAt(this.centreY - dy), "south", "north");
    this.atHome = false;
    this.#changed();
  }

  /** Zoom in (factor > 1) or out about a pixel that keeps its place. */
  zoom(factor, x = this.centreX, y = this.centreY) {
    const most = 3 * this.#homeScale();
    const lon = this.lonAt(x);
    const lat = this.latAt(y);
    this.metresPerPixel = Math.min(most, Math.max(most / (3 * NEAREST), this.metresPerPixel / factor));
    this.lon = this.#within(this.lon + lon - this.lonAt(x), "west", "east");
    this.lat = this.#within(this.lat + lat - this.latAt(y), "south", "north");
    this.atHome = false;
    this.#changed();
  }

  #within(degrees, low, high) {
    return Math.min(this.home[high], Math.max(this.home[low], degrees));
  }

  #changed() {
    this.dispatchEvent(new Event("change"));
  }
}
