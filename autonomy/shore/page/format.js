// Numbers for people: the digits that mean something, units as one writes them, times in UTC.

const MINUS = "−";

const UNITS = {
  "1": "", "": "", "degree_Celsius": "°C", degree_C: "°C", degC: "°C", celsius: "°C", Celsius: "°C",
  "1e-3": "‰", "kg m-3": "kg m⁻³", "mg m-3": "mg m⁻³", "ug l-1": "µg l⁻¹", "ug L-1": "µg L⁻¹",
  "m s-1": "m s⁻¹", "umol l-1": "µmol l⁻¹", "umol kg-1": "µmol kg⁻¹", "mmol m-3": "mmol m⁻³", "S m-1": "S m⁻¹",
  psu: "PSU", percent: "%",
};

/** A CF unit as people write it; the unit of a pure number is not written. */
export function unitText(units) {
  return UNITS[units] ?? units ?? "";
}

/** "salinity (PSU)"; without the brackets where there is no unit. */
export function withUnit(name, units) {
  const unit = unitText(units);
  return unit ? `${name} (${unit})` : name;
}

const known = (number) => typeof number === "number" && Number.isFinite(number);
const signed = (text) => text.replace("-", MINUS);

/** Fixed decimals with a true minus sign; "–" for a number that isn't known. */
export function fixed(number, decimals) {
  return known(number) ? signed(number.toFixed(decimals)) : "–";
}

/** Three significant digits, never an exponent unless the number needs one. */
export function significant(number, digits = 3) {
  if (!known(number)) return "–";
  if (number === 0) return "0";
  const size = Math.floor(Math.log10(Math.abs(number)));
  if (size < -5 || size > 6) return signed(number.toExponential(digits - 1));
  return signed(number.toFixed(Math.max(0, digits - 1 - size)));
}

/** Decimals that show a standard deviation with two digits. */
export function decimalsFor(deviation) {
  if (!known(deviation) || deviation <= 0) return 2;
  return Math.min(8, Math.max(0, 1 - Math.floor(Math.log10(deviation))));
}

/** "33.412 ± 0.021 PSU": the value to the last digit that its deviation leaves meaningful. */
export function estimate(mean, deviation, units) {
  const decimals = decimalsFor(deviation);
  const unit = unitText(units);
  return `${fixed(mean, decimals)} ± ${fixed(deviation, decimals)}${unit ? ` ${unit}` : ""}`;
}

export const percent = (share, decimals = 0) => (known(share) ? `${(100 * share).toFixed(decimals)} %` : "–");

export const count = (number) => (known(number) ? Math.round(number).toLocaleString("en-GB").replaceAll(",", " ") : "–");

/** 640 m, 5.2 km, 31 km. */
export function distance(metres) {
  if (!known(metres)) return "–";
  if (Math.abs(metres) < 1000) return `${significant(metres, metres < 10 ? 2 : 3)} m`;
  return `${significant(metres / 1000, 3)} km`;
}

/** 45 s, 20 min, 6.1 h, 3.2 d. */
export function duration(seconds) {
  if (!known(seconds)) return "–";
  for (const [size, unit] of [[86400, "d"], [3600, "h"], [60, "min"]])
    if (seconds >= 1.5 * size) return `${seconds >= 10 * size ? Math.round(seconds / size) : (seconds / size).toFixed(1)} ${unit}`;
  return seconds < 10 ? `${Math.max(0, seconds).toFixed(1)} s` : `${Math.round(seconds)} s`;
}

/** Degrees and decimal minutes, as charts have them: 34°02.51′N. */
export function degrees(value, letters, decimals = 2) {
  if (!known(value)) return "–";
  const scale = 10 ** decimals;
  const minutes = Math.round(Math.abs(value) * 60 * scale) / scale;
  const whole = Math.floor(minutes / 60 + 1e-9);
  const rest = (minutes - 60 * whole).toFixed(decimals).padStart(decimals ? 3 + decimals : 2, "0");
  return `${whole}°${rest}′${letters[value < 0 ? 1 : 0]}`;
}

export const latitude = (value, decimals) => degrees(value, "NS", decimals);
export const longitude = (value, decimals) => degrees(((value + 540) % 360) - 180, "EW", decimals);
export const position = (lat, lon, decimals) => `${latitude(lat, decimals)} ${longitude(lon, decimals)}`;

const pad = (number) => String(number).padStart(2, "0");

/** 2026-11-22 15:33:07 */
export function utc(seconds, { day = true, second = true } = {}) {
  if (!known(seconds)) return "–";
  const at = new Date(seconds * 1000);
  const date = `${at.getUTCFullYear()}-${pad(at.getUTCMonth() + 1)}-${pad(at.getUTCDate())}`;
  const time = `${pad(at.getUTCHours())}:${pad(at.getUTCMinutes())}${second ? `:${pad(at.getUTCSeconds())}` : ""}`;
  return day ? `${date} ${time}` : time;
}

/** A CF name without its underscores, first letter capital. */
export function sentence(name) {
  const words = String(name ?? "").replaceAll("_", " ").trim();
  return words ? words[0].toUpperCase() + words.slice(1) : "";
}
