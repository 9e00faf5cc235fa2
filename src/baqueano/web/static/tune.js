// Gains of the controller: the cost of a lap over two gains, with a new lap after each change.

import { axis, begin, box, clamp, colours, dot, fill as paint, label, line, ramp, stroke } from "./canvas.js";
import { calm, drag, el, empty, fill, form, press, put, show, slide, write } from "./dom.js";
import { Map2D } from "./map.js";
import { boxOf } from "./record.js";
import { length, num, t, three, wordFor } from "./strings.js";

const { abs, expm1, floor, max, round } = Math;
const CURVE = 7; // of tune/search.py: g = low + (high − low) (e^{cx} − 1) / (e^c − 1)
const SIDES = [10, 20]; // of the landscape: first coarse, then fine
const SETTLED_MS = 250, LAP_MS = 50; // between two laps: a browser may send 50 messages a second
const FINE = 160, BANDS = 16; // pixels and steps of the landscape
const gainOf = ({ low, high }, x) => low + ((high - low) * expm1(CURVE * x)) / expm1(CURVE);
const placeOf = ({ low, high }, g) => clamp(Math.log1p(((g - low) / (high - low)) * expm1(CURVE)) / CURVE, 0, 1);
const PRICE = { low: 0, high: 10, unit: "m²" }; // of jerks: the laps do not depend on it

export class Tune {
  static key = "tune";

  constructor(page) { Object.assign(this, { page, node: el("div.tune"), live: !page.recorded }); }

  /** Request the laps with these gains; ignore an answer that arrives after a newer preparation. */
  #ask(what, more, then) {
    const { about, values } = this;
    this.page.ask(what, { route: about.route, gains: values, ...more }, (word) => { if (about === this.about) then(word); });
  }

  shown() { if (!this.about) this.prepare(this.page.route?.name); }
  again() { this.about = null; if (this.page.screen === this) this.prepare(); }
  opened() { if (!this.live) this.again(); }
  blocks() { if (this.about && this.page.hello.swapped?.controller !== this.swapped) this.again(); else this.buttons(); }

  prepare(route) {
    const { page } = this, instead = (title, text = "") => this.node.replaceChildren(empty(t(title), el("p", text)));
    if (!page.shown) { instead("replay.none"); return; }
    instead("tune.preparing", t("tune.preparing-how"));
    this.swapped = page.hello.swapped?.controller;
    page.ask("tune", { route }, (word) => {
      if (!word.refusal) this.build(word);
      else if (route) this.prepare();
      else instead("tune.none", word.refusal);
    });
  }

  build(about) {
    const { gains, price } = about, last = gains.length - 1;
    Object.assign(this, { about, gains, price, land: null, path: null, lap: null, fileLap: null, busy: false, undos: [], axes: [max(last - 1, 0), last] });
    const { downhill, back, save, undo, apply, ...parts } = form("tune", this.node);
    Object.assign(this, parts, { do: { downhill, back, save, undo, apply } });
    this.file = gains.every((one) => one.file !== null) ? gains.map((one) => one.file) : null;
    this.values = this.force ?? gains.map((one) => one.value);
    this.map = new Map2D(this.mapCard);
    const names = gains.map((one) => one.name);
    [this.across, this.up].forEach((list, k) => fill(list, names, names[this.axes[k]], (name) => { this.axes[k] = names.indexOf(name); this.survey(); }));
    fill(this.route, about.routes.map((name) => [name, wordFor("shape", name)]), about.route, (name) => this.prepare(name));
    write(this.controller, about.controller);
    drag(this.canvas, ({ offsetX, offsetY }) => {
      const { X, Y } = this.scales;
      [X(offsetX), Y(offsetY)].forEach((x, k) => { this.values[this.axes[k]] = gainOf(gains[this.axes[k]], clamp(x, 0, 1)); });
      this.moved(true);
    });
    this.sliders = gains.map((one, k) => slider(one, one.file, (x) => { this.values[k] = x; this.moved(this.axes.includes(k)); }));
    this.sliders.push(slider({ ...PRICE, name: t("tune.price"), meaning: t("tune.price-meaning") }, price, (x) => { this.price = x; this.path = null; this.put(); this.#paint(); }));
    this.sliderBox.append(...this.sliders.map((one) => one.node));
    press(this.do, { downhill: () => this.downhill(), back: () => this.jump(this.file), save: () => this.page.send({ type: "write", gains: this.values, route: about.route }), undo: () => this.undo(), apply: () => this.apply() });
    apply.title = t("tune.apply-when");
    for (const one of [this.state, save, undo, apply]) show(one, this.live);
    if (this.file) this.#ask("lap", { gains: this.file }, (word) => { this.fileLap = word.x ? word : null; });
    this.moved(false);
  }

  put() { [...this.values, this.price].forEach((value, k) => this.sliders[k].set(value)); }

  /** Request a lap at once, and a landscape at rest if a gain outside its axes has changed. */
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
    this.want = false;
    this.busy = true;
    this.#ask("lap", {}, (word) => {
      if (word.x) [this.lap, this.began_ms] = [word, null];
      setTimeout(() => { this.busy = false; this.#simulate(); }, LAP_MS);
    });
  }

  survey(side = SIDES[0]) {
    const [a, b] = this.axes.map((k) => this.gains[k].name);
    if (side === SIDES[0]) { this.path = this.land = null; write(this.surveyed, t("tune.surveying")); }
    this.#ask("landscape", { a, b, side }, (word) => {
      if (!word.costs) return;
      this.land = word;
      this.#paint();
      write(this.surveyed, t("tune.surveyed", { n: side * side, s: num(word.seconds) }));
      if (side < SIDES[1] && word.seconds < 3) this.survey(SIDES[1]);
    });
  }

  downhill() {
    const { page, price, do: { downhill } } = this;
    downhill.disabled = true;
    this.#ask("downhill", { price }, (word) => {
      downhill.disabled = false;
      page.say(word.refusal ?? t("tune.down", { n: word.laps, s: num(word.seconds), part: num(100 * (1 - word.cost / word.start_cost), 0) }));
      if (!word.path) return;
      this.values = word.path.at(-1).slice();
      this.moved(true);
      this.path = word;
    });
  }

  /** Return the present gains of the vehicle; null if they belong to another controller. */
  get force() {
    const all = this.page.hello.vehicle.gains ?? {}, own = this.gains.map(({ name }) => all[`controller.${name}`]);
    return this.live && own.every(Number.isFinite) ? own : null;
  }

  #set(values) { this.gains.forEach(({ name }, k) => { if (values[k] !== this.force[k]) this.page.send({ type: "set", path: `controller.${name}`, value: values[k] }); }); }
  apply() { this.undos.push(this.force); this.#set(this.values); }
  undo() { const before = this.undos.pop(); this.#set(before); this.jump(before); }

  buttons() {
    if (!this.about || !this.live) return;
    const { force, page, about: { file }, do: { apply, undo, save } } = this, same = force?.every((x, k) => abs(x - this.values[k]) <= 1e-6 * abs(x));
    const drives = page.hand?.mine && page.moves && page.state.t_s !== 0 && force; // 0 during the preparation
    apply.disabled = !drives || same;
    undo.disabled = !drives || !this.undos.length;
    save.disabled = !page.drives || !file;
    save.title = file ?? t("tune.garage");
    write(this.state, t(same ? "tune.applied" : "tune.not-applied"));
    this.state.classList.toggle("gold", !same);
  }

  key(event, down) { return this.map?.key(event, down); }

  draw(now_ms) {
    const { about, lap, fileLap } = this;
    if (!about) return;
    put(this, { here: length(lap?.rms), ofFile: length(fileLap?.rms), full: num(100 * lap?.full, 0) });
    if (lap) write(this.note, t(about.whole ? "tune.note" : "tune.note-part", { s: num(about.seconds, 0), ms: num(lap.ms) }));
    this.began_ms ??= now_ms;
    const { x = [], y } = lap ?? {}, n = x.length, k = calm() ? n - 2 : floor(((now_ms - this.began_ms) / 250 / about.seconds) * n) % max(n - 1, 1); // 4 ×
    const pose = n > 1 ? [x[k], y[k], Math.atan2(y[k + 1] - y[k], x[k + 1] - x[k])] : null;
    const trails = [[fileLap, "ghost"], [lap, "estimate"]].filter(([one]) => one).map(([one, style]) => ({ trail: (one.trail ??= trailOf(one)), style }));
    this.map.draw({ route: about.path, trails, vehicles: [{ pose, vehicle: this.page.shown.about.vehicle }] });
    this.#landscape();
  }

  #landscape() {
    const [c, w, h] = begin(this.canvas);
    if (!c) return;
    const text = (words, x, y, align, colour = "muted") => label(c, words, x, y, colour, align, 400);
    const { rem } = colours, two = this.axes.map((k) => this.gains[k]), [left, top, right, bottom] = [4.4 * rem, 0.4 * rem, w - 0.6 * rem, h - 2.8 * rem];
    const X = axis(0, 1, left, right), Y = axis(0, 1, bottom, top), at = (places) => this.axes.map((k, n) => [X, Y][n](places[k]));
    this.scales = { X: axis(left, right, 0, 1), Y: axis(bottom, top, 0, 1) };
    if (this.land) {
      if (this.theme !== colours.card) this.#paint();
      c.drawImage(this.picture, left, top, right - left, bottom - top);
    }
    box(c, left, top, right - left, bottom - top, 0);
    stroke(c, "line");
    for (const x of [0, 0.25, 0.5, 0.75, 1]) {
      const [[p, a], [q, b]] = two.map((one) => [one, +gainOf(one, x).toPrecision(x % 1 ? 1 : 3)]).map(([one, g]) => [placeOf(one, g), num(g, `${g}.`.split(".")[1].length)]);
      text(a, X(p), bottom + 0.9 * rem, ["left", "right"][x] ?? "center");
      text(b, left - 0.4 * rem, max(Y(q), top + 0.4 * rem), "right");
    }
    const [a, b] = two.map(({ name, unit }) => (unit ? `${name} [${unit}]` : name));
    text(a, X(0.5), bottom + 2.2 * rem, "center", "ink");
    c.save();
    c.translate(0.7 * rem, Y(0.5));
    c.rotate(-Math.PI / 2);
    text(b, 0, 0, "center", "ink");
    c.restore();
    line(c, (this.path?.places ?? []).map(at), "ink", 2, [5, 4]);
    const placesOf = (values) => this.gains.map((one, k) => placeOf(one, values[k]));
    const point = (values, words, colour) => {
      const [x, y] = at(placesOf(values)), wide = c.measureText(words).width + 0.9 * rem, from = x + (x > X(0.7) ? -0.8 * rem - wide : 0.8 * rem);
      dot(c, x, y, 0.5 * rem, colour, "ink");
      box(c, from, y - 0.75 * rem, wide, 1.5 * rem, 5);
      paint(c, "card");
      text(words, from + 0.45 * rem, y, "left", "ink");
    };
    const own = placesOf(this.values), apart = this.file && placesOf(this.file).some((x, k) => abs(x - own[k]) > 0.02);
    if (apart) point(this.file, t("tune.of-file"), "ghost");
    point(this.values, t(apart || !this.file ? "tune.now" : "tune.of-file"), apart ? "sim" : "ghost");
  }

  /** Paint bands of the logarithm of the cost; the smallest cost is the darkest. */
  #paint() {
    if (!this.land) return;
    this.theme = colours.card;
    const { costs, side } = this.land, z = costs.map(([path, jerk]) => (path === null || jerk === null ? NaN : Math.log(path + this.price * jerk)));
    const finite = z.filter(Number.isFinite).sort((a, b) => a - b), low = finite[0], high = finite[floor(0.95 * (finite.length - 1))];
    const shades = ramp(colours.depth.split(" "), BANDS + 1).map((one) => [...one, 255]), image = new ImageData(FINE, FINE);
    const at = (k) => (z[k] < high ? z[k] : high), mix = (a, b, part) => a + part * (b - a);
    const places = Array.from({ length: FINE }, (_, p) => { const u = (p / (FINE - 1)) * (side - 1), i = Math.min(floor(u), side - 2); return [i, u - i]; });
    let pixel = 0;
    for (const [j, v] of places.toReversed()) {
      const row = Array.from({ length: side }, (_, i) => mix(at(j * side + i), at((j + 1) * side + i), v));
      for (const [i, u] of places) {
        const depth = clamp((high - mix(row[i], row[i + 1], u)) / (high - low || 1), 0, 1) ** 1.5;
        image.data.set(shades[round(depth * BANDS) || 0], pixel);
        pixel += 4;
      }
    }
    this.picture = el("canvas", { width: FINE, height: FINE });
    this.picture.getContext("2d").putImageData(image, 0, 0);
  }
}

/** Give small gains as much room as large ones; a mark shows the value of the file. */
function slider(one, file, onmove) {
  const { name, meaning, unit } = one, parts = form("gain"), { node, track, input, mark, value } = parts;
  put(parts, { name, meaning, unit });
  input.ariaLabel = `${name}, ${meaning}`;
  input.oninput = () => onmove(gainOf(one, input.value / 1000));
  show(mark, file !== null);
  track.style.setProperty("--at", placeOf(one, file ?? 0));
  const set = (g) => {
    const x = placeOf(one, g);
    input.value = round(1000 * x);
    slide(input, x, `${three(g)} ${unit}`);
    write(value, three(g));
  };
  return { node, set };
}

const trailOf = ({ x, y }) => ({ points: x.map((one, k) => [one, y[k], k]), box: boxOf({ x, y }), step_m: Infinity, update() { return this; }, until: () => x.length });
