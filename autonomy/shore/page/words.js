// What the figures mean, in words.

import { count, distance, duration, percent, significant, unitText } from "./format.js";

const SPACES = { squared_exponential: "smooth", matern32: "rough" };

/** How smooth a component of the field is. */
export const smoothness = (space) => SPACES[space] ?? String(space).replaceAll("_", " ");

/** How long a component remembers. */
export const memory = ({ timescale_s }) => (timescale_s ? duration(timescale_s) : "still");

/** "13.1 km", or "13.1 × 4.2 km" where it depends on the direction. */
export function extent(lengthscales) {
  const same = lengthscales.every((each) => Math.abs(each / lengthscales[0] - 1) < 1e-6);
  const told = same ? lengthscales.slice(0, 1) : lengthscales;
  const far = told.every((each) => each >= 1000);
  return far ? `${told.map((each) => significant(each / 1000)).join(" × ")} km` : told.map(distance).join(" × ");
}

/** The standard deviation of a component, in the units of what is learnt. */
export const amplitude = (variance, units, transform) => {
  const unit = transform && transform !== "none" ? transform : unitText(units);
  return `${significant(Math.sqrt(variance))}${unit ? ` ${unit}` : ""}`;
};

const FEW = 30;

/** A judgement on calibration figures: { level, title, text }. */
export function calibration(figures, what) {
  if (!figures?.count) return { level: "unknown", title: "Untested", text: `No ${what} judged yet.` };
  const { coverage_95: held, count: readings } = figures;
  const text = `95 % intervals held ${percent(held)} of ${count(readings)} ${what}.`;
  if (readings < FEW) return { level: "unknown", title: "Too few to say", text };
  // Two standard deviations of the share that a right model would show.
  const slack = 2 * Math.sqrt((0.95 * 0.05) / readings);
  if (held < 0.95 - slack - 0.05) return { level: "bad", title: "Too sure of itself", text };
  if (held < 0.95 - slack) return { level: "caution", title: "A little too sure", text };
  if (figures.mean_square !== null && figures.mean_square < 0.5) return { level: "good", title: "Cautious", text };
  return { level: "good", title: "As sure as it should be", text };
}

const STATES = {
  exploring: "good", returning: "good", finished: "good",
  "waiting for vehicle": "caution", yielded: "caution", observing: "caution",
};

/** How a state of the exploration is to be shown: good, caution or plain. */
export const stateLevel = (state) => STATES[String(state ?? "").toLowerCase()] ?? "plain";

export const CHECKS = {
  aggregate: "All tests", timing: "Timing", syntax: "Syntax", gross_range: "Gross range", location: "Location",
  spike: "Spike", rate_of_change: "Rate of change", flat_line: "Flat line",
};
