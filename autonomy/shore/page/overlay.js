// What lies over the colours of a map: land, area, fence, graticule, track, plan, basis vectors, vessel, scale.

import { themed } from "./dom.js";
import { distance, latitude, longitude } from "./format.js";
import { graticule, roundStep } from "./ticks.js";

// The same in both themes, as the colours below them are: light lines in a dark casing.
const LIGHT = "rgb(255 255 255 / 92%)";
const CASING = "rgb(6 16 26 / 55%)";
const PLAN = "#ffb000";
const FENCE = "#ff6f61";
const VESSEL = "#ff4d3d";

export const FRAME = { left: 20, bottom: 18 };

function trace(pen, view, points, close = false) {
  points.forEach(([lat, lon], index) => {
    if (index) pen.lineTo(view.x(lon), view.y(lat));
    else pen.moveTo(view.x(lon), view.y(lat));
  });
  if (close) pen.closePath();
}

function cased(pen, colour, width, dash = []) {
  pen.lineJoin = "round";
  pen.lineCap = dash.length ? "butt" : "round";
  pen.setLineDash([]);
  pen.strokeStyle = CASING;
  pen.lineWidth = width + 1.8;
  pen.stroke();
  pen.setLineDash(dash);
  pen.strokeStyle = colour;
  pen.lineWidth = width;
  pen.stroke();
  pen.setLineDash([]);
}

export function drawLand(pen, view, survey) {
  pen.fillStyle = themed("--land");
  pen.strokeStyle = themed("--coast");
  pen.lineWidth = 1;
  pen.beginPath();
  for (const ring of survey.land ?? []) trace(pen, view, ring, true);
  // A ring within a ring is a lake.
  pen.fill("evenodd");
  pen.stroke();
}

export function drawLimits(pen, view, survey) {
  const rings = (name) => {
    pen.beginPath();
    for (const ring of survey[name] ?? []) trace(pen, view, ring, true);
  };
  rings("area");
  cased(pen, LIGHT, 1);
  rings("keep_in");
  cased(pen, LIGHT, 1, [2, 3]);
  rings("keep_out");
  pen.fillStyle = "rgb(6 16 26 / 30%)";
  pen.fill("evenodd");
  cased(pen, FENCE, 1.2);
  rings("fence");
  cased(pen, FENCE, 1.4, [7, 5]);
}

/** The sailed way; readings that the checks doubt stand out. Rows are [t, lat, lon, value, flag]. */
export function drawTrack(pen, view, track) {
  if (!track.length) return;
  pen.beginPath();
  trace(pen, view, track.map((row) => [row[1], row[2]]));
  cased(pen, LIGHT, 1.1);
  pen.strokeStyle = VESSEL;
  pen.lineWidth = 1.6;
  for (const [, lat, lon, , flag] of track) {
    if (flag !== 3 && flag !== 4) continue;
    const x = view.x(lon);
    const y = view.y(lat);
    pen.beginPath();
    pen.moveTo(x - 3, y - 3);
    pen.lineTo(x + 3, y + 3);
    pen.moveTo(x + 3, y - 3);
    pen.lineTo(x - 3, y + 3);
    pen.stroke();
  }
}

export function drawPlan(pen, view, plan) {
  pen.beginPath();
  trace(pen, view, [plan.start_deg, ...plan.route_deg]);
  cased(pen, PLAN, 1.6, [6, 4]);
  plan.route_deg.forEach(([lat, lon], index) => {
    if (!plan.is_spot[index]) return;
    const x = view.x(lon);
    const y = view.y(lat);
    pen.beginPath();
    pen.moveTo(x, y - 5);
    pen.lineTo(x + 5, y);
    pen.lineTo(x, y + 5);
    pen.lineTo(x - 5, y);
    pen.closePath();
    pen.fillStyle = PLAN;
    pen.strokeStyle = CASING;
    pen.lineWidth = 1.2;
    pen.fill();
    pen.stroke();
  });
}

export function drawBasis(pen, view, basis) {
  for (const [lat, lon] of basis) {
    pen.beginPath();
    pen.arc(view.x(lon), view.y(lat), 2, 0, 2 * Math.PI);
    pen.fillStyle = LIGHT;
    pen.strokeStyle = CASING;
    pen.lineWidth = 1.2;
    pen.stroke();
    pen.fill();
  }
}

/** An arrowhead that points where the bow does; a disc while the heading isn't known. */
export function drawVessel(pen, view, { lat, lon, heading, heard }) {
  pen.save();
  pen.translate(view.x(lon), view.y(lat));
  pen.beginPath();
  if (Number.isFinite(heading)) {
    pen.rotate((heading * Math.PI) / 180);
    pen.moveTo(0, -11);
    pen.lineTo(7, 9);
    pen.lineTo(0, 5);
    pen.lineTo(-7, 9);
  } else pen.arc(0, 0, 6, 0, 2 * Math.PI);
  pen.closePath();
  pen.lineJoin = "round";
  pen.strokeStyle = "rgb(6 16 26 / 75%)";
  pen.lineWidth = 4.5;
  pen.stroke();
  pen.strokeStyle = "#fff";
  pen.lineWidth = 2.4;
  pen.stroke();
  pen.fillStyle = heard ? VESSEL : "#7d8a95";
  pen.fill();
  pen.restore();
}

export function drawCross(pen, view, { lat, lon }) {
  const x = Math.round(view.x(lon)) + 0.5;
  const y = Math.round(view.y(lat)) + 0.5;
  pen.beginPath();
  for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
    pen.moveTo(x + 4 * dx, y + 4 * dy);
    pen.lineTo(x + 12 * dx, y + 12 * dy);
  }
  cased(pen, "#fff", 1.4);
}

/** Thin lines across the map, their degrees and minutes in the frame below and on the left. */
export function drawGraticule(pen, view, font) {
  const { south, west, north, east } = view.window();
  const { width, height } = view;
  const lats = graticule(south, north, Math.max(3, height / 75));
  const lons = graticule(west, east, Math.max(2, width / 100));
  pen.fillStyle = themed("--panel");
  pen.fillRect(0, 0, FRAME.left, height);
  pen.fillRect(0, height - FRAME.bottom, width, FRAME.bottom);
  pen.strokeStyle = themed("--line-strong");
  pen.lineWidth = 1;
  pen.strokeRect(FRAME.left + 0.5, 0.5, width - FRAME.left - 1, height - FRAME.bottom - 1);
  pen.fillStyle = themed("--ink-faint");
  pen.font = font;
  pen.textAlign = "center";
  pen.textBaseline = "middle";
  for (const lon of lons.values) {
    const x = Math.round(view.x(lon)) + 0.5;
    if (x < FRAME.left + 30 || x > width - 30) continue;
    pen.fillText(longitude(lon, lons.decimals), x, height - FRAME.bottom / 2 + 2);
    tick(pen, x, height - FRAME.bottom, 0, 4);
  }
  for (const lat of lats.values) {
    const y = Math.round(view.y(lat)) + 0.5;
    if (y < 30 || y > height - FRAME.bottom - 30) continue;
    pen.save();
    pen.translate(FRAME.left / 2 - 1, y);
    pen.rotate(-Math.PI / 2);
    pen.fillText(latitude(lat, lats.decimals), 0, 0);
    pen.restore();
    tick(pen, FRAME.left, y, -4, 0);
  }
  return { lats: lats.values, lons: lons.values };
}

function tick(pen, x, y, dx, dy) {
  pen.beginPath();
  pen.moveTo(x, y);
  pen.lineTo(x + dx, y + dy);
  pen.stroke();
}

export function drawGridLines(pen, view) {
  const { south, west, north, east } = view.window();
  pen.strokeStyle = "rgb(255 255 255 / 13%)";
  pen.lineWidth = 1;
  pen.beginPath();
  for (const lon of graticule(west, east, Math.max(2, view.width / 100)).values) {
    const x = Math.round(view.x(lon)) + 0.5;
    pen.moveTo(x, 0);
    pen.lineTo(x, view.height);
  }
  for (const lat of graticule(south, north, Math.max(3, view.height / 75)).values) {
    const y = Math.round(view.y(lat)) + 0.5;
    pen.moveTo(0, y);
    pen.lineTo(view.width, y);
  }
  pen.stroke();
}

/** A bar of a round length in the lower left corner. */
export function drawScale(pen, view, font) {
  const length = roundStep((view.metresPerPixel * Math.min(120, view.width / 4)) / 1.6);
  const pixels = length / view.metresPerPixel;
  const x = FRAME.left + 18;
  const y = view.height - FRAME.bottom - 20;
  const text = distance(length).replace(/(\.\d*?)0+(?=\s)/, "$1").replace(/\.(?=\s)/, "");
  pen.font = `600 ${font}`;
  pen.textAlign = "left";
  pen.textBaseline = "bottom";
  pen.beginPath();
  pen.moveTo(x, y - 4);
  pen.lineTo(x, y);
  pen.lineTo(x + pixels, y);
  pen.lineTo(x + pixels, y - 4);
  cased(pen, "#fff", 1.6);
  pen.lineJoin = "round";
  pen.strokeStyle = "rgb(6 16 26 / 70%)";
  pen.lineWidth = 3;
  pen.strokeText(text, x + 5, y - 3);
  pen.fillStyle = "#fff";
  pen.fillText(text, x + 5, y - 3);
}
