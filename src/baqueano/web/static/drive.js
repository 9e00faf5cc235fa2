// The screen that shows the vehicle now, and from which it is driven.

import { begin, colours, follow, line } from "./canvas.js";
import { choices, el, fill, key, number, select, show, write } from "./dom.js";
import { action, pressed } from "./hand.js";
import { Map2D } from "./map.js";
import { Honesty, Trail, across } from "./record.js";
import { groupsOf, stripList } from "./strips.js";
import { length, num, t } from "./strings.js";

const SPANS = [10, 20, 60]; // s, of the strips
const PACES = [0.25, 0.5, 1, 2, 4, 8]; // of the simulation: the stops of a slider

export class Drive {
  static key = "drive";

  constructor(page) {
    this.page = page;
    this.span = SPANS[1];
    this.laps = 3;
    const { record, hello } = page;
    this.map = new Map2D();
    const step = hello.vehicle.footprint.width_m / 18;
    this.estimate = new Trail(record, "eta.x", "eta.y", step, true);
    this.truth = new Trail(record, "truth.x", "truth.y", step);
    this.honesty = new HonestyCard(record);
    this.groups = groupsOf(record, hello.vehicle);
    this.strips = this.groups.flatMap(([, strips]) => strips);
    this.numbers = new Numbers();
    this.node = el("div.drive", this.map.card(mapKeys(record.has("truth.x")), this.numbers.node), this.#console(), this.#stripCard());
    this.state(page.state);
    this.routes(hello.routes);
  }

  #stripCard() {
    const since = el("span");
    const tell = (k) => { this.span = SPANS[k]; write(since, `−${SPANS[k]} s`); };
    tell(1);
    return el("section.card.strips", stripList(this.groups),
      el("footer", since, choices(t("strips.span"), SPANS.map((s) => `${s} s`), 1, tell), el("span", t("strips.now"))));
  }

  #console() {
    const { page } = this, { hand } = page;
    const { link } = page, mission = (kind, more) => link.send({ is: "mission", kind, ...more });
    this.teach = action("drive.teach", "KeyT", () => mission("teach", { name: this.#freeName() }), page);
    this.repeat = action("drive.repeat", "KeyR", () => mission("repeat", { route: this.route.value, laps: this.laps }), page);
    this.byHand = action("drive.by-hand", "KeyB", () => mission("drive"), page);
    this.pause = action("drive.pause", "KeyP", () => link.send({ is: page.state.paused ? "go" : "pause" }));
    this.mark = action("drive.mark", "KeyM", () => link.send({ is: "mark" }));
    this.end = action("drive.end", "KeyE", () => link.send({ is: "end" }));
    this.repeat.classList.add("repeat");
    this.actions = [this.teach, this.repeat, this.byHand, this.pause, this.mark, this.end];
    this.route = select(t("drive.route"), [], "", () => this.state(page.state));
    const count = el("output");
    const laps = (more) => { this.laps = Math.min(Math.max(this.laps + more, 1), 99); write(count, this.laps === 1 ? t("drive.one-lap") : t("drive.laps", { n: this.laps })); };
    laps(0);
    const share = el("input", { type: "range", min: "10", max: "100", step: "5", value: String(100 * hand.part), "aria-label": t("drive.stick-label") });
    const says = el("label.stick", el("span"), share);
    const tell = () => { hand.part = share.value / 100; write(says.firstChild, t("drive.stick", { part: num(Number(share.value), 0) })); share.style.setProperty("--part", `${(share.value - 10) / 0.9}%`); };
    share.addEventListener("input", tell);
    tell();
    const paces = el("input", { type: "range", min: "0", max: String(PACES.length - 1), "aria-label": t("drive.pace") });
    this.pace = el("label.stick.pace", el("span"), paces);
    this.pace.put = (factor) => {
      const k = PACES.reduce((best, one, n) => (Math.abs(Math.log(one / factor)) < Math.abs(Math.log(PACES[best] / factor)) ? n : best), 0), text = t("drive.pace-is", { n: { 0.125: "⅛", 0.25: "¼", 0.5: "½" }[factor] ?? num(factor, factor % 1 ? 1 : 0) });
      if (document.activeElement !== paces) paces.value = String(k);
      paces.style.setProperty("--part", `${(100 * k) / (PACES.length - 1)}%`);
      paces.setAttribute("aria-valuetext", text);
      write(this.pace.firstChild, text);
    };
    this.pace.put(page.state.pace ?? 1);
    paces.addEventListener("input", () => { this.pace.put(PACES[paces.value]); page.link.send({ is: "pace", factor: PACES[paces.value] }); });
    this.missions = el("div.choose", this.route,
      el("span.laps", { role: "group", "aria-label": t("drive.laps-label") },
        el("button", { "aria-label": t("drive.fewer"), onclick: () => laps(-1) }, "−"), count,
        el("button", { "aria-label": t("drive.more"), onclick: () => laps(1) }, "+")));
    this.controls = el("div.controls", el("div.actions", ...this.actions, this.pace), el("div.settings", this.missions, says));
    return el("section.card.console", { "aria-label": t("drive.controls") }, hand.pad, this.controls, this.honesty.node);
  }

  #freeName() {
    const taken = new Set(this.names);
    for (let k = 1; ; k++) if (!taken.has(`route-${k}`)) return `route-${k}`;
  }

  routes(names) {
    this.names = names;
    fill(this.route, names, this.route.value);
    show(this.missions, names.length > 0);
    this.state(this.page.state);
  }

  /** Say by the buttons what can be done now. */
  state(state) {
    const { page } = this, { mine } = page.hand, kind = state.mission?.kind ?? state.mission ?? null;
    const drives = page.hello.role === "drive", moves = page.moves;
    show(this.page.hand.pad, drives);
    show(this.controls, drives);
    const set = (button, free, pressed) => { button.disabled = !(mine && free); button.classList.toggle("off", !free && !pressed); button.setAttribute("aria-pressed", String(pressed)); };
    set(this.teach, state.state === "READY", kind === "teach");
    set(this.repeat, state.state === "READY" && this.names?.length > 0, kind === "repeat");
    set(this.byHand, state.state === "READY", kind === "drive");
    set(this.pause, moves, Boolean(state.paused));
    set(this.mark, moves, false);
    set(this.end, moves, false);
    write(this.repeat.firstChild, kind === "repeat" && state.laps ? `${t("drive.repeat")} · ${state.lap ?? 1}/${state.laps}` : t("drive.repeat"));
    write(this.pause.firstChild, t(state.paused ? "drive.go" : "drive.pause"));
    show(this.pause, page.hello.vehicle.world === "simulated");
    const paced = page.hello.vehicle.world === "simulated" && state.pace !== null && state.pace !== undefined;
    show(this.pace, paced);
    if (paced) this.pace.put(state.pace);
  }

  key(event, down) {
    return pressed(this.actions, event, down) || this.map.key(event, down);
  }

  draw() {
    const { page } = this, { record } = page, i = record.last;
    drawMap(this.map, page.route, record, this.estimate, this.truth, i, page.hello.vehicle.footprint);
    this.numbers.draw(record, i);
    const to = Math.max(record.end, record.start + 1e-3);
    for (const one of this.strips) one.draw(record, to - this.span, to, i);
    this.honesty.draw(i);
  }
}

/** The legend of a map: with a ghost beside it neither corridor nor truth is drawn. */
export const mapKeys = (truth, ghost = null) => [key("route", t("map.route")), key("estimate", t("map.estimate")), ...(ghost ? [key("ghosted", ghost)] : [key("corridor", t("map.corridor")), ...(truth ? [key("truth", t("map.truth"))] : [])])];

export function poseOf(record, i, names = "eta") {
  const pose = [`${names}.x`, `${names}.y`, `${names}.psi`].map((name) => record.value(name, i));
  return pose.every(Number.isFinite) ? pose : null;
}

/** Draw what Drive and Replay show alike. */
export function drawMap(map, route, record, estimate, truth, i, footprint, row, ghost = null) {
  const vehicles = [{ pose: poseOf(record, i), footprint, style: "now", sd_psi: Math.sqrt(record.value("P.psi", i)) }];
  const trails = [{ trail: estimate, style: "estimate", row }];
  const alone = !ghost;
  if (ghost) { trails.unshift({ trail: ghost.trail, style: "ghost", row: ghost.row }); vehicles.push({ pose: poseOf(ghost.record, ghost.row), footprint: ghost.footprint, style: "ghost" }); }
  if (alone && record.has("truth.x")) { trails.push({ trail: truth, style: "truth", row }); vehicles.push({ pose: poseOf(record, i, "truth"), footprint, style: "true" }); }
  const reference = [record.value("ref.x", i), record.value("ref.y", i)];
  map.draw({ route, trails, vehicles, reference: reference.every(Number.isFinite) ? reference : null });
}

/** The three large numbers. */
export class Numbers {
  constructor() {
    const one = (name) => { const value = el("b"), unit = el("span"); return { value, unit, node: number(t(`number.${name}`), value, unit) }; };
    [this.from, this.within, this.speed] = ["from-route", "within", "speed"].map(one);
    this.node = el("div.numbers", this.from.node, this.within.node, this.speed.node);
  }

  draw(record, i) {
    const put = ({ value, unit }, [text, of], sign = "") => { write(value, sign + text); write(unit, of); };
    put(this.from, length(Math.abs(record.value("cross", i))));
    const within = i < 0 ? NaN : 1.96 * across(record, i);
    put(this.within, length(within), Number.isFinite(within) ? "± " : "");
    put(this.speed, [num(Math.hypot(record.value("nu.u", i), record.value("nu.v", i)), 2), "m/s"]);
  }
}

/** How honest the filter is: the NIS of 10 s in its 95 % band, as a curve and in words. */
export class HonestyCard {
  constructor(record) {
    this.record = record;
    this.honesty = new Honesty(record);
    this.canvas = follow(el("canvas", { "aria-hidden": "true" }));
    this.verdict = el("strong");
    this.words = el("p", this.verdict, " ", el("span"));
    this.node = el("section.honesty", { "aria-label": t("honesty") }, el("h2", t("honesty")), this.words, this.canvas);
  }

  draw(i, from = null, to = null) {
    const now = this.honesty.at(i), kind = !now ? "unknown" : now.mean < now.low ? "below" : now.mean > now.high ? "above" : "inside";
    write(this.verdict, now ? `NIS ${num(now.mean, 2)}` : "NIS –");
    write(this.words.lastChild, t(`honesty.${kind}`));
    if (this.node.dataset.kind !== kind) this.node.dataset.kind = kind;
    const begun = begin(this.canvas);
    if (!begun) return;
    const [c, w, h] = begun, { record } = this;
    const end = to ?? record.end, start = from ?? end - 60, points = [];
    for (let x = 0; x <= w; x += 2) {
      const s = start + ((end - start) * x) / w;
      points.push([x, s < record.start || s > record.end ? null : this.honesty.at(record.row(s))]);
    }
    const off = points.reduce((most, [, one]) => (one ? Math.max(most, Math.abs(one.mean - 1)) : most), 0.25);
    const half = Math.min(1.2 * off, 1), Y = (v) => h / 2 - ((v - 1) / half) * (h / 2 - 2); // at most 0 to 2 times what it should be
    c.fillStyle = colours.band;
    const band = now ?? { low: 0.9, high: 1.1 };
    c.fillRect(0, Y(Math.min(band.high, 2)), w, Math.max(Y(Math.max(band.low, 0)) - Y(Math.min(band.high, 2)), 2));
    line(c, points.map(([x, one]) => one && [x, Y(Math.min(Math.max(one.mean, 0), 2))]), { above: colours.alarm, below: colours.sim }[kind] ?? colours.model, 1.8);
  }
}
