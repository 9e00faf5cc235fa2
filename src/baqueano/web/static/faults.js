// Faults of a simulated vehicle: push it, tilt its floor, break its sensors; who noticed, when; and the same again without.

import { arrow, begin, colours, dot, follow, label, line } from "./canvas.js";
import { choices, el, key, select, show, write } from "./dom.js";
import { poseOf } from "./drive.js";
import { action, pressed, stick } from "./hand.js";
import { Map2D } from "./map.js";
import { Record, Trail } from "./record.js";
import { num, t, three } from "./strings.js";

const PACES = [0.125, 0.25, 1, 4];
const PUSH = 0.003, MOST_PUSH = 0.6, KEY_PUSH = 0.2; // N s: of a pixel, at most, of a key
const STEEPEST = 0.1, KEY_TILT = Math.PI / 360; // rad: at the edge of the pad, of a key
const SPAN = 20; // s, of the strip
const ARROWS = { ArrowUp: [0, 1], ArrowDown: [0, -1], ArrowLeft: [-1, 0], ArrowRight: [1, 0] };
const BEFORE = 1; // s, that the twin is seen before the fault

export class Faults {
  static key = "faults";

  constructor(page) {
    this.page = page;
    this.rows = [];
    this.tilt = [0, 0]; // rise towards x and y of the map [rad]
    const { record, hello } = page, { footprint } = hello.vehicle;
    this.map = new Map2D();
    this.map.canvas.setAttribute("aria-label", t("faults.map"));
    const step = footprint.width_m / 18;
    this.estimate = new Trail(record, "eta.x", "eta.y", step, true);
    this.truth = new Trail(record, "truth.x", "truth.y", step);
    this.#pushes();
    this.ghostKey = key("ghosted", t("faults.before"));
    const keys = { route: "map.route", estimate: "map.estimate", truth: "map.truth", pushed: "faults.push" };
    this.tiltCard = this.#tiltCard();
    this.map.beside = () => (this.tiltCard.offsetTop > this.map.canvas.offsetHeight ? 0 : this.tiltCard.offsetWidth);
    this.hint = el("p.hint", t("faults.drag"));
    this.node = el("div.faults", this.map.card([...Object.entries(keys).map(([kind, name]) => key(kind, t(name))), this.ghostKey], this.hint), this.tiltCard, this.#breakers(), this.#ledgerCard(), this.#bar());
    this.#before(null);
    this.ledger(page.ledger);
  }

  /** Dragging with one finger or the mouse pushes; two fingers still move the map. */
  #pushes() {
    const { canvas } = this.map;
    let from = null;
    const over = () => { from = this.drag = null; };
    canvas.addEventListener("pointerdown", (e) => { if (from) over(); else if (e.isPrimary) from = [e.offsetX, e.offsetY]; }, true);
    canvas.addEventListener("pointermove", (e) => {
      if (!from || !e.isPrimary) return;
      this.drag = [...from, e.offsetX, e.offsetY];
      e.stopImmediatePropagation();
    }, true);
    canvas.addEventListener("pointerup", () => {
      const { drag } = this;
      over();
      if (drag && Math.hypot(drag[2] - drag[0], drag[3] - drag[1]) > 8) this.#send({ kind: "push", frame: "map", ...impulse(drag) });
    }, true);
    canvas.addEventListener("pointercancel", over, true);
  }

  #tiltCard() {
    this.steep = el("output");
    this.pad = stick(t("faults.tilt-label"), 92, () => true, (x, y) => this.#lean([STEEPEST * x, STEEPEST * y]), () => this.#tilted());
    this.pad.classList.add("live");
    const level = el("button.quiet-text", { onclick: () => { this.#lean([0, 0]); this.#tilted(); } }, t("faults.level"));
    this.#lean(this.tilt);
    return el("section.card.tilt", el("h2", t("faults.tilt")), this.pad, el("p", this.steep, level));
  }

  #lean(tilt) {
    this.tilt = tilt;
    this.pad.put(tilt[0] / STEEPEST, tilt[1] / STEEPEST);
    write(this.steep, `${num((Math.hypot(...tilt) * 180) / Math.PI, 1)}°`);
  }

  #tilted() { this.#send({ kind: "tilt", x: this.tilt[0], y: this.tilt[1] }); }

  #breakers() {
    const { vehicle } = this.page.hello, { sensors = [] } = vehicle, imu = sensors.find((one) => one.kind === "imu"), of = (imu ?? sensors[0])?.name;
    const unit = (channel) => this.page.record.field(`z.${of}[${channel}]`)?.unit ?? "", parts = (...all) => all.map((part) => [`${100 * part} %`, { part }]), gyro = imu ? 2 : 0;
    const kinds = {
      cut: sensors.map(({ name }) => [name, { of: name }]),
      drift: of ? [0.15, 0.05, 0.5].map((size) => [`+ ${num(size, 2)} ${unit(gyro)}`, { of: `${of}[${gyro}]`, size }]) : [],
      spikes: of ? [5, 20].map((size) => [`± ${size} ${unit(0)}, 2 %`, { of: `${of}[0]`, size, part: 0.02 }]) : [],
      slip: (vehicle.footprint.kind === "car" ? ["all"] : ["left", "right", "all"]).map((one) => [`${t(`faults.wheel-${one}`)}, 30 %`, { of: one, part: 0.3 }]),
      sag: parts(0.84, 0.7), lose: parts(0.3, 0.6),
    };
    this.breakers = Object.entries(kinds).filter(([, options]) => options.length).map(([kind, options]) => this.#breaker(kind, options, t(imu && /drift|spikes/.test(kind) ? `faults.${kind}-imu` : `faults.${kind}`)));
    return el("section.card.breakers", el("header", el("h2", t("faults.break")), el("span", t("faults.simulated"))), ...this.breakers.map((one) => one.node));
  }

  #breaker(kind, options, name) {
    const lasts = el("b.lasts"), which = options.length > 1 ? select(`${name}: ${t("faults.how")}`, options.map(([text], k) => [k, text])) : el("span.how", options[0][0]);
    const button = el("button", { role: "switch", "aria-label": name, onclick: () => {
      const active = this.#active(kind);
      this.#send(active ? { over: active.number } : { kind, ...options[which.value ?? 0][1] });
    } }, el("i", { "aria-hidden": "true" }));
    return { kind, lasts, button, node: el("div.breaker", button, el("span.of", name), which, lasts) };
  }

  /** Return the fault of this kind that lasts. */
  #active(kind) { return this.rows.findLast((row) => row.fault.kind === kind && !row.over); }

  #send(word) {
    if (!this.page.hand.mine) { this.page.say(t("pad.take")); return; }
    this.page.link.send({ is: "shake", ...word });
  }

  #ledgerCard() {
    this.list = el("ol.ledger", { "aria-live": "polite", tabindex: "0", "aria-label": t("faults.ledger") });
    return el("section.card.ledger-card", el("h2", t("faults.ledger")), this.list);
  }

  #bar() {
    const { page } = this, { link } = page;
    this.start = action("faults.start", "KeyR", () => this.#begin());
    this.pause = action("drive.pause", "KeyP", () => link.send({ is: page.state.paused ? "go" : "pause" }));
    this.tick = action("faults.tick", "KeyN", () => link.send({ is: "go", ticks: 1 }));
    this.again = action("faults.again", "KeyG", () => this.#again(this.rows.at(-1)));
    this.again.classList.add("again");
    this.start.classList.add("primary");
    this.actions = [this.start, this.pause, this.tick, this.again];
    const paces = choices(t("drive.pace"), PACES.map((one) => `${{ 0.125: "⅛", 0.25: "¼" }[one] ?? one} ×`), PACES.indexOf(page.state.pace ?? 1), (k) => link.send({ is: "pace", factor: PACES[k] }));
    this.strip = follow(el("canvas", { role: "img", "aria-label": t("faults.strip") }));
    const legend = el("p.legend", key("truth", t("faults.error")), key("estimate", t("faults.believed")));
    return el("section.card.fault-bar", { "aria-label": t("replay.controls") }, el("div.actions", this.start, this.pause, this.tick, paces), el("div.error-strip", this.strip, legend), this.again);
  }

  /** Drive something that drives itself, so that it can be driven again. */
  #begin() {
    const { page } = this, route = page.screens.drive?.names?.[0];
    this.#before(null);
    page.link.send(route ? { is: "mission", kind: "repeat", route, laps: 5 } : { is: "mission", kind: "experiment", seconds: 120 });
  }

  /** Keep a drive as a ghost, or none. */
  #before(ghost) { this.ghost = ghost; show(this.ghostKey, Boolean(ghost)); }

  /** Drive the same again without a fault; what was driven until now stays as a ghost. */
  #again(row) {
    const { page } = this, { record } = page;
    if (!row) return;
    const copy = new Record(record.fields, Math.max(record.length, 64), false);
    copy.columns = record.columns.map((column) => column.slice(0, record.length));
    copy.length = record.length;
    this.#before({ record: copy, trail: new Trail(copy, "truth.x", "truth.y", this.truth.step_m), pushes: this.#arrows(copy) });
    page.link.send({ is: "again", from_s: Math.max(0, row.t_s - BEFORE), without: [row.number] });
  }

  ledger(rows) {
    this.rows = rows;
    const last = rows.at(-1);
    this.list.replaceChildren(...(rows.length ? rows.toReversed().map((row) => this.#entry(row)) : [el("li.none", t("faults.none"))]));
    for (const made of this.breakers) made.button.setAttribute("aria-checked", String(Boolean(this.#active(made.kind))));
    const tilt = this.#active("tilt");
    if (!this.pad.matches(":active")) this.#lean(tilt ? [tilt.fault.x, tilt.fault.y] : [0, 0]);
    write(this.again.firstChild, last ? t("faults.again-of", { what: last.what }) : t("faults.again"));
    this.state();
  }

  #entry(row) {
    const lines = row.noticed.map((one) => el("p.noticed", el("b", one.who), ` ${t("faults.after", { s: num(one.after_s, one.after_s < 0.95 ? 2 : 1) })}: `, el("span", one.text)));
    if (row.nobody) lines.push(el("p.nobody", el("b", t("faults.nobody")), ` ${row.nobody}`));
    else if (row.noticed.length) lines.push(el("p.silent", `${t("faults.silent")} ${row.silent.join(", ")}`));
    else lines.push(el("p.silent", t("faults.wait")));
    const long = row.over && row.fault.kind !== "push" ? t("faults.over", { s: num(row.until_s - row.t_s, 1) }) : "";
    return el("li", el("time", num(row.t_s, 1)), el("div", el("p.what", el("b", row.what), " ", el("span", long)), ...lines));
  }

  state() {
    const { state, moves, hand: { mine } } = this.page;
    show(this.start, !moves);
    show(this.pause, moves);
    this.start.disabled = !(mine && state.state === "READY");
    this.pause.disabled = this.tick.disabled = !(mine && moves);
    this.again.disabled = !(mine && this.rows.length && state.state !== "STOPPED");
    write(this.pause.firstChild, t(state.paused ? "drive.go" : "drive.pause"));
  }

  key(event, down) {
    const way = ARROWS[event.code];
    if (way && event.target === this.pad) {
      if (down) { const lean = this.tilt.map((x, k) => x + KEY_TILT * way[k]); if (Math.hypot(...lean) <= STEEPEST) this.#lean(lean); } else this.#tilted();
      return true;
    }
    if (way && event.shiftKey) { if (down && !event.repeat) this.#send({ kind: "push", frame: "map", x: KEY_PUSH * way[0], y: KEY_PUSH * way[1] }); return true; }
    return pressed(this.actions, event, down) || this.map.key(event, down);
  }

  /** Return the pushes of the ledger where they met the vehicle: [x, y, to x, to y, N s]. */
  #arrows(record) {
    return this.rows.filter((row) => row.fault.kind === "push" && row.t_s >= record.start).map(({ t_s, fault }) => {
      const pose = poseOf(record, record.row(t_s), "truth");
      if (!pose) return null;
      const turn = fault.frame === "map" ? 0 : pose[2], c = Math.cos(turn), s = Math.sin(turn);
      return [pose[0], pose[1], c * fault.x - s * fault.y, s * fault.x + c * fault.y];
    }).filter(Boolean);
  }

  draw() {
    const { page, map, ghost } = this, { record } = page, i = record.last, { footprint } = page.hello.vehicle, truth = poseOf(record, i, "truth"), believed = poseOf(record, i);
    const vehicles = [{ pose: truth, footprint, style: "now" }], trails = [{ trail: this.estimate, style: "estimate" }, { trail: this.truth, style: "truth" }];
    if (ghost) {
      trails.unshift({ trail: ghost.trail, style: "ghost" });
      const row = ghost.record.row(record.end);
      vehicles.push({ pose: poseOf(ghost.record, row, "truth"), footprint, style: "ghost" });
    }
    map.draw({ route: page.route, trails, vehicles });
    const c = map.canvas.context;
    if (c && map.X) {
      if (believed) this.#believed(c, believed, truth, footprint);
      for (const one of ghost?.pushes ?? []) this.#arrow(c, one, colours.ghost);
      for (const one of this.#arrows(record)) this.#arrow(c, one, colours.alarm);
      if (this.drag) { const { x, y } = impulse(this.drag); pushed(c, this.drag, colours.alarm, `${num(Math.hypot(x, y), 2)} N s`); }
    }
    show(this.hint, !this.rows.length && !this.drag);
    for (const made of this.breakers) { const row = this.#active(made.kind); write(made.lasts, row ? `${three(Math.max(0, record.end - row.t_s))} s` : ""); }
    this.#errors(record);
  }

  #believed(c, [x, y], truth, { width_m }) {
    const { map } = this, px = map.X(x), py = map.Y(y);
    dot(c, px, py, Math.max(0.55 * width_m * map.view.scale, 11), null, colours.model);
    dot(c, px, py, 4, colours.model);
    if (!truth || Math.hypot(px - map.X(truth[0]), py - map.Y(truth[1])) < 2.2 * colours.rem) return;
    const up = py < map.Y(truth[1]) ? -1 : 1, far = Math.max(0.55 * width_m * map.view.scale, 14) + 0.8 * colours.rem;
    label(c, t("faults.believed-here"), px, py + up * far, colours.model);
    label(c, t("faults.true-here"), map.X(truth[0]), map.Y(truth[1]) - up * far, colours.ink);
  }

  #arrow(c, [x, y, dx, dy], colour) {
    const much = Math.hypot(dx, dy), px = this.map.X(x), py = this.map.Y(y), long = Math.min(Math.max(much / PUSH, 26), 90), ux = dx / much, uy = -dy / much, near = 12;
    pushed(c, [px - ux * (long + near), py - uy * (long + near), px - ux * near, py - uy * near], colour, `${num(much, 2)} N s`);
  }

  /** How far off the estimate is, and how far it believes to be, with a line for each fault. */
  #errors(record) {
    const begun = begin(this.strip);
    if (!begun || record.length < 2) return;
    const [c, w, h] = begun, end = Math.max(record.end, record.start + SPAN), from = end - SPAN, left = 3.6 * colours.rem, wide = w - left, X = (s) => left + ((s - from) / SPAN) * wide, points = [];
    let most = 0.02;
    for (let x = 0; x <= wide; x += 2) {
      const s = from + (SPAN * x) / wide;
      if (s < record.start || s > record.end) continue;
      const i = record.row(s), v = (name) => record.value(name, i), middle = (v("P.xx") + v("P.yy")) / 2;
      const off = Math.hypot(v("eta.x") - v("truth.x"), v("eta.y") - v("truth.y")), within = 1.96 * Math.sqrt(Math.max(middle + Math.hypot((v("P.xx") - v("P.yy")) / 2, v("P.xy")), 0));
      points.push([left + x, off, within]);
      most = Math.max(most, off, within);
    }
    for (const { t_s, fault } of this.rows) if (t_s > from) { c.fillStyle = fault.kind === "tilt" ? colours.sim : colours.alarm; c.fillRect(X(t_s) - 0.75, 0, 1.5, h); }
    for (const [k, colour, width, dash] of [[2, "model", 2.2, []], [1, "ink", 1.6, [5, 4]]]) line(c, points.map((one) => [one[0], h - 3 - (one[k] / most) * (h - 6)]), colours[colour], width, dash);
    label(c, `${num(100 * most, most < 0.1 ? 1 : 0)} cm`, 0, 0.6 * colours.rem, colours.muted, "left");
  }
}

/** Return the impulse [N s] of a drag on the canvas. */
function impulse([x0, y0, x1, y1]) {
  const x = PUSH * (x1 - x0), y = PUSH * (y0 - y1), less = Math.min(1, MOST_PUSH / Math.hypot(x, y));
  return { x: x * less, y: y * less };
}

function pushed(c, [x0, y0, x1, y1], colour, text) {
  const long = Math.hypot(x1 - x0, y1 - y0), ux = (x1 - x0) / long, uy = (y1 - y0) / long;
  if (long < 4) return;
  c.lineCap = "butt";
  arrow(c, [[x0, y0], [x1, y1]], colour, 3.5, 12);
  label(c, text, x0 - ux * 8, y0 - uy * 8 - (Math.abs(uy) < 0.5 ? 0.9 * colours.rem : 0), colour);
}
