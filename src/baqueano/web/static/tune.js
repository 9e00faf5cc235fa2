// Gains of the controller: what a lap costs over two of them, sliders that simulate a lap at each move, the way downhill.

import { begin, colours, dot, follow, line } from "./canvas.js";
import { calm, el, empty, key, number, select, show, write } from "./dom.js";
import { Map2D } from "./map.js";
import { length, num, t, three } from "./strings.js";

const CURVE = 7; // of tune/search.py: g = low + (high − low) (e^{cx} − 1) / (e^c − 1)
const SIDES = [10, 20]; // of the landscape: coarse at once, then fine
const SETTLED_MS = 250, LAP_MS = 60, LOST_MS = 10000; // LAP_MS between two laps: a browser may say 50 words a second
const FINE = 160, BANDS = 16; // pixels and steps of the landscape
const RAMPS = [["#f6f7f4", "#d9ebdd", "#a3d1b1", "#57a877", "#1f7d44", "#0c4a26"], ["#161b22", "#1d3541", "#22606b", "#3f9483", "#9cc86f", "#f1e27c"]]
  .map((ramp) => ramp.map((one) => [1, 3, 5].map((k) => parseInt(one.slice(k, k + 2), 16))));
const gainOf = ({ low, high }, x) => low + ((high - low) * Math.expm1(CURVE * x)) / Math.expm1(CURVE);
const within = (x) => Math.min(Math.max(x, 0), 1);
const placeOf = ({ low, high }, g) => within(Math.log1p(((g - low) / (high - low)) * Math.expm1(CURVE)) / CURVE);
const PRICE = { name: "price", low: 0, high: 10, unit: "m²" }; // of jerks: no lap depends on it

export class Tune {
  static key = "tune";

  constructor(page) {
    this.page = page;
    this.node = el("div.tune");
    this.live = page.hello.mode === "live";
  }

  get asked() { return { ...this.run, route: this.about?.route, gains: this.values }; }
  get run() { return this.live ? {} : { run: this.page.opened?.about.run.id }; }

  shown() { if (!this.about) this.prepare(this.page.route?.name); }
  again() { this.about = null; if (this.page.screen === this) this.prepare(); }
  opened() { if (!this.live) this.again(); }
  blocks() { if (this.about && this.page.hello.swapped?.controller !== this.swapped) this.again(); else this.buttons(); }

  /** Ask for the gains, on a route of this name or the first of the list. */
  prepare(route) {
    const instead = (title, text = "") => this.node.replaceChildren(empty(t(title), el("p", text)));
    if (!this.live && !this.page.opened) { instead("replay.none"); return; }
    instead("tune.preparing", t("tune.preparing-how"));
    this.swapped = this.page.hello.swapped?.controller;
    this.page.link.ask("tune", { ...this.run, route }, (word) => {
      if (!word.no) this.build(word);
      else if (route) this.prepare();
      else instead("tune.none", word.no);
    });
  }

  build(about) {
    const { gains } = about, last = gains.length - 1;
    Object.assign(this, { about, gains, land: null, way: null, lap: null, ofFile: null, undos: [], price: about.price, axes: [Math.max(last - 1, 0), last] });
    this.file = gains.every((one) => one.file !== null) ? gains.map((one) => one.file) : null;
    this.values = gains.map((one, k) => this.force?.[k] ?? one.value);
    const axis = (name, k) => select(t(name), gains.map((one) => one.name), gains[this.axes[k]].name, (picked) => { this.axes[k] = gains.findIndex((one) => one.name === picked); this.survey(); });
    const named = (name) => { const shape = `shape.${name}`, text = t(shape); return [name, text === shape ? name : text]; };
    const route = select(t("tune.route"), about.routes.map(named), about.route, (value) => this.prepare(value));
    const button = (name, act, more = "") => (this.do[name] = el(`button.action.${more}`, { onclick: act }, t(`tune.${name}`)));
    this.canvas = follow(el("canvas.land", { role: "img", "aria-label": t("tune.landscape") }));
    this.#pointing();
    this.map = new Map2D();
    this.numbers = Object.fromEntries(["here", "file", "full"].map((name) => [name, [el("b"), el("span")]]));
    const big = el("div.numbers", ...Object.entries(this.numbers).map(([name, much]) => { const one = number(t(`tune.${name}`), ...much); one.classList.add(`of-${name}`); return one; }));
    this.sliders = gains.map((one, k) => slider(one, one.file, (x) => { this.values[k] = x; this.moved(this.axes.includes(k)); }));
    this.sliders.push(slider({ ...PRICE, name: t("tune.price"), meaning: t("tune.price-meaning") }, about.price, (x) => { this.price = x; this.way = null; this.put(); this.#paint(); }));
    this.do = {};
    [this.surveyed, this.state, this.said] = [el("span"), el("span.chip"), el("p", { role: "status" })];
    show(this.state, this.live);
    this.node.replaceChildren(
      el("section.card.landscape", el("header", el("h2", t("tune.cost")), this.surveyed, el("div.pick", axis("tune.across", 0), axis("tune.up", 1))), this.canvas),
      this.map.card([key("route", t("map.route")), key("estimate", t("tune.these")), key("ghosted", t("tune.of-file"))], big),
      el("section.card.gains", { "aria-label": t("tune.gains") }, el("header", el("h2", about.controller), this.said, this.state, el("label.pick", t("tune.route"), route)),
        el("div.sliders", ...this.sliders.map((one) => one.node)),
        el("div.actions", button("downhill", () => this.downhill()), button("back", () => this.jump(this.file)),
          ...(this.live ? [button("write", () => this.page.link.send({ is: "write", gains: this.values, route: about.route })), button("undo", () => this.undo()), button("apply", () => this.apply(), "primary")] : []))));
    if (this.file) this.page.link.ask("lap", { ...this.asked, gains: this.file }, (word) => { this.ofFile = word.x ? word : null; });
    this.moved(false);
  }

  /** Show the values on the sliders. */
  put() { [...this.values, this.price].forEach((value, k) => this.sliders[k].put(value)); }

  /** Gains have moved: a lap at once, and once they rest a landscape, where one beside its axes has. */
  moved(along) {
    this.put();
    this.buttons();
    this.want = true;
    this.#simulate();
    if (along) return;
    clearTimeout(this.settling);
    this.settling = setTimeout(() => this.survey(), this.land ? SETTLED_MS : 0);
  }

  jump(values) { this.values = values.slice(); this.moved(false); }

  #simulate() {
    if (this.busy || !this.want) return;
    const began = performance.now(), { about } = this, free = () => { this.busy = false; this.#simulate(); };
    this.want = false;
    this.busy = true;
    const lost = setTimeout(free, LOST_MS);
    this.page.link.ask("lap", this.asked, (word) => {
      clearTimeout(lost);
      this.lap_ms = performance.now() - began;
      if (about === this.about && word.x) [this.lap, this.began_ms] = [word, null];
      setTimeout(free, Math.max(0, LAP_MS - this.lap_ms));
    });
  }

  /** Ask for the landscape: coarse, then fine. */
  survey(side = SIDES[0]) {
    const { about } = this, [a, b] = this.axes.map((k) => this.gains[k].name);
    if (side === SIDES[0]) { this.way = this.land = null; write(this.surveyed, t("tune.surveying")); }
    this.page.link.ask("landscape", { ...this.asked, a, b, side }, (word) => {
      if (about !== this.about || !word.costs) return;
      this.land = word;
      this.#paint();
      write(this.surveyed, t("tune.surveyed", { n: side * side, s: num(word.seconds, 1) }));
      if (side < SIDES[1] && word.seconds < 3) this.survey(SIDES[1]);
    });
  }

  downhill() {
    const { about } = this;
    this.do.downhill.disabled = true;
    this.page.link.ask("downhill", { ...this.asked, price: this.price }, (word) => {
      this.do.downhill.disabled = false;
      if (about !== this.about) return;
      this.page.say(word.no ?? t("tune.down", { n: word.laps, s: num(word.seconds, 1), part: num(100 * (1 - word.cost / word.before), 0) }));
      if (word.way) this.#roll(word, calm() ? word.way.length - 1 : 0);
    });
  }

  /** Walk along the way, step by step. */
  #roll(found, k) {
    if (this.about.gains !== this.gains) return;
    this.values = found.way[k].slice();
    this.moved(true);
    this.way = found;
    if (k + 1 < found.way.length) setTimeout(() => this.#roll(found, k + 1), 90);
  }

  /** The gains of the vehicle as it drives; null where they are not those of this controller. */
  get force() {
    const all = (this.live && this.page.hello.vehicle.gains) || {}, own = this.gains.map(({ name }) => all[`controller.${name}`]);
    return own.every(Number.isFinite) ? own : null;
  }

  #set(values) { this.gains.forEach(({ name }, k) => { if (values[k] !== this.force[k]) this.page.link.send({ is: "set", path: `controller.${name}`, value: values[k] }); }); }
  apply() { this.undos.push(this.force); this.#set(this.values); }
  undo() { const before = this.undos.pop(); this.#set(before); this.jump(before); }

  buttons() {
    if (!this.about || !this.live) return;
    const { force, page } = this, same = force?.every((x, k) => Math.abs(x - this.values[k]) <= 1e-6 * Math.abs(x)), may = page.hello.role === "drive";
    const drives = page.hand?.mine && page.moves && page.state.t_s !== 0 && force; // at 0 it is still prepared
    this.do.apply.disabled = !drives || same;
    this.do.undo.disabled = !drives || !this.undos.length;
    this.do.write.disabled = !may || !this.about.file;
    this.do.write.title = this.about.file ?? t("tune.garage");
    this.do.apply.title = t("tune.apply-when");
    write(this.state, t(same ? "tune.applied" : "tune.not-applied"));
    this.state.classList.toggle("gold", !same);
  }

  key(event, down) { return Boolean(this.map?.key(event, down)); }

  #pointing() {
    const { canvas } = this, at = ({ offsetX, offsetY }) => {
      const { l, t, w, h } = this.box;
      [(offsetX - l) / w, 1 - (offsetY - t) / h].forEach((x, k) => { this.values[this.axes[k]] = gainOf(this.gains[this.axes[k]], within(x)); });
      this.moved(true);
    };
    canvas.addEventListener("pointerdown", (e) => { canvas.setPointerCapture(e.pointerId); at(e); });
    canvas.addEventListener("pointermove", (e) => { if (canvas.hasPointerCapture(e.pointerId)) at(e); });
  }

  draw(now_ms) {
    if (!this.about) return;
    const { lap, ofFile, about, page } = this, put = (name, much) => much.forEach((text, k) => write(this.numbers[name][k], text)), now = `${page.state.state}${page.hand?.mine}${page.state.t_s !== 0}`;
    if (this.then !== now) { this.then = now; this.buttons(); }
    put("here", length(lap?.rms ?? NaN));
    put("file", length(ofFile?.rms ?? NaN));
    put("full", [num(lap ? 100 * lap.full : NaN, 0), "%"]);
    if (lap) write(this.said, t(about.whole ? "tune.said" : "tune.said-part", { s: num(about.seconds, 0), ms: num(lap.ms, 1), way: num(this.lap_ms, 0) }));
    this.began_ms ??= now_ms;
    const n = lap?.x.length ?? 0, k = calm() ? n - 2 : Math.floor(((now_ms - this.began_ms) / 250 / about.seconds) * n) % Math.max(n - 1, 1); // four times as fast as it drives
    const pose = n > 1 ? [lap.x[k], lap.y[k], Math.atan2(lap.y[k + 1] - lap.y[k], lap.x[k + 1] - lap.x[k])] : null;
    const trails = [[ofFile, "ghost"], [lap, "estimate"]].flatMap(([one, style]) => (one ? [{ trail: (one.trail ??= trailOf(one)), style }] : []));
    this.map.draw({ route: about.path, trails, vehicles: [{ pose, footprint: (this.live ? page.hello : page.opened.about).vehicle.footprint, style: "now" }] });
    this.#landscape();
  }

  #landscape() {
    const begun = begin(this.canvas);
    if (!begun) return;
    const [c, w, h] = begun, { rem, ink, muted, font } = colours, two = this.axes.map((k) => this.gains[k]), box = (this.box = { l: 4.4 * rem, t: 0.4 * rem, w: w - 5 * rem, h: h - 3.2 * rem });
    const X = (x) => box.l + x * box.w, Y = (y) => box.t + (1 - y) * box.h, at = (values) => this.axes.map((k, n) => placeOf(two[n], values[k]));
    const text = (words, x, y, align, colour = muted) => { c.textAlign = align; c.fillStyle = colour; c.fillText(words, x, y); };
    if (this.land) {
      if (this.theme !== colours.card) this.#paint();
      c.drawImage(this.picture, box.l, box.t, box.w, box.h);
    }
    c.strokeStyle = colours.line;
    c.strokeRect(box.l, box.t, box.w, box.h);
    c.font = `${0.8 * rem}px ${font}`;
    c.textBaseline = "middle";
    for (const x of [0, 0.25, 0.5, 0.75, 1]) {
      const [across, up] = two.map((one) => { const g = gainOf(one, x); return g ? three(g) : "0"; });
      text(across, X(x), box.t + box.h + 0.9 * rem, x === 1 ? "right" : x ? "center" : "left");
      text(up, box.l - 0.4 * rem, Math.max(Y(x), box.t + 0.4 * rem), "right");
    }
    const [across, up] = two.map(({ name, unit }) => (unit ? `${name} [${unit}]` : name));
    text(across, X(0.5), box.t + box.h + 2.2 * rem, "center", ink);
    c.save();
    c.translate(0.7 * rem, Y(0.5));
    c.rotate(-Math.PI / 2);
    text(up, 0, 0, "center", ink);
    c.restore();
    line(c, (this.way?.places ?? []).map((x) => [X(x[this.axes[0]]), Y(x[this.axes[1]])]), ink, 2, [5, 4]);
    const point = (values, words, colour) => {
      const [x, y] = at(values), wide = c.measureText(words).width + 0.9 * rem, left = X(x) + (x > 0.7 ? -0.8 * rem - wide : 0.8 * rem);
      dot(c, X(x), Y(y), 0.5 * rem, colour, ink);
      c.beginPath();
      c.roundRect(left, Y(y) - 0.75 * rem, wide, 1.5 * rem, 5);
      c.fillStyle = colours.card;
      c.fill();
      text(words, left + 0.45 * rem, Y(y), "left", ink);
    };
    const apart = this.file && this.gains.some((one, k) => Math.abs(placeOf(one, this.file[k]) - placeOf(one, this.values[k])) > 0.02);
    if (apart) point(this.file, t("tune.of-file"), colours.ghost);
    point(this.values, t(apart || !this.file ? "tune.now" : "tune.of-file"), apart ? colours.sim : colours.ghost);
  }

  /** Make the picture of the landscape: bands of the logarithm of the cost, the least deepest. */
  #paint() {
    if (!this.land) return;
    this.theme = colours.card;
    const { costs, side } = this.land, z = costs.map(([path, jerk]) => (path === null || jerk === null ? NaN : Math.log(path + this.price * jerk)));
    const known = z.filter(Number.isFinite).sort((a, b) => a - b), low = known[0], high = known[Math.floor(0.95 * (known.length - 1))];
    const ramp = RAMPS[getComputedStyle(document.documentElement).colorScheme === "dark" ? 1 : 0], steps = ramp.length - 1, image = new ImageData(FINE, FINE);
    const at = (k) => (z[k] < high ? z[k] : high), mix = (a, b, part) => a + part * (b - a), place = (p) => { const u = (p / (FINE - 1)) * (side - 1), i = Math.min(Math.floor(u), side - 2); return [i, u - i]; };
    const across = Array.from({ length: FINE }, (_, p) => place(p));
    let pixel = 0;
    for (let q = FINE - 1; q >= 0; q--) {
      const [j, v] = across[q], row = Array.from({ length: side }, (_, i) => mix(at(j * side + i), at((j + 1) * side + i), v));
      for (const [i, u] of across) {
        const depth = (Math.round(within((high - mix(row[i], row[i + 1], u)) / (high - low || 1)) ** 1.5 * BANDS) / BANDS) * steps, r = Math.min(Math.floor(depth), steps - 1);
        for (let k = 0; k < 3; k++) image.data[pixel++] = mix(ramp[r][k], ramp[r + 1][k], depth - r);
        image.data[pixel++] = 255;
      }
    }
    this.picture = el("canvas", { width: FINE, height: FINE });
    this.picture.getContext("2d").putImageData(image, 0, 0);
  }
}

/** A slider for a gain: small ones have as much room as large ones; a mark where the file's stands. */
function slider(one, file, onmove) {
  const { name, meaning, unit } = one, input = el("input", { type: "range", min: 0, max: 1000, "aria-label": `${name}, ${meaning}` }), value = el("b"), track = el("div.track", input);
  input.addEventListener("input", () => onmove(gainOf(one, input.value / 1000)));
  if (file !== null) track.append(el("i", { "aria-hidden": "true" }));
  track.style.setProperty("--at", placeOf(one, file ?? 0));
  const put = (g) => {
    const x = placeOf(one, g);
    input.value = Math.round(1000 * x);
    input.style.setProperty("--part", `${100 * x}%`);
    input.setAttribute("aria-valuetext", `${three(g)} ${unit}`);
    write(value, three(g));
  };
  return { put, node: el("div.gain", el("p", el("b", name), el("span.meaning", meaning), el("span.much", value, el("span", unit))), track) };
}

/** A lap as the map draws a trail. */
function trailOf({ x, y }) {
  return { points: x.map((one, k) => [one, y[k], k]), box: [Math.min(...x), Math.min(...y), Math.max(...x), Math.max(...y)], step_m: Infinity, update() { return this; } };
}
