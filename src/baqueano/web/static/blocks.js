// The diagram of the blocks, alive: on each wire what travels there now, in each block who sits there.

import { arrow, begin, colours, follow, line } from "./canvas.js";
import { choices, el, empty, region, select, write } from "./dom.js";
import { Strip } from "./strips.js";
import { num, t, three } from "./strings.js";

const SPAN = 10; // s, on a wire
// Where each stands is a matter of the style sheet: `at-…`.
const BLOCKS = ["vehicle", "sensors", "estimator", "guide", "controller", "supervisor"];
const WIRES = [["vehicle", "sensors"], ["sensors", "estimator"], ["estimator", "guide"], ["guide", "controller"], ["estimator", "controller"], ["controller", "supervisor"], ["supervisor", "vehicle"]];
const LOOP = BLOCKS.slice(2); // whose step a tick pays for
const VIEWS = ["signals", "parameters", "text"];
const ON_WIRE = ["measured", "estimate", "reference", "asked", "command"];

export class Blocks {
  static key = "blocks";

  constructor(page) {
    this.page = page;
    this.node = el("div.blocks");
    this.picked = "estimator";
    this.view = 0;
    this.known = {};
    this.build();
  }

  /** What the screen shows: the live drive, or the run that is open. */
  get source() {
    const { page } = this, open = page.hello.mode === "replay";
    return open ? { record: page.opened?.record, vehicle: page.opened?.about.vehicle, blocks: page.opened?.about.blocks } : { record: page.record, vehicle: page.hello.vehicle, blocks: page.hello.blocks };
  }

  get run() { return this.page.hello.mode === "replay" ? { run: this.page.opened?.about.run.id } : {}; }
  opened() { this.known = {}; this.build(); }
  blocks() { this.known = {}; this.build(); if (this.page.screen === this) this.shown(); }
  shown() { if (this.wires) for (const key of LOOP) this.#learn(key); }

  /** Ask what a block is, once. */
  #learn(key) {
    const { known } = this;
    if (known[key] !== undefined) return;
    known[key] = null;
    this.page.link.ask("block", { ...this.run, room: key }, (word) => {
      if (known !== this.known) return;
      known[key] = word;
      if (word.step_us) write(this.costs[key], `${three(word.step_us)} µs`);
      if (key === this.picked) this.#show();
    });
  }

  build() {
    const { record, vehicle, blocks } = this.source;
    if (!record) { this.node.replaceChildren(empty(t("replay.none"))); return; }
    this.wires = follow(el("canvas.wires", { "aria-hidden": "true" }));
    const names = { vehicle: blocks?.model ?? vehicle.name, sensors: [...new Set(record.channels.map((one) => one.replace(/[.[].*$/, "")))].join(", "), estimator: blocks?.estimator, guide: blocks?.guide, controller: blocks?.controller, supervisor: t("block.supervisor-does") };
    this.costs = Object.fromEntries(BLOCKS.map((key) => [key, el("i", this.known[key]?.step_us ? `${three(this.known[key].step_us)} µs` : "")]));
    this.boxes = Object.fromEntries(BLOCKS.map((key) => {
      const box = el(`button.block.at-${key}`, { "aria-pressed": String(key === this.picked), onclick: () => this.pick(key) }, el("b", t(`block.${key}`)), el("span", names[key] ?? t("block.none")), this.costs[key]);
      return [key, box];
    }));
    const lines = this.#lines(record, vehicle);
    this.sparks = Object.fromEntries(ON_WIRE.filter((key) => lines[key].length).map((key) => {
      const canvas = follow(el("canvas", { "aria-hidden": "true" }));
      const value = el("b");
      const units = new Set(lines[key].map((name) => record.field(name).unit)), unit = units.size === 1 ? [...units][0] : "";
      const node = el(`div.spark.at-${key}`, el("p", el("span", `${t(`wire.${key}`)} `, el("small", unit)), value), canvas);
      return [key, { canvas, node, value, lines: lines[key], range: [NaN, NaN] }];
    }));
    this.world = el("span.world-label", t("block.world"));
    this.late = el("b");
    this.tick = el("div.tick", el("span", t("block.tick", { ms: num(1000 / vehicle.rate_hz, 0) })), this.late, el("span", t("block.late")));
    this.side = el("aside.card.side", { "aria-live": "polite" });
    this.node.replaceChildren(el("section.card.diagram", this.wires, this.world, ...Object.values(this.boxes), ...Object.values(this.sparks).map((one) => one.node), record.has("late_ms") ? this.tick : null), this.side);
    this.names = names;
    this.pick(this.picked);
  }

  #lines(record, vehicle) {
    const live = vehicle.command.flatMap(({ low, high }, k) => (low < high ? [k] : []));
    const known = (names) => names.filter((name) => record.has(name));
    return { measured: known(record.channels.slice(0, 3).map((one) => `z.${one}`)), estimate: known(["eta.x", "eta.y"]), reference: known(["ref.x", "ref.y"]), asked: known(live.map((k) => `asked.${k}`)), command: known(live.map((k) => `u.${k}`)) };
  }

  /** Show what a block takes and gives. */
  pick(key) {
    this.picked = key;
    const { record, vehicle } = this.source;
    for (const [name, box] of Object.entries(this.boxes)) box.setAttribute("aria-pressed", String(name === key));
    const channels = record.channels, innovation = (one) => ({ title: t("strip.innovation", { of: record.field(`innov.${one}`).label }), unit: record.field(`innov.${one}`).unit, traces: [{ name: `innov.${one}`, line: "measured" }], band: `S.${one}` });
    const plain = (name, title, unit, line = "model") => ({ title, unit, traces: [{ name, line }] });
    const live = vehicle.command.flatMap(({ low, high }, k) => (low < high ? [k] : []));
    const commands = live.map((k) => ({ title: record.field(`u.${k}`)?.label ?? `u.${k}`, unit: vehicle.command[k].unit, traces: [{ name: `u.${k}`, line: "applied" }, { name: `asked.${k}`, line: "asked" }] }));
    const specs = {
      vehicle: [plain("nu.u", t("strip.speed"), "m/s"), plain("nu.r", t("strip.turn"), "rad/s")],
      sensors: channels.map((one) => ({ title: record.field(`z.${one}`).label, unit: record.field(`z.${one}`).unit, traces: [{ name: `z.${one}`, line: "measured" }, { name: `model.${one}`, line: "model" }] })),
      estimator: [...channels.filter((one) => record.has(`innov.${one}`)).map(innovation), plain("nis", t("strip.nis"), "", "measured")],
      guide: [plain("ref.u", t("strip.wanted-speed"), "m/s"), plain("progress", t("strip.progress"), "m"), plain("cross", t("strip.cross"), "m")],
      controller: commands, supervisor: commands,
    }[key];
    this.strips = specs.map((one) => ({ ...one, traces: one.traces.filter(({ name }) => record.has(name)) })).filter((one) => one.traces.length).slice(0, 5).map((one) => new Strip(one));
    this.content = region("div.content", t(`block.${key}`));
    this.other = el("div.other");
    this.foot = el("footer");
    this.side.replaceChildren(el("h2", t(`block.${key}`)), el("p.who", this.names[key] ?? t("block.none")), el("p", t(`block.${key}-about`)), this.other, choices(t("block.views"), VIEWS.map((one) => t(`block.${one}`)), this.view, (k) => { this.view = k; this.#show(); }), this.content, this.foot);
    this.#show();
    this.#learn(key);
  }

  /** Show signals, parameters or text of the block that is picked, what its step costs, and what may take its place. */
  #show() {
    const about = this.known[this.picked], { content, picked, page } = this, wait = el("p", about?.no ?? t("block.asking"));
    content.classList.toggle("strip-list", this.view === 0);
    if (this.view === 0) content.replaceChildren(...this.strips.map((one) => one.node));
    else if (!about?.text) content.replaceChildren(wait);
    else if (this.view === 1) content.replaceChildren(about.parameters.length ? el("table", ...about.parameters.map(({ name, unit, meaning, value, shape }) => el("tr", el("th", { scope: "row" }, name, el("small", meaning)), el("td", value ? value.map(three).join(" ") : shape, " ", el("small", unit))))) : el("p", t("block.no-parameters")));
    else {
      const text = el("pre", about.text);
      content.replaceChildren(text);
      content.scrollTop = (about.line / about.text.split("\n").length) * text.scrollHeight;
    }
    if (!about?.text) return;
    const line = (what, node) => el("p", el("span", what), node), result = el("button.action", { onclick: () => this.#check(result) }, t("block.check"));
    this.foot.replaceChildren(el("p.file", about.file), about.step_us ? line(t("block.step", { of: num(about.tick_us / 1000, 0) }), el("b", `${three(about.step_us)} µs`)) : "", line("blocks check", result));
    if (!about.kinds.length || page.hello.mode !== "live") return;
    const others = select(t("block.swap"), about.kinds, about.kind, (kind) => page.link.send({ is: "swap", room: picked, kind }));
    others.disabled = page.hello.role !== "drive";
    this.other.replaceChildren(el("label.pick", t("block.swap"), others), page.hello.swapped?.[picked] ? el("span.chip.gold", t("block.next")) : "");
  }

  #check(result) {
    const { kind } = this.known[this.picked];
    write(result, t("block.checking"));
    this.page.link.ask("check", { ...this.run, room: this.picked, kind }, ({ findings, no }) => {
      const good = findings?.length === 0;
      result.replaceWith(good ? el("b.good", t("block.sound")) : el("span.bad", no ?? findings.join(" ")));
    });
  }

  draw() {
    const { record } = this.source;
    if (!record?.length || !this.wires) return;
    const at = this.page.screens.replay?.now_s, replayed = this.page.hello.mode === "replay";
    const i = replayed ? record.row(at ?? record.end) : record.last, to = Math.max(record.t[i], record.start + 1e-3), from = to - SPAN;
    for (const one of this.strips) one.draw(record, from, to, i);
    write(this.late, `${num(record.value("late_ms", i), 1)} ms`);
    for (const one of Object.values(this.sparks)) this.#spark(one, record, from, to, i);
    this.#wire();
  }

  #spark(spark, record, from, to, i) {
    write(spark.value, spark.lines.slice(0, 2).map((name) => three(record.value(name, i))).join(" · "));
    const begun = begin(spark.canvas);
    if (!begun) return;
    const [c, w, h] = begun, first = record.lower(from), columns = spark.lines.map((name) => record.column(name));
    let low = Infinity, high = -Infinity;
    for (const v of columns) for (let k = first; k <= i; k++) { if (v[k] < low) low = v[k]; if (v[k] > high) high = v[k]; }
    if (!(low < high)) [low, high] = [low - 1, low + 1];
    const every = Math.max(1, Math.floor((i - first) / (2 * w)));
    columns.forEach((v, n) => {
      const points = [];
      for (let k = first; k <= i; k += every) points.push(Number.isFinite(v[k]) ? [((record.t[k] - from) / (to - from)) * w, h - 2 - ((v[k] - low) / (high - low)) * (h - 4)] : null);
      line(c, points, [colours.measured, colours.model, colours.ghost][n], 1.3, [[], [5, 2], [2, 2]][n]);
    });
  }

  /** Draw the wires between the boxes, wherever the grid has put them. */
  #wire() {
    const begun = begin(this.wires);
    if (!begun) return;
    const [c] = begun, home = this.wires.getBoundingClientRect();
    const box = (node) => { const b = node.getBoundingClientRect(); return { l: b.left - home.left, r: b.right - home.left, t: b.top - home.top, b: b.bottom - home.top, x: (b.left + b.right) / 2 - home.left, y: (b.top + b.bottom) / 2 - home.top }; };
    const at = Object.fromEntries(Object.entries(this.boxes).map(([key, node]) => [key, box(node)]));
    const world = { l: at.vehicle.l - 12, t: at.vehicle.t - 30, r: at.sensors.r + 12, b: at.vehicle.b + 12 };
    this.world.style.transform = `translate(${(world.l + 12).toFixed(0)}px, ${(world.t + 5).toFixed(0)}px)`;
    c.setLineDash([6, 5]);
    c.strokeStyle = colours.sim;
    c.lineWidth = 1.3;
    c.beginPath();
    c.roundRect(world.l, world.t, world.r - world.l, world.b - world.t, 12);
    c.stroke();
    c.setLineDash([]);
    for (const [from, to] of WIRES) arrow(c, path(at[from], at[to]), colours.muted, 1.8, 10);
  }
}

/** Return the way of a wire: straight where two boxes share a row or a column, else along the row of the first. */
function path(a, b) {
  const near = (p, q) => Math.abs(p - q) < 6;
  if (near(a.x, b.x)) return a.y < b.y ? [[a.x, a.b], [b.x, b.t]] : [[a.x, a.t], [b.x, b.b]];
  if (near(a.y, b.y)) return a.x < b.x ? [[a.r, a.y], [b.l, b.y]] : [[a.l, a.y], [b.r, b.y]];
  const middle = (a.l + b.r) / 2;
  if (a.l - b.r < 60 && b.x < a.x) return [[a.l, a.y], [middle, a.y], [middle, b.y - 12], [b.r, b.y - 12]];
  return [[b.x > a.x ? a.r : a.l, a.y], [b.x, a.y], [b.x, b.y > a.y ? b.t : b.b]];
}
