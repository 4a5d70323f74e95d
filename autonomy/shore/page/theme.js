// Light or dark: the system's choice until somebody presses the button.

import { icon } from "./dom.js";

const KEY = "halocline-theme";
const system = matchMedia("(prefers-color-scheme: dark)");

const kept = () => {
  try { return localStorage.getItem(KEY); } catch { return null; }
};

const current = () => kept() ?? (system.matches ? "dark" : "light");

/** Keep page and button in the theme; `changed` is called whenever the canvases have to be drawn anew. */
export function followTheme(button, changed) {
  const apply = () => {
    const theme = current();
    const other = theme === "dark" ? "light" : "dark";
    document.documentElement.dataset.theme = theme;
    button.replaceChildren(icon(theme === "dark" ? "sun" : "moon"));
    button.setAttribute("aria-label", `Switch to the ${other} theme`);
    button.title = `Switch to the ${other} theme`;
    changed();
  };
  button.addEventListener("click", () => {
    const other = current() === "dark" ? "light" : "dark";
    try { localStorage.setItem(KEY, other); } catch { document.documentElement.dataset.theme = other; }
    apply();
  });
  system.addEventListener("change", apply);
  apply();
}
