// What has changed over time, as small charts that share their time axis and cursor.

import uPlot from "./vendor/uPlot.esm.js";
import { element, themed } from "./dom.js";
import { fixed, significant, unitText, utc } from "./format.js";
import { stepDecimals } from "./ticks.js";

const HEIGHT = 118;
const COLOURS = ["--series-1", "--series-2", "--series-3", "--series-4"];
const DASH = [5, 4];

/** What each chart shows: `lines(vehicle)` gives { times, values: [[…]], names, marks } or null while there is nothing. */
const CHARTS = [
  {
    title: "Novelty ρ",
    lines: ({ series, rho0 }) => ({
      values: [series.rho, rho0 === null ? null : series.utc_s.map(() => rho0)],
      names: ["ρ", "ρ₀, re-estimates above"], digits: (value) => fixed(value, 2), low: 0, high: Math.max(1, rho0 ?? 0),
    }),
    now: ({ series, rho0 }) => `${fixed(series.rho.at(-1), 2)}${rho0 === null ? "" : ` of ρ₀ ${fixed(rho0, 2)}`}`,
  },
  {
    title: "Basis vectors",
    lines: ({ series, capacity }) => ({
      values: [series.basis_size, capacity ? series.utc_s.map(() => capacity) : null],
      names: ["basis vectors", "capacity"], digits: (value) => fixed(value, 0), low: 0,
    }),
    now: ({ series, capacity }) => `${series.basis_size.at(-1)}${capacity ? ` of ${capacity}` : ""}`,
  },
  {
    title: "Length-scales",
    lines: ({ series }) => {
      const scales = distinct(series.lengthscales_m);
      return { values: scales, names: scales.map((_, index) => `length-scale ${index + 1}`), digits: (value) => significant(value), low: 0, solid: true };
    },
    now: ({ series }) => `${distinct(series.lengthscales_m).map((line) => line.at(-1)).filter((each) => each !== null).map((each) => significant(each)).join(" · ")} km`,
  },
  {
    title: "Noise σₙ",
    lines: ({ series }) => ({ values: [series.noise_sd], names: ["noise"], digits: (value) => significant(value), low: 0 }),
    now: ({ series, units }) => `${significant(series.noise_sd.at(-1))} ${unitText(units)}`,
  },
  {
    title: "Mutual information",
    lines: ({ plans }) => ({
      times: plans.map((plan) => plan.utc_s), values: [plans.map((plan) => plan.mutual_information)],
      names: ["mutual information"], digits: (value) => significant(value), low: 0, points: true,
    }),
    now: ({ plans }) => (plans.length ? `${significant(plans.at(-1).mutual_information)} nats` : "no plan yet"),
  },
];

/** Length-scales in km over time, a line each: two per component, one where it is the same in both directions. */
function distinct(rows) {
  const told = rows.map((row) => row.filter((scale, index) => index % 2 === 0 || scale !== row[index - 1]));
  const most = Math.max(0, ...told.map((row) => row.length));
  return Array.from({ length: most }, (_, line) => told.map((row) => (line < row.length ? row[line] / 1000 : null)));
}

const numbers = (_, ticks) => ticks.map((tick) => fixed(tick, ticks.length > 1 ? stepDecimals(ticks[1] - ticks[0]) : 2));
const clock = (_, seconds) => seconds.map((each) => utc(each, { day: false, second: false }));

export class Charts {
  #plots = [];

  constructor(name) {
    this.sync = uPlot.sync(`vehicle-${name}`);
    this.boxes = CHARTS.map(({ title }) => {
      const now = element("span", { class: "chart-now" });
      const plot = element("div", { class: "chart-plot" });
      return { now, plot, element: element("figure", { class: "chart" }, element("figcaption", { class: "chart-title" }, title, now), plot) };
    });
    this.element = element("section", { class: "charts", "aria-label": `${name} over time` }, ...this.boxes.map((box) => box.element));
    new ResizeObserver(() => this.#fit()).observe(this.element);
  }

  /** `data` is { series, plans, rho0, capacity, units }; `stamp` the moment shown, null while live. */
  update(data, stamp) {
    this.data = data;
    this.stamp = stamp;
    CHARTS.forEach((chart, index) => {
      const box = this.boxes[index];
      const empty = !data.series.utc_s.length;
      box.now.textContent = empty ? "no data yet" : chart.now(data);
      if (empty) return;
      const lines = chart.lines(data);
      const values = lines.values.filter((line) => line !== null);
      const content = [lines.times ?? data.series.utc_s, ...values];
      const plot = this.#plots[index];
      if (plot && plot.series.length === content.length) plot.setData(content);
      else {
        plot?.destroy();
        this.#plots[index] = this.#make(box, lines, content);
      }
      box.plot.setAttribute("role", "img");
      box.plot.setAttribute("aria-label", `${chart.title} over time, now ${box.now.textContent}`);
    });
  }

  /** Nobody will look any more. */
  dispose() {
    for (const plot of this.#plots) plot?.destroy();
    this.#plots = [];
  }

  /** The colours have changed. */
  restyle() {
    this.dispose();
    if (this.data) this.update(this.data, this.stamp);
  }

  #fit() {
    this.#plots.forEach((plot, index) => {
      const width = this.boxes[index].plot.clientWidth;
      if (plot && width > 0 && Math.abs(plot.width - width) > 0.5) plot.setSize({ width, height: HEIGHT });
    });
  }

  #make(box, lines, content) {
    const ink = themed("--ink-faint");
    const font = `11px ${getComputedStyle(document.body).fontFamily}`;
    const axis = { stroke: ink, font, grid: { stroke: themed("--line"), width: 1 }, ticks: { show: false } };
    const shown = content.slice(1).map((_, index) => {
      const reference = index > 0 && !lines.solid;
      const stroke = themed(reference ? "--ink-faint" : COLOURS[index % COLOURS.length]);
      return {
        label: lines.names[index], stroke, width: reference ? 1 : 1.7, dash: reference ? DASH : undefined, spanGaps: true,
        points: lines.points ? { show: true, size: 6, fill: stroke } : { show: false },
        ...(lines.points ? { paths: uPlot.paths.bars({ size: [0.1, 3] }), fill: stroke } : {}),
      };
    });
    const span = () => {
      const { utc_s: times } = this.data.series;
      const end = Math.max(times.at(-1), this.data.plans.at(-1)?.utc_s ?? 0);
      const start = Math.min(times[0], this.data.plans[0]?.utc_s ?? Infinity);
      return end > start ? [start, end] : [start - 30, start + 30];
    };
    const range = (_, least, most) => {
      const low = lines.low ?? least;
      const high = Math.max(lines.high ?? -Infinity, most ?? low + 1);
      return [low, high > low ? low + 1.08 * (high - low) : low + 1];
    };
    return new uPlot({
      width: Math.max(120, box.plot.clientWidth), height: HEIGHT, legend: { show: false }, padding: [6, 16, 0, 0],
      tzDate: (stamp) => uPlot.tzDate(new Date(stamp * 1000), "Etc/UTC"),
      cursor: { sync: { key: this.sync.key }, drag: { x: false, y: false }, y: false, points: { size: 6 } },
      scales: { x: { time: true, range: span }, y: { range } },
      axes: [
        { ...axis, values: clock, space: 46, size: 24, grid: { show: false } },
        { ...axis, values: numbers, space: 28, size: (_, texts) => 12 + 6.4 * Math.max(2, ...(texts ?? []).map((text) => text.length)) },
      ],
      series: [{}, ...shown],
      hooks: { draw: [(plot) => this.#markMoment(plot)], setCursor: [(plot) => this.#tell(plot, box, lines)] },
    }, content, box.plot);
  }

  /** Under the cursor the values of that time stand in the title, otherwise the newest. */
  #tell(plot, box, lines) {
    const chart = CHARTS[this.boxes.indexOf(box)];
    const { idx } = plot.cursor;
    box.now.textContent =
      idx === null || idx === undefined
        ? chart.now(this.data)
        : `${utc(plot.data[0][idx], { day: false })}  ${plot.data.slice(1, lines.solid ? undefined : 2).map((line) => lines.digits(line[idx])).join(" · ")}`;
  }

  #markMoment(plot) {
    if (this.stamp === null) return;
    const x = plot.valToPos(this.stamp, "x", true);
    plot.ctx.save();
    plot.ctx.fillStyle = themed("--accent");
    plot.ctx.fillRect(Math.round(x), plot.bbox.top, Math.max(1, devicePixelRatio), plot.bbox.height);
    plot.ctx.restore();
  }
}
