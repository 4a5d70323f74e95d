// One map on a canvas: the mean or the standard deviation, with all that lies over it, and its colour bar.

import { barText, drawBar, levels, mapNames, paint, rangeOf, table } from "./colour.js";
import { contour } from "./contours.js";
import { element, themed } from "./dom.js";
import { unitText, withUnit } from "./format.js";
import { listen } from "./gestures.js";
import * as overlay from "./overlay.js";

const MARGINS = { left: overlay.FRAME.left + 10, right: 10, top: 10, bottom: overlay.FRAME.bottom + 10 };

export class FieldMap {
  #frame = 0;
  #pictures = new Map();

  /** `quantity` is "mean" or "sd"; `state` (of the panel) says what to draw, `probe` is told where one points. */
  constructor(quantity, state, probe, tools = null) {
    this.quantity = quantity;
    this.state = state;
    this.range = null;
    this.title = element("h3", { class: "map-title" }, quantity === "mean" ? "Nowcast" : "Uncertainty");
    this.unit = element("span", { class: "map-unit" });
    this.canvas = element("canvas", { class: "map-canvas", "aria-hidden": "true" });
    this.notice = element("p", { class: "map-notice", role: "status" });
    this.surface = element(
      "div",
      { class: "surface", tabindex: "0", role: "application", "aria-roledescription": "map", "data-quantity": quantity },
      this.canvas,
      this.notice,
    );
    this.bar = element("canvas", { class: "bar", role: "img" });
    this.element = element(
      "section",
      { class: "map" },
      element("div", { class: "map-head" }, this.title, this.unit),
      element("div", { class: "map-frame" }, this.surface, tools),
      this.bar,
    );
    listen(this.surface, state.view, (x, y, kind) => {
      if (x === null) probe.leave();
      else probe.point(this, state.view.latAt(y), state.view.lonAt(x), kind);
    });
    new ResizeObserver(() => this.#resized()).observe(this.surface);
    state.view.addEventListener("change", () => this.draw());
    state.raster.addEventListener("change", () => this.fresh());
  }

  #resized() {
    const { clientWidth, clientHeight } = this.surface;
    if (!clientWidth) return;
    const ratio = devicePixelRatio || 1;
    this.canvas.width = Math.round(clientWidth * ratio);
    this.canvas.height = Math.round(clientHeight * ratio);
    // Both maps are of one size; the first to know tells the view.
    this.state.view.resize(clientWidth, clientHeight, MARGINS);
    this.draw();
  }

  /** New cells have come, or the theme or the variable has changed. */
  fresh() {
    const { raster } = this.state;
    this.#pictures.clear();
    if (raster.whole) this.range = rangeOf(raster.whole[this.quantity], this.quantity === "sd");
    this.#words();
    this.draw();
  }

  #words() {
    const { variable, longName, units } = this.state.described();
    const title = this.quantity === "mean" ? longName : `standard deviation of ${longName}`;
    this.unit.textContent = this.quantity === "mean" ? withUnit(longName, units) : withUnit("standard deviation", units);
    this.colours = table(mapNames(variable)[this.quantity]);
    this.surface.setAttribute(
      "aria-label",
      `Map of the ${title}. Arrow keys move it, plus and minus zoom, 0 shows all; the value in its middle is read out.`,
    );
    this.bar.setAttribute("aria-label", this.range ? barText(title, unitText(units), this.range) : "no colours yet");
  }

  /** As high as the survey is, for its width. */
  shape(aspect) {
    this.surface.style.setProperty("--aspect", aspect.toFixed(3));
  }

  draw() {
    if (!this.#frame) this.#frame = requestAnimationFrame(() => {
      this.#frame = 0;
      this.#paint();
    });
  }

  #paint() {
    const { view, raster, probe } = this.state;
    this.notice.textContent = this.state.notice();
    this.notice.hidden = !this.notice.textContent;
    const pen = this.canvas.getContext("2d");
    const ratio = devicePixelRatio || 1;
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.fillStyle = themed("--water");
    pen.fillRect(0, 0, view.width, view.height);
    if (!view.home) return;
    const font = `11px ${getComputedStyle(this.canvas).fontFamily}`;
    pen.save();
    pen.beginPath();
    pen.rect(overlay.FRAME.left, 0, view.width - overlay.FRAME.left, view.height - overlay.FRAME.bottom);
    pen.clip();
    if (this.range && this.colours)
      for (const cells of [raster.whole, raster.part]) if (cells) this.#drawCells(pen, cells);
    this.#drawOver(pen, font);
    pen.restore();
    overlay.drawGraticule(pen, view, font);
    if (this.range && this.colours) {
      const mark = probe.place ? raster.value(probe.place.lat, probe.place.lon)?.[this.quantity] : null;
      drawBar(this.bar, this.range, this.colours, themed("--ink-soft"), mark ?? null);
    }
    this.canvas.dataset.drawn = this.range ? String(raster.shown) : "";
  }

  #drawCells(pen, cells) {
    const { view, layers } = this.state;
    let picture = this.#pictures.get(cells);
    if (!picture) {
      picture = new OffscreenCanvas(cells.columns, cells.rows);
      const image = paint(cells[this.quantity], cells.rows, cells.columns, this.range, this.colours);
      picture.getContext("2d").putImageData(image, 0, 0);
      this.#pictures.set(cells, picture);
    }
    const { window } = cells;
    const left = view.x(window.west);
    const top = view.y(window.north);
    const width = view.x(window.east) - left;
    const height = view.y(window.south) - top;
    pen.imageSmoothingEnabled = true;
    pen.imageSmoothingQuality = "high";
    pen.drawImage(picture, left, top, width, height);
    // Where a sharper part will be drawn over it, its contours are the part's.
    const covered = cells === this.state.raster.whole && this.state.raster.part;
    if (layers.contours && this.quantity === "mean" && !covered) this.#drawContours(pen, cells, left, top, width, height);
  }

  #drawContours(pen, { mean, rows, columns }, left, top, width, height) {
    const dx = width / columns;
    const dy = height / rows;
    pen.beginPath();
    for (const level of levels(this.range, 8).values)
      contour(mean, rows, columns, level, (x1, y1, x2, y2) => {
        pen.moveTo(left + (x1 + 0.5) * dx, top + (y1 + 0.5) * dy);
        pen.lineTo(left + (x2 + 0.5) * dx, top + (y2 + 0.5) * dy);
      });
    pen.strokeStyle = "rgb(6 16 26 / 34%)";
    pen.lineWidth = 0.9;
    pen.stroke();
  }

  #drawOver(pen, font) {
    const { view, layers, probe } = this.state;
    const { survey, plan, basis, track, vessel } = this.state.overlay();
    overlay.drawLand(pen, view, survey);
    overlay.drawGridLines(pen, view);
    if (layers.limits) overlay.drawLimits(pen, view, survey);
    if (layers.basis) overlay.drawBasis(pen, view, basis);
    if (layers.track) overlay.drawTrack(pen, view, track);
    if (layers.plan && plan) overlay.drawPlan(pen, view, plan);
    overlay.drawScale(pen, view, font);
    if (vessel) overlay.drawVessel(pen, view, vessel);
    if (probe.place) overlay.drawCross(pen, view, probe.place);
  }
}
