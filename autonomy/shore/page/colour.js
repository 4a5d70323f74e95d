// Which colour map shows what, and the bar that says which colour means how much.

import { fixed, withUnit } from "./format.js";
import { roundTicks, stepDecimals } from "./ticks.js";

const MOST_SORTED = 20_000; // of so many cells the extremes are known well enough

let maps = null;

/** The tables that the server has: name → 256 × [r, g, b]. */
export function setColormaps(tables) {
  maps = tables;
}

/** Perceptually uniform and fit for the colour-blind: haline for salt, thermal for heat, viridis for the rest. */
export function mapNames(variable) {
  const name = String(variable ?? "");
  if (/salin/i.test(name)) return { mean: "haline", sd: "viridis" };
  if (/temperature/i.test(name)) return { mean: "thermal", sd: "viridis" };
  return { mean: "viridis", sd: "thermal" };
}

export const table = (name) => maps[name];

/** The values that the ends of the colours stand for, never closer together than makes sense; null without a map. */
export function rangeOf(values, fromZero) {
  const stride = Math.ceil(values.length / MOST_SORTED);
  const finite = values.filter((value, index) => index % stride === 0 && Number.isFinite(value)).sort();
  if (!finite.length) return null;
  // A handful of cells at the rim shall not take the colours from all the others.
  const at = (share) => finite[Math.min(finite.length - 1, Math.floor(share * finite.length))];
  let low = fromZero ? 0 : at(0.002);
  let high = at(0.998);
  if (!(high - low > 1e-6 * Math.max(Math.abs(high), 1e-6))) {
    const half = Math.max(Math.abs(high) * 1e-3, 1e-6);
    low = fromZero ? 0 : high - half;
    high += half;
  }
  return { low, high };
}

/** Cells as pixels: transparent where there is no number. */
export function paint(values, rows, columns, range, colours) {
  const image = new ImageData(columns, rows);
  const scale = 255.999 / (range.high - range.low);
  for (let cell = 0, byte = 0; cell < values.length; cell += 1, byte += 4) {
    const value = values[cell];
    if (value !== value) continue;
    const [r, g, b] = colours[Math.max(0, Math.min(255, Math.floor((value - range.low) * scale)))];
    image.data[byte] = r;
    image.data[byte + 1] = g;
    image.data[byte + 2] = b;
    image.data[byte + 3] = 255;
  }
  return image;
}

/** The ticks of a colour bar, which are also the contours of the map. */
export const levels = (range, wanted = 5) => roundTicks(range.low, range.high, wanted);

/** Draw the bar: a strip of colour, ticks below, `mark` (a value) as a notch. */
export function drawBar(canvas, range, colours, ink, mark) {
  const ratio = devicePixelRatio || 1;
  const width = canvas.clientWidth;
  const height = canvas.clientHeight;
  if (!width) return;
  canvas.width = Math.round(width * ratio);
  canvas.height = Math.round(height * ratio);
  const pen = canvas.getContext("2d");
  pen.scale(ratio, ratio);
  const strip = { left: 1, top: 4, width: width - 2, height: 9 };
  for (let x = 0; x < strip.width; x += 1) {
    const [r, g, b] = colours[Math.floor((x / strip.width) * 256)];
    pen.fillStyle = `rgb(${r} ${g} ${b})`;
    pen.fillRect(strip.left + x, strip.top, 1.5, strip.height);
  }
  const place = (value) => strip.left + ((value - range.low) / (range.high - range.low)) * strip.width;
  const { step, values } = levels(range, Math.max(2, Math.min(7, Math.floor(width / 46))));
  const decimals = stepDecimals(step);
  pen.fillStyle = ink;
  pen.strokeStyle = ink;
  pen.font = `11px ${getComputedStyle(canvas).fontFamily}`;
  pen.textBaseline = "top";
  for (const value of values) {
    const x = place(value);
    const text = fixed(value, decimals);
    const half = pen.measureText(text).width / 2;
    pen.fillRect(Math.round(x) - 0.5, strip.top + strip.height, 1, 4);
    pen.fillText(text, Math.max(0, Math.min(width - 2 * half, x - half)), strip.top + strip.height + 6);
  }
  if (mark !== null && Number.isFinite(mark)) {
    const x = Math.max(strip.left, Math.min(strip.left + strip.width, place(mark)));
    pen.beginPath();
    pen.moveTo(x, strip.top + 3);
    pen.lineTo(x - 4, strip.top - 4);
    pen.lineTo(x + 4, strip.top - 4);
    pen.fill();
  }
}

/** What the bar says to somebody who doesn't see it. */
export const barText = (title, units, range) => {
  const decimals = stepDecimals(levels(range).step) + 1;
  return `${withUnit(title, units)}: colours from ${fixed(range.low, decimals)} to ${fixed(range.high, decimals)}`;
};
