// How the vehicle is, what it believes, whether that can be trusted, and what it has said.

import { element } from "./dom.js";
import { count, distance, fixed, percent, position, significant, unitText, utc } from "./format.js";
import { amplitude, calibration, CHECKS, extent, memory, smoothness } from "./words.js";

const FLAGS = ["good", "not evaluated", "suspect", "fail", "missing"];
const SHOWN_LINES = 60;

function card(title, ...content) {
  return element("div", { class: "card", role: "group", "aria-label": title }, element("h3", { class: "card-title" }, title), ...content);
}

function pairs(rows) {
  const list = element("dl", { class: "pairs" });
  for (const [name, value, level] of rows)
    list.append(element("div", {}, element("dt", {}, name), element("dd", { class: level }, value)));
  return list;
}

const nothing = (text) => element("p", { class: "nothing" }, text);

export class Cards {
  constructor(name) {
    this.vehicle = element("div");
    this.belief = element("div");
    this.trust = element("div");
    this.quality = element("div");
    this.log = element("ol", { class: "log", tabindex: "0", "aria-label": "Log lines, the newest first" });
    this.element = element(
      "aside", { class: "cards", "aria-label": `Details of ${name}` },
      card("Vehicle", this.vehicle), card("What it believes", this.belief), card("Can the map be trusted?", this.trust),
      card("Checks of the probe", this.quality),
    );
    this.logElement = card("Log", this.log);
    this.logElement.classList.add("log-card");
  }

  showHealth(health) {
    this.#showQuality(health?.quality ?? {});
    if (!health) return this.vehicle.replaceChildren(nothing("Nothing has been heard of its state yet."));
    const placed = health.lat_deg !== null && health.lat_deg !== undefined;
    const rows = [
      ["Autopilot", health.link_ok ? `heard, ${health.mode || "mode unknown"}` : "not heard", health.link_ok ? "" : "bad"],
      ["Motors", health.armed ? "armed" : "disarmed"],
      ["Position", placed ? position(health.lat_deg, health.lon_deg) : "–"],
      ["Heading", health.heading_deg === null ? "–" : `${fixed(health.heading_deg, 0)}°`],
      ["Speed over ground", health.groundspeed_mps === null ? "–" : `${fixed(health.groundspeed_mps, 1)} m s⁻¹`],
      ["Sailed", distance(health.distance_m)],
      ["Planner", health.worker_busy ? "thinking" : "idle"],
    ];
    if (health.dropped) rows.push(["Messages lost", count(health.dropped), "caution"]);
    if (health.repairs) rows.push(["Model rebuilt", `${count(health.repairs)} times`, "caution"]);
    const troubles = [["Recording", health.journal], ["Security", health.security], ["Way ashore", health.shore]];
    this.vehicle.replaceChildren(
      pairs(rows),
      ...troubles.filter(([, text]) => text).map(([what, text]) => element("p", { class: "trouble" }, element("b", {}, `${what}: `), text)),
    );
  }

  showModel(model, units) {
    if (!model) {
      this.belief.replaceChildren(nothing("No model has come yet."));
      this.trust.replaceChildren(nothing("No model has come yet."));
      return;
    }
    const body = element("tbody");
    for (const each of model.kernel)
      body.append(element(
        "tr", {},
        element("th", { scope: "row" }, smoothness(each.space)),
        element("td", {}, amplitude(each.variance, units, model.transform)),
        element("td", {}, extent(each.lengthscales_m)),
        element("td", {}, memory(each)),
      ));
    const head = element("thead", {}, element(
      "tr", {}, element("th", { scope: "col" }, "Part"), element("th", { scope: "col" }, "σ"),
      element("th", { scope: "col" }, "Length"), element("th", { scope: "col" }, "Memory"),
    ));
    const rows = [["Noise of a reading, σₙ", amplitude(model.noise_sd ** 2, units, model.transform)]];
    if (model.precision) rows.push(["Sent with", sentWith(model)]);
    if (model.software_version) rows.push(["Software", model.software_version]);
    if (model.configuration_hash) rows.push(["Configuration", String(model.configuration_hash).slice(0, 8)]);
    this.belief.replaceChildren(element("table", { class: "parts" }, head, body), pairs(rows));
    this.trust.replaceChildren(
      judged("Along the track", calibration(model.calibration, "readings"), model.calibration),
      judged("Far from what it knew", calibration(model.ahead, "readings"), model.ahead),
    );
  }

  #showQuality(quality) {
    const names = Object.keys(quality);
    if (!names.length) return this.quality.replaceChildren(nothing("No reading has been checked yet."));
    const rows = names.map((name) => {
      const tally = quality[name];
      const total = Math.max(1, tally.reduce((sum, each) => sum + each, 0));
      const bar = element("span", { class: "tally", "aria-hidden": "true" });
      tally.forEach((each, flag) => {
        if (!each) return;
        const piece = element("i", { class: `flag-${FLAGS[flag].replace(" ", "-")}` });
        piece.style.flexGrow = Math.max(each / total, 0.02);
        bar.append(piece);
      });
      const doubtful = [2, 3, 4].filter((flag) => tally[flag]).map((flag) => `${count(tally[flag])} ${FLAGS[flag]}`);
      const text = doubtful.length ? doubtful.join(", ") : tally[0] ? "all good" : "not evaluated";
      return element("tr", { class: name === "aggregate" ? "total" : "" },
        element("th", { scope: "row" }, CHECKS[name] ?? name.replaceAll("_", " ")), element("td", {}, bar), element("td", {}, text));
    });
    const readings = quality.aggregate?.reduce((sum, each) => sum + each, 0);
    this.quality.replaceChildren(
      element("table", { class: "tallies" },
        element("caption", {}, readings === undefined ? "QARTOD flags" : `QARTOD flags of ${count(readings)} readings`),
        element("tbody", {}, ...rows)),
    );
  }

  showLog(lines) {
    const newest = lines.slice(-SHOWN_LINES).reverse();
    this.log.replaceChildren(...(newest.length ? newest.map((line) => element(
      "li", { class: `line ${line.level}` },
      element("time", {}, utc(line.utc_s, { day: false })),
      element("span", {}, ["warning", "error"].includes(line.level) ? element("b", {}, `${line.level}: `) : null, line.text),
    )) : [element("li", { class: "nothing" }, "It has said nothing yet.")]));
  }
}

/** The precision of a snapshot, with the error that it states: shares of the field's standard deviation. */
function sentWith({ precision, stated_error }) {
  if (precision === "lossless") return "every digit";
  const largest = Math.max(...[stated_error ?? []].flat());
  return largest > 0 ? `${precision}, error ${significant(100 * largest, 2)} % of σ` : precision;
}

function judged(what, { level, title, text }, figures) {
  const share = figures?.count ? figures.coverage_95 : null;
  const bar = element("div", { class: "held", role: "img", "aria-label": share === null ? "no figure yet" : `${percent(share)} held, 95 % wanted` });
  if (share !== null) {
    const fill = element("i", { class: level });
    fill.style.width = percent(share).replace(" ", "");
    bar.append(fill, element("span", { class: "wanted" }));
  }
  return element("div", { class: "judged" },
    element("p", { class: "judged-head" }, element("span", {}, what), element("b", { class: level }, title)),
    bar, element("p", { class: "judged-text" }, text));
}

/** The line of figures below a vehicle's name. */
export function figures({ model, health, survey, plans }) {
  const known = health ?? {};
  const rho0 = survey?.rho0 ?? model?.rho0 ?? known.rho0 ?? null;
  const capacity = survey?.capacity ?? model?.capacity;
  const basis = model ? model.basis.length : known.basis_size;
  const rho = model?.rho ?? known.rho ?? null;
  return [
    ["Samples", count(model?.samples ?? known.samples)],
    ["Basis vectors", `${count(basis)}${capacity ? ` of ${count(capacity)}` : ""}`],
    ["ρ, new since re-estimate", `${fixed(rho, 2)}${rho0 === null ? "" : ` of ${fixed(rho0, 2)}`}`],
    ["Plans", count(known.replans ?? plans)],
    ["Sailed", distance(known.distance_m)],
  ];
}

/** What a plan promises, in words; null where there is none. */
export function planText(plan, units) {
  if (!plan) return null;
  const spots = plan.is_spot.filter(Boolean).length;
  const unit = unitText(units);
  const parts = [`Plan ${plan.sequence} (${plan.planner}): ${spots} spots`, `because: ${plan.reason}`];
  if (plan.mutual_information !== null) parts.push(`${significant(plan.mutual_information)} nats`);
  if (plan.expected_rmse !== null) parts.push(`expected error then ${significant(plan.expected_rmse, 2)}${unit ? ` ${unit}` : ""}`);
  return parts.join(" · ");
}
