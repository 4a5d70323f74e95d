// Round numbers for axes, colour bars, graticules and scale bars.

/** The smallest of 1, 2, 2.5, 5 × 10ⁿ that is not below `least`. */
export function roundStep(least) {
  const power = 10 ** Math.floor(Math.log10(least));
  return [1, 2, 2.5, 5, 10].map((each) => each * power).find((step) => step >= least * (1 - 1e-9));
}

/** Multiples of a round step within [low, high], about `wanted` of them; and the step. */
export function roundTicks(low, high, wanted) {
  if (!(high > low)) return { step: 1, values: [low] };
  return multiples(low, high, roundStep((high - low) / wanted));
}

/** All multiples of `step` within [low, high]. */
export function multiples(low, high, step) {
  const values = [];
  for (let index = Math.ceil(low / step - 1e-9); index * step <= high + 1e-9 * step; index += 1) values.push(index * step);
  return { step, values };
}

/** Decimals with which multiples of a step are written. */
export function stepDecimals(step) {
  for (let decimals = 0; decimals < 9; decimals += 1)
    if (Math.abs(Math.round(step * 10 ** decimals) - step * 10 ** decimals) < 1e-6 * step * 10 ** decimals + 1e-12) return decimals;
  return 9;
}

// In minutes of arc: what charts use.
const MINUTES = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 20, 30, 60, 120, 300, 600, 1200];

/** Lines of latitude or longitude between two degrees; `decimals` of the minutes that they are written with. */
export function graticule(low, high, wanted) {
  const least = ((high - low) * 60) / wanted;
  const step = MINUTES.find((each) => each >= least) ?? 1800;
  const values = multiples(low * 60, high * 60, step).values.map((minutes) => minutes / 60);
  return { values, decimals: stepDecimals(step) };
}
