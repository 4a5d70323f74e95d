// Elements without markup: whatever a vehicle sends ends up as text, never as HTML.

export function element(tag, properties = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (value === undefined || value === null || value === false) continue;
    if (name === "class") made.className = value;
    else if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else made.setAttribute(name, value === true ? "" : value);
  }
  made.append(...children.filter((child) => child !== null && child !== undefined));
  return made;
}

const SVG = "http://www.w3.org/2000/svg";

/** A small drawing: `shapes` are [tag, attributes] pairs; presentation attributes are no inline style. */
export function drawing(viewBox, shapes, properties = {}) {
  const made = document.createElementNS(SVG, "svg");
  const attributes = { viewBox, "aria-hidden": "true", focusable: "false", ...properties };
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  for (const [tag, shape] of shapes) {
    const child = document.createElementNS(SVG, tag);
    for (const [name, value] of Object.entries(shape)) child.setAttribute(name, value);
    made.append(child);
  }
  return made;
}

const stroke = { fill: "none", stroke: "currentColor", "stroke-width": 1.6, "stroke-linecap": "round", "stroke-linejoin": "round" };
const ICONS = {
  plus: "M8 3v10M3 8h10",
  minus: "M3 8h10",
  whole: "M2.5 6V2.5h3.5M10 2.5h3.5V6M13.5 10v3.5H10M6 13.5H2.5V10",
  columns: "M2.5 3h11v10h-11zM8 3v10",
  sun: "M8 5a3 3 0 1 0 0 6a3 3 0 0 0 0-6M8 1v1.5M8 13.5V15M1 8h1.5M13.5 8H15M3 3l1 1M12 12l1 1M13 3l-1 1M4 12l-1 1",
  moon: "M13.5 9.8A6 6 0 0 1 6.2 2.5a6 6 0 1 0 7.3 7.3z",
  play: "M5 3.5v9l7-4.5z",
  pause: "M5.5 3.5v9M10.5 3.5v9",
  close: "M4 4l8 8M12 4l-8 8",
};

/** One of the line icons, 16 px square. */
export function icon(name) {
  return drawing("0 0 16 16", [["path", { d: ICONS[name], ...stroke }]], { class: "icon" });
}

/** The value of a custom property of the theme, e.g. colour("--land"). */
export function themed(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}
