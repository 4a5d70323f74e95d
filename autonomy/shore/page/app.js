// The page: which vehicles are on show, and the line to the server.

import * as api from "./api.js";
import { setColormaps } from "./colour.js";
import { element } from "./dom.js";
import { FleetList } from "./fleet.js";
import { utc } from "./format.js";
import { Live } from "./live.js";
import { Panel } from "./panel.js";
import { Fleet } from "./store.js";
import { followTheme } from "./theme.js";

const MOST_PANELS = 4;
const RETRY_MS = 3000;

const find = (id) => document.getElementById(id);

class Page {
  panels = new Map();

  constructor() {
    this.fleet = new Fleet();
    this.live = new Live();
    this.box = find("panels");
    this.server = find("server");
    this.list = new FleetList(find("fleet"), this.fleet, (name, beside) => this.choose(name, beside));
    this.empty = element("p", { class: "empty" });
    this.lost = null;
    followTheme(find("theme"), () => { for (const panel of this.panels.values()) panel.restyle(); });
  }

  async start() {
    this.live.addEventListener("news", (event) => this.fleet.take(event.detail));
    this.live.addEventListener("open", () => this.opened());
    this.live.addEventListener("closed", () => this.closed());
    this.fleet.addEventListener("list", () => this.arrange());
    setInterval(() => this.tick(), 1000);
    this.tick();
    await this.first();
    this.live.start();
  }

  /** Colours and the list, asked for until the server answers. */
  async first() {
    for (;;) {
      try {
        setColormaps(await api.colormaps());
        this.fleet.list(await api.vehicles());
        return;
      } catch {
        this.lost ??= Date.now();
        this.tick();
        await new Promise((done) => setTimeout(done, RETRY_MS));
      }
    }
  }

  /** The line stands (again): what was missed meanwhile is asked for. */
  async opened() {
    this.lost = null;
    this.tick();
    try {
      this.fleet.list(await api.vehicles());
      await Promise.all([...this.panels.values()].map((panel) => panel.vehicle.load()));
    } catch {
      // The line will break and be dialled again, or the next news make up for it.
    }
  }

  closed() {
    this.lost ??= Date.now();
    this.tick();
    // A line that is refused may mean that the token has changed: an answer says so, and leads to the login.
    api.vehicles().catch(() => {});
  }

  wanted() {
    const asked = new URLSearchParams(location.hash.slice(1)).get("show");
    return (asked ? asked.split(",") : []).filter((name) => this.fleet.vehicles.has(name)).slice(0, MOST_PANELS);
  }

  /** Panels for what the address asks for, otherwise for the first vehicle that is there. */
  arrange() {
    let names = this.wanted();
    if (!names.length) names = [...this.panels.keys()].filter((name) => this.fleet.vehicles.has(name));
    if (!names.length) {
      const all = [...this.fleet.vehicles.values()];
      const first = all.find((each) => each.alive && each.summary?.variable) ?? all.find((each) => each.alive) ?? all[0];
      names = first ? [first.name] : [];
    }
    this.show(names);
  }

  show(names) {
    for (const [name, panel] of this.panels) {
      if (names.includes(name)) continue;
      panel.dispose();
      this.panels.delete(name);
    }
    for (const name of names)
      if (!this.panels.has(name)) this.panels.set(name, new Panel(this.fleet.get(name), () => this.choose(name, true)));
    const shown = names.map((name) => this.panels.get(name).element);
    if (!shown.length) shown.push(this.empty);
    if (shown.some((each, index) => this.box.children[index] !== each)) this.box.replaceChildren(...shown);
    this.box.dataset.count = names.length;
    this.list.shown = names;
    this.live.follow(names);
    document.title = names.length ? `${names.join(", ")} · Halocline` : "Halocline";
    this.tick();
  }

  /** One vehicle alone, or beside the others (and away again if it is there). */
  choose(name, beside) {
    const now = [...this.panels.keys()];
    let names = [name];
    if (beside && now.includes(name) && now.length > 1) names = now.filter((each) => each !== name);
    else if (beside && !now.includes(name)) names = [...now, name].slice(-MOST_PANELS);
    history.replaceState(null, "", `#show=${names.map(encodeURIComponent).join(",")}`);
    this.show(names);
  }

  tick() {
    find("clock").textContent = `${utc(Date.now() / 1000)} UTC`;
    const gone = this.lost !== null;
    this.server.className = `server ${gone ? "gone" : this.live.open ? "there" : ""}`;
    const seconds = gone ? Math.round((Date.now() - this.lost) / 1000) : 0;
    this.server.textContent = gone ? `Server gone for ${seconds} s, retrying …` : this.live.open ? "Live" : "Connecting …";
    document.body.classList.toggle("offline", gone);
    this.empty.textContent = gone
      ? "The server does not answer. This page tries again by itself."
      : "No vehicle has been heard of yet. They appear here by themselves.";
    this.list.draw();
    for (const panel of this.panels.values()) panel.tick(this.panels.size === 1);
  }
}

addEventListener("hashchange", () => page.arrange());
const page = new Page();
page.start();
