// What the signs on the maps mean; pressing one hides or shows it on both.

import { drawing, element } from "./dom.js";

const PLAIN = { fill: "none", "stroke-linecap": "round" };
const light = { ...PLAIN, class: "sign-light", "stroke-width": 1.6 };
const casing = { ...PLAIN, class: "sign-casing", "stroke-width": 3.6 };
const both = (tag, shape) => [[tag, { ...casing, ...shape }], [tag, { ...light, ...shape }]];

const SIGNS = {
  track: ["Track", both("path", { d: "M2 9c4-7 8 4 16-4" })],
  plan: ["Plan and spots", [["path", { ...PLAIN, class: "sign-plan", "stroke-width": 1.8, "stroke-dasharray": "4 3", d: "M1 7h20" }], ["path", { class: "sign-spot", d: "M11 2l5 5l-5 5l-5-5z" }]]],
  basis: ["Basis vectors", [["circle", { class: "sign-basis", cx: 6, cy: 5, r: 2.4 }], ["circle", { class: "sign-basis", cx: 15, cy: 9, r: 2.4 }]]],
  contours: ["Contours", [["path", { ...PLAIN, class: "sign-contour", "stroke-width": 1.1, d: "M2 5c6-4 12 3 18-1M2 10c6-4 12 3 18-1" }]]],
  limits: ["Area and fence", [["path", { ...PLAIN, class: "sign-fence", "stroke-width": 1.7, "stroke-dasharray": "4 3", d: "M2 2h18v10h-18z" }]]],
};

export class Legend {
  constructor(layers, changed) {
    this.chips = {};
    this.element = element("div", { class: "legend", role: "group", "aria-label": "Shown on the maps" });
    for (const [name, [title, shapes]] of Object.entries(SIGNS)) {
      const chip = element("button", { type: "button", class: "chip", "aria-pressed": String(layers[name]) },
        drawing("0 0 22 14", shapes, { class: "sign" }), title);
      chip.addEventListener("click", () => {
        layers[name] = !layers[name];
        chip.setAttribute("aria-pressed", String(layers[name]));
        changed();
      });
      this.chips[name] = chip;
      this.element.append(chip);
    }
  }

  /** Signs of what isn't there, or isn't known of the past, can't be pressed. */
  update({ plan, model, track, survey }, live) {
    this.chips.plan.disabled = !live || !plan;
    this.chips.basis.disabled = !live || !model?.basis.length;
    this.chips.track.disabled = !track.length;
    this.chips.limits.disabled = !["area", "keep_in", "keep_out", "fence"].some((name) => survey?.[name]?.length);
  }
}
