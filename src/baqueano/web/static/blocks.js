// The diagram of the blocks, with the present value on each wire.

import { arrow, begin } from "./canvas.js";
import { choices, el, empty, fill, form, put, row, show, write } from "./dom.js";
import { movable } from "./record.js";
import { signals, stripsOf } from "./strips.js";
import { num, t, three } from "./strings.js";

const SPAN = 10; // s
const BLOCKS = ["vehicle", "sensors", "estimator", "guide", "controller", "supervisor"];
const WIRES = [["vehicle", "sensors"], ["sensors", "estimator"], ["estimator", "guide"], ["guide", "controller"], ["estimator", "controller"], ["controller", "supervisor"], ["supervisor", "vehicle"]];
const LOOP = BLOCKS.slice(2); // the blocks whose step is part of a tick
const COLOURS = ["measured", "model", "ghost"]; // of a line on a wire

export class Blocks {
  static key = "blocks";

  constructor(page) {
    Object.assign(this, { page, node: el("div.blocks"), picked: "estimator", view: 0 });
    this.build();
  }

  opened() { this.build(); }
  blocks() { this.build(); }
  shown() { if (this.boxes) for (const key of LOOP) this.#learn(key); }

  #learn(key) {
    const { details } = this;
    if (details[key] !== undefined) return;
    details[key] = null;
    this.page.ask("block", { room: key }, (word) => {
      if (details !== this.details) return;
      details[key] = word;
      if (word.step_us) write(this.boxes[key].lastChild, `${three(word.step_us)} µs`);
      if (key === this.picked) this.#show();
    });
  }

  build() {
    const { page } = this;
    Object.assign(this, { details: {}, boxes: null });
    if (!page.shown) { this.node.replaceChildren(empty(t("replay.none"))); return; }
    const { record, about: { vehicle, blocks = {} } } = page.shown;
    Object.assign(this, form("blocks", this.node));
    const sensors = [...new Set(record.channels.map((one) => one.replace(/[.[].*$/, "")))].join(", ");
    const names = { ...blocks, vehicle: blocks.model ?? vehicle.name, sensors, supervisor: t("block.supervisor-does") };
    this.boxes = Object.fromEntries(BLOCKS.map((key) =>
      [key, el(`button.block.at-${key}`, { onclick: () => this.pick(key) }, el("b", t(`block.${key}`)), el("span", names[key] ?? t("block.none")), el("i"))]));
    const commanded = (kind) => movable(vehicle).map((k) => `${kind}.${k}`);
    const wires = { measured: record.channels.slice(0, 3).map((one) => `z.${one}`), estimate: ["eta.x", "eta.y"], reference: ["ref.x", "ref.y"], requested: commanded("requested"), command: commanded("u") };
    this.sparks = stripsOf(record, Object.entries(wires).map(([key, names]) => ({ kind: `spark.at-${key}`, title: t(`wire.${key}`), lines: Object.fromEntries(names.map((name, k) => [name, COLOURS[k]])) })));
    this.diagram.append(...Object.values(this.boxes), ...this.sparks.map((one) => one.node));
    show(this.tick, record.has("late_ms"));
    write(this.every, t("block.tick", { ms: num(1000 / vehicle.rate_hz, 0) }));
    this.check.onclick = () => this.#check();
    choices(this.views, this.view, (k) => { this.view = k; this.#show(); });
    this.pick(this.picked);
    if (page.screen === this) this.shown();
  }

  pick(key) {
    this.picked = key;
    const { record, about: { vehicle } } = this.page.shown, { measured, innovations, commands } = signals(record, vehicle);
    for (const [name, one] of Object.entries(this.boxes)) one.ariaPressed = name === key;
    const plain = (name, kind = "model") => ({ lines: { [name]: kind } }), named = (one) => ({ ...one, title: t("strip.innovation", { of: record.field(Object.keys(one.lines)[0])?.label }) });
    this.strips = stripsOf(record, {
      vehicle: [plain("nu.u"), plain("nu.r")], sensors: measured, estimator: [...innovations.map(named), plain("nis", "measured")],
      guide: [plain("ref.u"), plain("progress"), plain("cross")], controller: commands, supervisor: commands,
    }[key]).slice(0, 5);
    put(this, { title: t(`block.${key}`), who: this.boxes[key].children[1].textContent, about: t(`block.${key}-about`) });
    this.content.ariaLabel = t(`block.${key}`);
    this.#show();
    this.#learn(key);
  }

  #show() {
    const { content, picked, page } = this, about = this.details[picked];
    content.classList.toggle("strip-list", this.view === 0);
    if (this.view === 0) content.replaceChildren(...this.strips.map((one) => one.node));
    else if (!about?.text) content.replaceChildren(el("p", about?.refusal ?? t("block.loading")));
    else if (this.view === 2) {
      const text = el("pre", about.text);
      content.replaceChildren(text);
      content.scrollTop = (about.line / about.text.split("\n").length) * text.scrollHeight;
    } else content.replaceChildren(about.parameters.length
      ? el("table", about.parameters.map(({ name, unit, meaning, value, shape }) => row([name, el("small", meaning)], [[value ? value.map(three).join(" ") : shape, " ", el("small", unit)]])))
      : el("p", t("block.no-parameters")));
    show(this.foot, about?.text);
    show(this.other, about?.kinds?.length && !page.recorded);
    if (!about?.text) return;
    put(this, { file: about.file, ofTick: t("block.step", { of: num(about.tick_us / 1000, 0) }), step: `${three(about.step_us)} µs`, check: t("block.check"), result: "" });
    show(this.cost, about.step_us);
    show(this.check, true);
    fill(this.others, about.kinds, about.kind, (kind) => page.send({ type: "swap", room: picked, kind }));
    this.others.disabled = !page.drives;
    show(this.next, page.hello.swapped?.[picked]);
  }

  #check() {
    const { picked, check, result } = this;
    write(check, t("block.checking"));
    this.page.ask("check", { room: picked, kind: this.details[picked].kind }, ({ findings, no }) => {
      if (picked !== this.picked) return;
      const good = findings?.length === 0;
      show(check, false);
      result.className = good ? "good" : "bad";
      write(result, good ? t("block.sound") : no ?? findings.join(" "));
    });
  }

  draw() {
    const { page } = this;
    if (!this.boxes) return;
    this.#wire();
    if (!page.shown?.record.length) return;
    const { record } = page.shown, i = page.recorded ? record.row(page.screens.replay.now_s) : record.last, to = record.t[i];
    for (const one of [...this.strips, ...this.sparks]) one.draw(to - SPAN, to, i);
    write(this.late, `${num(record.value("late_ms", i))} ms`);
  }

  #wire() {
    const [c] = begin(this.wires);
    if (!c) return;
    const at = Object.fromEntries(Object.entries(this.boxes).map(([key, { offsetLeft: l, offsetTop: t, offsetWidth: w, offsetHeight: h }]) => [key, { l, t, r: l + w, b: t + h, x: l + w / 2, y: t + h / 2 }]));
    for (const [from, to] of WIRES) arrow(c, path(at[from], at[to]), "muted", 1.8, 10);
  }
}

/** Draw a straight wire within a row or a column, else along the row of the first box. */
function path(a, b) {
  const near = (p, q) => Math.abs(p - q) < 6, right = b.x > a.x, down = b.y > a.y, middle = (a.l + b.r) / 2;
  const across = [right ? a.r : a.l, a.y], into = [b.x, down ? b.t : b.b];
  if (near(a.x, b.x)) return [[a.x, down ? a.b : a.t], into];
  if (near(a.y, b.y)) return [across, [right ? b.l : b.r, b.y]];
  if (!right && a.l - b.r < 60) return [across, [middle, a.y], [middle, b.y - 12], [b.r, b.y - 12]];
  return [across, [b.x, a.y], into];
}
