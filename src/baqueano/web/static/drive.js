// The screen that shows the vehicle now, and from which it is driven.

import { begin, colours, follow } from "./canvas.js";
import { choices, el, show, write } from "./dom.js";
import { moving } from "./hand.js";
import { Map2D } from "./map.js";
import { Honesty, Trail, across } from "./record.js";
import { groupsOf, stripList } from "./strips.js";
import { length, num, t } from "./strings.js";

const SPANS = [10, 20, 60]; // s, of the strips
const PACES = [0.25, 1, 2, 4, 8];

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
    this.node = el("div", { class: "drive" }, this.#mapCard(), this.#console(), this.#stripCard());
    this.state(page.state);
    this.routes(hello.routes);
  }

  #mapCard() {
    this.numbers = this.map.beside = new Numbers();
    return el("section", { class: "card map-card" }, mapLegend(this.page.record.has("truth.x")), this.map.canvas, this.map.buttons, this.numbers.node);
  }

  #stripCard() {
    const since = el("span", {});
    const tell = (k) => { this.span = SPANS[k]; write(since, `−${SPANS[k]} s`); };
    tell(1);
    return el("section", { class: "card strips" }, stripList(this.groups),
      el("footer", {}, since, choices(t("strips.span"), SPANS.map((s) => `${s} s`), 1, tell), el("span", {}, t("strips.now"))));
  }

  #console() {
    const { page } = this, { hand } = page;
    const button = (key, code, act, move = false) => {
      const made = el("button", { type: "button", class: "action" }, el("span", {}, t(key)), el("kbd", {}, code.slice(3)));
      made.code = code;
      if (move) moving(made, page, act);
      else { made.press = () => { if (!made.disabled) act(); }; made.addEventListener("click", made.press); }
      return made;
    };
    this.teach = button("drive.teach", "KeyT", () => page.link.send({ is: "mission", kind: "teach", name: this.#freeName() }), true);
    this.repeat = button("drive.repeat", "KeyR", () => page.link.send({ is: "mission", kind: "repeat", route: this.route.value, laps: this.laps }), true);
    this.byHand = button("drive.by-hand", "KeyB", () => page.link.send({ is: "mission", kind: "drive" }), true);
    this.pause = button("drive.pause", "KeyP", () => page.link.send({ is: page.state.paused ? "go" : "pause" }));
    this.mark = button("drive.mark", "KeyM", () => page.link.send({ is: "mark" }));
    this.end = button("drive.end", "KeyE", () => page.link.send({ is: "end" }));
    this.repeat.classList.add("repeat");
    this.actions = [this.teach, this.repeat, this.byHand, this.pause, this.mark, this.end];
    this.route = el("select", { id: "route", "aria-label": t("drive.route") });
    this.route.addEventListener("change", () => this.state(page.state));
    const count = el("output", {});
    const laps = (more) => { this.laps = Math.min(Math.max(this.laps + more, 1), 99); write(count, this.laps === 1 ? t("drive.one-lap") : t("drive.laps", { n: this.laps })); };
    laps(0);
    const share = el("input", { type: "range", min: "10", max: "100", step: "5", value: String(100 * hand.part), "aria-label": t("drive.stick-label") });
    const says = el("label", { class: "stick" }, el("span", {}), share);
    const tell = () => { hand.part = share.value / 100; write(says.firstChild, t("drive.stick", { part: num(Number(share.value), 0) })); share.style.setProperty("--part", `${(share.value - 10) / 0.9}%`); };
    share.addEventListener("input", tell);
    tell();
    this.paces = el("select", { class: "pace", "aria-label": t("drive.pace") }, ...PACES.map((one) => el("option", { value: String(one) }, t("drive.pace-is", { n: one === 0.25 ? "¼" : one }))));
    this.paces.value = String(page.state.pace ?? 1);
    this.paces.addEventListener("change", () => page.link.send({ is: "pace", factor: Number(this.paces.value) }));
    this.missions = el("div", { class: "choose" }, this.route,
      el("span", { class: "laps", role: "group", "aria-label": t("drive.laps-label") },
        el("button", { type: "button", "aria-label": t("drive.fewer"), onclick: () => laps(-1) }, "−"), count,
        el("button", { type: "button", "aria-label": t("drive.more"), onclick: () => laps(1) }, "+")));
    this.controls = el("div", { class: "controls" }, el("div", { class: "actions" }, ...this.actions, this.paces), el("div", { class: "settings" }, this.missions, says));
    return el("section", { class: "card console", "aria-label": t("drive.controls") }, hand.pad, this.controls, this.honesty.node);
  }

  #freeName() {
    const taken = new Set(this.names);
    for (let k = 1; ; k++) if (!taken.has(`route-${k}`)) return `route-${k}`;
  }

  routes(names) {
    this.names = names;
    const kept = this.route.value;
    this.route.replaceChildren(...names.map((name) => el("option", { value: name }, name)));
    if (names.includes(kept)) this.route.value = kept;
    show(this.missions, names.length > 0);
    this.state(this.page.state);
  }

  /** Say by the buttons what can be done now. */
  state(state) {
    const { page } = this, mine = page.hand.mine, kind = state.mission?.kind ?? state.mission ?? null;
    const drives = page.hello.role === "drive", moves = ["MISSION", "MANUAL"].includes(state.state);
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
    show(this.paces, page.hello.vehicle.world === "simulated" && state.pace !== null && state.pace !== undefined);
  }

  key(event, down) {
    const button = this.actions.find((one) => one.code === event.code);
    if (button && !button.hidden && !event.ctrlKey && !event.metaKey && !event.altKey) {
      if (!down) button.drop?.();
      else if (!event.repeat) button.press();
      return true;
    }
    return mapKey(this.map, event, down);
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

export function mapKey(map, event, down) {
  const act = { KeyF: () => map.to("follow"), Digit0: () => map.to("fit"), Equal: () => map.zoom(1.25), NumpadAdd: () => map.zoom(1.25), Minus: () => map.zoom(0.8), NumpadSubtract: () => map.zoom(0.8) }[event.code]
    ?? (event.key === "+" ? () => map.zoom(1.25) : event.key === "-" ? () => map.zoom(0.8) : null);
  if (!act || event.ctrlKey || event.metaKey || event.altKey) return false;
  if (down) act();
  return true;
}

export function mapLegend(truth, ghost = null) {
  const known = ghost === null;
  const one = (kind, text) => el("span", { class: `key ${kind}` }, el("i", { "aria-hidden": "true" }), text);
  return el("div", { class: "legend map-legend" }, one("route", t("map.route")), one("estimate", t("map.estimate")), known ? one("corridor", t("map.corridor")) : null,
    truth && known ? one("truth", t("map.truth")) : null, ghost ? one("ghosted", ghost) : null);
}

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
    const one = (key) => { const value = el("b", {}), unit = el("span", {}); return { value, unit, node: el("div", { class: "number" }, el("span", { class: "of" }, t(key)), el("span", { class: "much" }, value, unit)) }; };
    this.from = one("number.from-route");
    this.within = one("number.within");
    this.speed = one("number.speed");
    this.node = el("div", { class: "numbers" }, this.from.node, this.within.node, this.speed.node);
  }

  /** Return the width that the numbers take beside the map; below it they take none. */
  get width() { return getComputedStyle(this.node).position === "absolute" ? this.node.offsetWidth : 0; }

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
    this.verdict = el("strong", {});
    this.words = el("p", {}, this.verdict, " ", el("span", {}));
    this.node = el("section", { class: "honesty", "aria-label": t("honesty") }, el("h2", {}, t("honesty")), this.words, this.canvas);
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
    c.strokeStyle = { above: colours.alarm, below: colours.sim }[kind] ?? colours.model;
    c.lineWidth = 1.8;
    c.lineJoin = "round";
    c.beginPath();
    let open = false;
    for (const [x, one] of points) {
      if (!one) { open = false; continue; }
      const y = Y(Math.min(Math.max(one.mean, 0), 2));
      if (open) c.lineTo(x, y); else c.moveTo(x, y);
      open = true;
    }
    c.stroke();
  }
}
