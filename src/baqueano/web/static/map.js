// The map: route, path with its 95 % corridor, ellipses, truth, and the vehicle with its footprint.

import { begin, box, clamp, colours, dot, fill, label, line, nice, sharp, stroke } from "./canvas.js";
import { calm, form, keyed, press } from "./dom.js";
import { boxOf, union } from "./record.js";
import { num } from "./strings.js";

const { ceil, hypot, max, min, sqrt } = Math;
const ELLIPSE = sqrt(5.991); // 95 % of two dimensions
const EVERY_S = 4; // between ellipses
const SMALLEST = 24; // px, of a vehicle
const STYLES = {
  estimate: { colour: "model", width: 2.6 },
  truth: { colour: "ink", width: 1.4, dash: [5, 4] },
  ghost: { colour: "ghost", width: 2.4, dash: [9, 7] },
};

export class Map2D {
  /** `card`: its first element is the legend. */
  constructor(card) {
    const parts = form("map"), { canvas, buttons, fit, follow } = parts;
    card.firstElementChild.after(canvas, buttons);
    Object.assign(this, { card, canvas, modes: { fit, follow } });
    this.view = null; // {x, y, scale}
    press(parts, { closer: () => this.zoom(1.4), farther: () => this.zoom(1 / 1.4), fit: () => this.to("fit"), follow: () => this.to("follow") });
    this.#listen();
    this.to("fit");
  }

  to(mode) {
    this.mode = mode;
    for (const [name, button] of Object.entries(this.modes)) button.ariaPressed = name === mode;
  }

  key(event, down) {
    const closer = () => this.zoom(1.25), farther = () => this.zoom(0.8);
    return keyed({ KeyF: () => this.to("follow"), Digit0: () => this.to("fit"), Equal: closer, "+": closer, Minus: farther, "-": farther }, event, down);
  }

  zoom(factor, at = this.middle) {
    if (!this.view) return;
    const scale = clamp(this.view.scale * factor, 2, 20000);
    if (this.mode === "follow") this.wish = this.view.scale = scale;
    else this.hold(this.place(at), at, scale);
  }

  hold([x, y], [px, py], scale = this.view.scale) {
    this.view = { x: x - (px - this.middle[0]) / scale, y: y + (py - this.middle[1]) / scale, scale };
    this.to("free");
  }

  /** Return the place [m] under a point of the canvas. */
  place([px, py]) { const { view, middle } = this; return [view.x + (px - middle[0]) / view.scale, view.y - (py - middle[1]) / view.scale]; }

  /** Zoom with two fingers; one finger moves the map, or `pull` gets [x, y, to x, to y], and true at the end. */
  #listen() {
    const { canvas } = this, fingers = new Map(), at = (e) => [e.offsetX, e.offsetY];
    const pair = () => { const [[x0, y0], [x1, y1]] = fingers.values(); return [hypot(x1 - x0, y1 - y0), [(x0 + x1) / 2, (y0 + y1) / 2]]; };
    let from = null, pulled = null;
    const end = (done) => (e) => {
      if (pulled) this.pull(pulled, done);
      pulled = null;
      fingers.delete(e.pointerId);
    };
    Object.assign(canvas, {
      onpointerdown: (e) => {
        if (pulled) end(false)(e);
        canvas.setPointerCapture(e.pointerId);
        fingers.set(e.pointerId, at(e));
        from = fingers.size === 1 ? at(e) : null;
      },
      onpointermove: (e) => {
        const before = fingers.get(e.pointerId), now = at(e);
        if (!before || !this.view) return;
        const [was] = fingers.size === 2 ? pair() : [];
        fingers.set(e.pointerId, now);
        if (was > 0) { const [far, middle] = pair(); this.zoom(far / was, middle); }
        else if (from && this.pull) this.pull(pulled = [...from, ...now]);
        else if (fingers.size === 1 && (this.mode === "free" || hypot(now[0] - before[0], now[1] - before[1]) > 1)) this.hold(this.place(before), now);
      },
      onpointerup: end(true), onpointercancel: end(false), ondblclick: () => this.to("fit"),
    });
    canvas.addEventListener("wheel", (e) => { e.preventDefault(); this.zoom(Math.exp(-e.deltaY / 400), at(e)); }, { passive: false });
  }

  /** Keep the content free of the elements upon the map: legend, numbers, a card. */
  #clear() {
    const [legend, numbers] = [".map-legend", ".numbers"].map((one) => this.card.querySelector(one));
    const stands = numbers && getComputedStyle(numbers).position === "absolute";
    this.pad = { left: 24 + (this.beside?.() ?? 0), right: 24 + (stands ? numbers.offsetWidth : 0), top: legend.offsetTop + legend.offsetHeight + 12, bottom: 40 };
  }

  #look(w, h, boxes, at) {
    const { left, right, top, bottom } = this.pad, finite = boxes.filter((one) => Number.isFinite(one[0]));
    const [x0, y0, x1, y1] = finite.length ? finite.reduce(union) : [-1, -1, 1, 1];
    this.middle = [(left + w - right) / 2, (top + h - bottom) / 2];
    const scale = max(min((w - left - right) / max(x1 - x0, 0.8), (h - top - bottom) / max(y1 - y0, 0.8)), 1) * 0.94;
    const { mode, view } = this, fit = { x: (x0 + x1) / 2, y: (y0 + y1) / 2, scale }, size = `${w}|${h}`, part = this.size !== size || calm() ? 1 : 0.16, now = view ?? fit;
    if (mode === "fit") this.wish = null;
    const want = mode === "fit" ? fit : mode === "follow" && at ? { x: at[0], y: at[1], scale: this.wish ?? scale * 1.8 } : now;
    this.view = { x: now.x + part * (want.x - now.x), y: now.y + part * (want.y - now.y), scale: now.scale * (want.scale / now.scale) ** part };
    this.size = size;
  }

  /** Draw trails {trail, style, row, paint}, and vehicles {vehicle, pose, style: now | ghost | true, std_psi}. */
  draw({ route, trails, vehicles, reference }) {
    if (!this.canvas.fitted) this.#clear();
    const [c, w, h] = begin(this.canvas);
    if (!c) return;
    const boxes = trails.map((one) => one.trail.update().box), shown = vehicles.filter((one) => one.pose);
    if (route) boxes.push(route.box ??= union(boxOf(route), boxOf(route.room ?? route)));
    for (const { pose: [x, y], vehicle } of shown) { const r = size(vehicle) * 0.6; boxes.push([x - r, y - r, x + r, y + r]); }
    const pose = vehicles[0]?.pose;
    this.#look(w, h, boxes, pose);
    const { view, middle } = this;
    this.X = (x) => middle[0] + (x - view.x) * view.scale;
    this.Y = (y) => middle[1] - (y - view.y) * view.scale;
    this.at = (place) => [this.X(place[0]), this.Y(place[1])];
    this.#grid(c, w, h);
    if (route?.x.length) this.#route(c, route);
    const covered = trails.filter((one) => one.trail.corridor);
    for (const one of covered) this.#corridor(c, one);
    for (const one of trails) this.#trail(c, one);
    for (const one of covered) this.#ellipses(c, one);
    if (reference) {
      if (pose) line(c, [this.at(reference), this.at(pose)], "muted", 1, [3, 3]);
      dot(c, ...this.at(reference), 7, null, "muted");
    }
    for (const one of shown.reverse()) this.#vehicle(c, one);
    this.#scale(c, w, h);
  }

  #grid(c, w, h) {
    const step = nice(110 / this.view.scale), [left, top] = this.place([0, 0]), [right, bottom] = this.place([w, h]), ways = [], lines = (from, to, way) => {
      for (let k = ceil(from / step); k * step <= to; k++) ways.push(...way(k * step), null);
    };
    lines(left, right, (x) => [[sharp(this.X(x)), 0], [sharp(this.X(x)), h]]);
    lines(bottom, top, (y) => [[0, sharp(this.Y(y))], [w, sharp(this.Y(y))]]);
    line(c, ways, "grid");
  }

  #route(c, route) {
    const wayOf = ({ x, y }) => x.map((one, k) => this.at([one, y[k]])), way = wayOf(route);
    if (route.room) line(c, wayOf(route.room), "alarm", 1.5, [6, 4]);
    c.lineCap = "round";
    line(c, route.closed ? [...way, way[0]] : way, "route", max(5, colours.rem * 0.42));
    dot(c, ...way[0], 4.5, "card", "muted");
  }

  #corridor(c, { trail, row }) {
    const p = trail.points, end = trail.until(row);
    c.beginPath();
    for (let k = 2; k - 2 < end - 1; k += 2) { // two steps: half the points, and as smooth
      const a = p[k - 2], b = p[min(k, end - 1)];
      if (apart(a, b, trail)) continue;
      const [left, right, leftNext, rightNext] = [a, b].flatMap(([x, y, , nx, ny]) => [[x + nx, y + ny], [x - nx, y - ny]]);
      this.#triangle(c, left, leftNext, rightNext); // one direction, so that crossing sides do not cut a hole
      this.#triangle(c, left, rightNext, right);
    }
    fill(c, "corridor");
  }

  #triangle(c, p, q, r) {
    const turn = (q[0] - p[0]) * (r[1] - p[1]) - (r[0] - p[0]) * (q[1] - p[1]) > 0;
    c.moveTo(...this.at(p));
    for (const one of turn ? [q, r] : [r, q]) c.lineTo(...this.at(one));
    c.closePath();
  }

  #trail(c, { trail, style, row, paint }) {
    const p = trail.points, end = trail.until(row), { colour, width, dash } = STYLES[style];
    const way = (from, to, ...look) => {
      const points = [];
      for (let k = from; k < to; k++) {
        if (k > from && apart(p[k], p[k - 1], trail)) points.push(null);
        points.push(this.at(p[k]));
      }
      line(c, points, ...look);
    };
    c.lineCap = "round";
    if (end < p.length) { c.globalAlpha = 0.28; way(max(end - 1, 0), p.length, colour, width, dash); c.globalAlpha = 1; }
    if (!paint) { way(0, end, colour, width, dash); return; }
    for (let k = 1, from = 0; k <= end; k++) {
      if (k < end && paint(p[k][2]) === paint(p[from][2])) continue;
      way(from, min(k + 1, end), paint(p[from][2]), max(4, 0.36 * colours.rem));
      from = k;
    }
  }

  #ellipses(c, { trail: { record }, row = record.last }) {
    if (row < 0) return;
    c.globalAlpha = 0.7;
    for (let s = ceil(record.start / EVERY_S) * EVERY_S; s <= record.t[row]; s += EVERY_S) {
      const i = record.row(s), pose = record.pose(i), [long, short, angle] = record.ellipse(i), [a, b] = [long, short].map((one) => ELLIPSE * sqrt(one) * this.view.scale);
      if (!pose || !(a >= 3)) continue;
      c.beginPath();
      c.ellipse(...this.at(pose), a, b, -angle, 0, 7);
      stroke(c, "model", 1.2);
    }
    c.globalAlpha = 1;
  }

  #vehicle(c, { pose, vehicle, style = "now", std_psi }) {
    const whole = size(vehicle), s = max(this.view.scale, SMALLEST / whole), { kind, length_m, width_m } = vehicle.footprint, L = length_m * s, W = width_m * s, car = kind === "car";
    const [long, wide, corner] = car ? [1, 0.8, 0.22] : [0.88, 0.76, 0.28], body = () => box(c, -0.5 * long * L, -0.5 * wide * W, long * L, wide * W, corner * W);
    c.save();
    c.translate(...this.at(pose));
    c.rotate(-pose[2]);
    if (style === "true") {
      body();
      stroke(c, "ink", 1.4, [4, 3]);
      c.restore();
      return;
    }
    if (std_psi > 0) {
      const far = max(whole * 1.6 * s, 34), wide = min(1.96 * std_psi, Math.PI), fade = c.createRadialGradient(0, 0, 0, 0, 0, far);
      fade.addColorStop(0, colours.band);
      fade.addColorStop(1, "transparent");
      c.beginPath();
      c.moveTo(0, 0);
      c.arc(0, 0, far, -wide, wide);
      fill(c, fade);
    }
    const paint = style === "ghost" ? "ghost" : "ink";
    c.globalAlpha = style === "ghost" ? 0.75 : 1;
    const part = () => { fill(c, paint); stroke(c, "card", 2); };
    for (const side of [1, -1]) for (const end of car ? [0.3, -0.3] : [0]) {
      const [long, wide] = car ? [0.24 * L, 0.2 * W] : [0.46 * L, 0.14 * W];
      box(c, end * L - long / 2, (car ? 0.42 : 0.47) * side * W - wide / 2, long, wide, 0.3 * wide);
      part();
    }
    body();
    part();
    const r = 0.3 * W; // ahead
    c.beginPath();
    for (const [x, y] of [[1.05, 0], [-0.7, 0.8], [-0.3, 0], [-0.7, -0.8]]) c.lineTo(x * r, y * r);
    fill(c, "card");
    c.restore();
  }

  #scale(c, w, h) {
    const step = nice((w * 0.3) / this.view.scale), end = 16 + step * this.view.scale, y = h - 16;
    line(c, [[16, y - 5], [16, y], [end, y], [end, y - 5]], "muted", 1.5);
    label(c, step >= 1 ? `${num(step, 0)} m` : `${num(step * 100, 0)} cm`, end + 8, y - 3, "muted", "left", 400);
  }
}

const size = ({ footprint: { length_m, width_m } }) => max(length_m, width_m);

const apart = (a, b, trail) => hypot(a[0] - b[0], a[1] - b[1]) > 20 * trail.step_m;
