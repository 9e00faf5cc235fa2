// The map: route, path with its 95 % corridor, ellipses, truth, and the vehicle to its footprint.

import { begin, colours, dot, follow, label, line, nice } from "./canvas.js";
import { alone, calm, el, icon } from "./dom.js";
import { num, t } from "./strings.js";

const ELLIPSE = Math.sqrt(5.991); // 95 % of two dimensions
const EVERY_S = 4; // between ellipses
const SMALLEST = 24; // px, of a vehicle

export class Map2D {
  constructor() {
    this.canvas = follow(el("canvas.map", { tabindex: "0", role: "img", "aria-label": t("map.label") }));
    this.mode = "fit";
    this.view = null; // {x, y, scale}
    this.pad = { left: 24, right: 24, top: 44, bottom: 40 };
    this.buttons = el("div.map-buttons", { role: "group", "aria-label": t("map.label") },
      this.#button(icon("M10 4v12M4 10h12"), "map.in", () => this.zoom(1.4)), this.#button(icon("M4 10h12"), "map.out", () => this.zoom(1 / 1.4)),
      this.fitButton = this.#button(icon("M3 8V3h5M17 8V3h-5M3 12v5h5M17 12v5h-5"), "map.fit", () => this.to("fit")),
      this.followButton = this.#button(icon("M10 2v4M10 14v4M2 10h4M14 10h4M10 5.5a4.5 4.5 0 1 0 .01 0"), "map.follow", () => this.to("follow")));
    this.#listen();
    this.to("fit");
  }

  #button(sign, key, onclick) { return el("button", { title: t(key), "aria-label": t(key), onclick }, sign); }

  to(mode) {
    this.mode = mode;
    this.fitButton.setAttribute("aria-pressed", String(mode === "fit"));
    this.followButton.setAttribute("aria-pressed", String(mode === "follow"));
  }

  /** The map in its card, under a legend. */
  card(keys, ...more) { return el("section.card.map-card", el("div.legend.map-legend", ...keys), this.canvas, this.buttons, ...more); }

  /** Return whether the key was one of the map's. */
  key(event, down) {
    const act = { KeyF: () => this.to("follow"), Digit0: () => this.to("fit"), Equal: () => this.zoom(1.25), NumpadAdd: () => this.zoom(1.25), Minus: () => this.zoom(0.8), NumpadSubtract: () => this.zoom(0.8) }[event.code]
      ?? (event.key === "+" ? () => this.zoom(1.25) : event.key === "-" ? () => this.zoom(0.8) : null);
    if (!act || !alone(event)) return false;
    if (down) act();
    return true;
  }

  /** Zoom about a point of the canvas, by default its middle. */
  zoom(factor, px = this.canvas.w / 2, py = this.canvas.h / 2) {
    if (!this.view) return;
    const { view } = this, scale = Math.min(Math.max(view.scale * factor, 2), 20000);
    if (this.mode === "follow") { this.wish = scale; view.scale = scale; return; }
    const [x, y] = this.place(px, py);
    view.scale = scale;
    view.x = x - (px - this.middle[0]) / scale;
    view.y = y + (py - this.middle[1]) / scale;
    this.to("free");
  }

  pan(dx, dy) {
    if (!this.view) return;
    this.view.x -= dx / this.view.scale;
    this.view.y += dy / this.view.scale;
    this.to("free");
  }

  /** Return the place [m] under a point of the canvas. */
  place(px, py) { const { view, middle } = this; return [view.x + (px - middle[0]) / view.scale, view.y - (py - middle[1]) / view.scale]; }

  #listen() {
    const { canvas } = this, fingers = new Map();
    const spread = () => { const [a, b] = fingers.values(); return Math.hypot(a[0] - b[0], a[1] - b[1]); };
    canvas.addEventListener("pointerdown", (e) => { canvas.setPointerCapture(e.pointerId); fingers.set(e.pointerId, [e.offsetX, e.offsetY]); });
    canvas.addEventListener("pointermove", (e) => {
      const before = fingers.get(e.pointerId);
      if (!before) return;
      const was = fingers.size === 2 ? spread() : 0;
      fingers.set(e.pointerId, [e.offsetX, e.offsetY]);
      if (fingers.size === 2) {
        const [a, b] = fingers.values();
        if (was > 0) this.zoom(spread() / was, (a[0] + b[0]) / 2, (a[1] + b[1]) / 2);
      } else if (fingers.size === 1 && (this.mode === "free" || Math.hypot(e.offsetX - before[0], e.offsetY - before[1]) > 1)) {
        this.pan(e.offsetX - before[0], e.offsetY - before[1]);
      }
    });
    for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, (e) => fingers.delete(e.pointerId));
    canvas.addEventListener("wheel", (e) => { e.preventDefault(); this.zoom(Math.exp(-e.deltaY / 400), e.offsetX, e.offsetY); }, { passive: false });
    canvas.addEventListener("dblclick", () => this.to("fit"));
  }

  /** Keep the drawing clear of what stands upon the map: the legend above, numbers to the right, a card to the left. */
  #clear() {
    const card = this.canvas.parentElement, stands = (node) => node && getComputedStyle(node).position === "absolute";
    const [legend, numbers] = [".map-legend", ".numbers"].map((one) => card?.querySelector(one));
    if (legend) this.pad.top = legend.offsetTop + legend.offsetHeight + 12;
    this.pad.right = 24 + (stands(numbers) ? numbers.offsetWidth : 0);
    this.pad.left = 24 + (this.beside ? this.beside() : 0);
  }

  /** Move the view towards what its mode asks for. */
  #look(w, h, boxes, at) {
    const { pad } = this;
    this.middle = [(pad.left + w - pad.right) / 2, (pad.top + h - pad.bottom) / 2];
    const box = boxes.reduce((a, b) => [Math.min(a[0], b[0]), Math.min(a[1], b[1]), Math.max(a[2], b[2]), Math.max(a[3], b[3])],
      [Infinity, Infinity, -Infinity, -Infinity]);
    const known = Number.isFinite(box[0]);
    const wide = known ? Math.max(box[2] - box[0], 0.3) : 2, high = known ? Math.max(box[3] - box[1], 0.3) : 2;
    const scale = Math.max(Math.min((w - pad.left - pad.right) / wide, (h - pad.top - pad.bottom) / high), 1) * 0.94;
    const fit = { x: known ? (box[0] + box[2]) / 2 : 0, y: known ? (box[1] + box[3]) / 2 : 0, scale };
    let want = null;
    if (this.mode === "fit") want = fit;
    if (this.mode === "follow" && at) want = { x: at[0], y: at[1], scale: this.wish ?? fit.scale * 1.8 };
    if (this.mode === "fit") this.wish = null;
    const key = `${w}|${h}`;
    if (!this.view || this.fitted !== key || (want && calm())) this.view = want ?? this.view ?? fit;
    else if (want) {
      const part = 0.16, now = this.view;
      this.view = { x: now.x + part * (want.x - now.x), y: now.y + part * (want.y - now.y), scale: now.scale * (want.scale / now.scale) ** part };
    }
    this.fitted = key;
  }

  /** Draw `scene`: {route, trails: [{trail, style, row}], truth, vehicles: [{pose, style, footprint, …}], reference}. */
  draw(scene) {
    if (!this.canvas.fitted) this.#clear();
    const begun = begin(this.canvas);
    if (!begun) return;
    const [c, w, h] = begun, { route, trails, vehicles } = scene;
    const boxes = trails.map((one) => one.trail.update().box);
    if (route) boxes.push(route.box ??= boxOf(route));
    for (const { pose, footprint } of vehicles) {
      const r = size(footprint) * 0.6;
      if (pose) boxes.push([pose[0] - r, pose[1] - r, pose[0] + r, pose[1] + r]);
    }
    this.#look(w, h, boxes, vehicles[0]?.pose);
    const { view, middle } = this;
    this.X = (x) => middle[0] + (x - view.x) * view.scale;
    this.Y = (y) => middle[1] - (y - view.y) * view.scale;
    this.#grid(c, w, h);
    if (route) this.#route(c, route);
    for (const one of trails) if (one.trail.across) this.#corridor(c, one);
    for (const one of trails) this.#trail(c, one);
    for (const one of trails) if (one.trail.across) this.#ellipses(c, one);
    if (scene.reference) this.#reference(c, scene.reference, vehicles[0]?.pose);
    for (const one of vehicles.slice().reverse()) if (one.pose) this.#vehicle(c, one);
    this.#scale(c, w, h);
  }

  #grid(c, w, h) {
    const step = nice(110 / this.view.scale), [x0, y1] = this.place(0, 0), [x1, y0] = this.place(w, h), ways = [];
    for (let k = Math.ceil(x0 / step); k * step <= x1; k++) { const x = Math.round(this.X(k * step)) + 0.5; ways.push([x, 0], [x, h], null); }
    for (let k = Math.ceil(y0 / step); k * step <= y1; k++) { const y = Math.round(this.Y(k * step)) + 0.5; ways.push([0, y], [w, y], null); }
    line(c, ways, colours.grid, 1);
  }

  #route(c, { x, y, closed }) {
    if (!x.length) return;
    const way = x.map((one, k) => [this.X(one), this.Y(y[k])]);
    c.lineCap = "round";
    line(c, closed ? [...way, way[0]] : way, colours.route, Math.max(5, colours.rem * 0.42));
    dot(c, ...way[0], 4.5, colours.card, colours.muted);
  }

  #corridor(c, { trail, row }) {
    const p = trail.points, end = row === undefined ? p.length : trail.until(row);
    c.fillStyle = colours.corridor;
    c.beginPath();
    for (let k = 2; k - 2 < end - 1; k += 2) { // a quadrangle for two steps: half as many, and as smooth
      const a = p[k - 2], b = p[Math.min(k, end - 1)];
      if (Math.hypot(a[0] - b[0], a[1] - b[1]) > 20 * trail.step_m) continue;
      const left = [a[0] + a[3], a[1] + a[4]], right = [a[0] - a[3], a[1] - a[4]], leftNext = [b[0] + b[3], b[1] + b[4]], rightNext = [b[0] - b[3], b[1] - b[4]];
      this.#triangle(c, left, leftNext, rightNext); // where the turn is tighter than the corridor is wide, the sides cross
      this.#triangle(c, left, rightNext, right);
    }
    c.fill();
  }

  /** Add a triangle, all the same way round, so that none cuts a hole in another. */
  #triangle(c, p, q, r) {
    const turn = (q[0] - p[0]) * (r[1] - p[1]) - (r[0] - p[0]) * (q[1] - p[1]) > 0, [second, third] = turn ? [q, r] : [r, q];
    c.moveTo(this.X(p[0]), this.Y(p[1]));
    c.lineTo(this.X(second[0]), this.Y(second[1]));
    c.lineTo(this.X(third[0]), this.Y(third[1]));
    c.closePath();
  }

  #trail(c, { trail, style, row, paint }) {
    const p = trail.points, end = row === undefined ? p.length : trail.until(row);
    const { colour, width, dash } = STYLES[style];
    const way = (from, to, paint = colours[colour], wide = width, dashes = dash) => {
      const points = [];
      for (let k = from; k < to; k++) {
        if (k > from && Math.hypot(p[k][0] - p[k - 1][0], p[k][1] - p[k - 1][1]) > 20 * trail.step_m) points.push(null);
        points.push([this.X(p[k][0]), this.Y(p[k][1])]);
      }
      line(c, points, paint, wide, dashes);
    };
    c.lineCap = "round";
    if (end < p.length) { c.globalAlpha = 0.28; way(Math.max(end - 1, 0), p.length); c.globalAlpha = 1; }
    if (paint) {
      for (let k = 1, from = 0; k <= end; k++) {
        if (k < end && paint(p[k][2]) === paint(p[from][2])) continue;
        way(from, Math.min(k + 1, end), paint(p[from][2]), Math.max(4, 0.36 * colours.rem), []);
        from = k;
      }
    } else if (end > 1) way(0, end);
  }

  #ellipses(c, { trail, row }) {
    const { record } = trail, end = row ?? record.last;
    if (end < 0) return;
    c.lineWidth = 1.2;
    c.strokeStyle = colours.model;
    c.globalAlpha = 0.7;
    for (let s = Math.ceil(record.start / EVERY_S) * EVERY_S; s <= record.t[end]; s += EVERY_S) {
      const i = record.row(s), [xx, xy, yy] = ["P.xx", "P.xy", "P.yy"].map((name) => record.value(name, i));
      const x = record.value("eta.x", i), y = record.value("eta.y", i);
      if (!Number.isFinite(xx + xy + yy + x + y)) continue;
      const middle = (xx + yy) / 2, apart = Math.hypot((xx - yy) / 2, xy), angle = 0.5 * Math.atan2(2 * xy, xx - yy);
      const a = ELLIPSE * Math.sqrt(Math.max(middle + apart, 0)) * this.view.scale, b = ELLIPSE * Math.sqrt(Math.max(middle - apart, 0)) * this.view.scale;
      if (a < 3) continue;
      c.beginPath();
      c.ellipse(this.X(x), this.Y(y), a, b, -angle, 0, 7);
      c.stroke();
    }
    c.globalAlpha = 1;
  }

  #reference(c, [x, y], pose) {
    const at = [this.X(x), this.Y(y)];
    if (pose) line(c, [at, [this.X(pose[0]), this.Y(pose[1])]], colours.muted, 1, [3, 3]);
    dot(c, ...at, 7, null, colours.muted);
  }

  /** A vehicle: {pose: [x, y, psi], footprint, style: "now" | "ghost" | "true", sd_psi}. */
  #vehicle(c, { pose, footprint, style, sd_psi }) {
    const [x, y, psi] = pose, whole = size(footprint), s = Math.max(this.view.scale, SMALLEST / whole);
    c.save();
    c.translate(this.X(x), this.Y(y));
    c.rotate(-psi);
    if (style === "now" && sd_psi > 0) {
      const far = Math.max(whole * 1.6 * s, 34), wide = Math.min(1.96 * sd_psi, Math.PI);
      const fade = c.createRadialGradient(0, 0, 0, 0, 0, far);
      fade.addColorStop(0, colours.band);
      fade.addColorStop(1, "transparent");
      c.fillStyle = fade;
      c.beginPath();
      c.moveTo(0, 0);
      c.arc(0, 0, far, -wide, wide);
      c.fill();
    }
    const paint = style === "ghost" ? colours.ghost : colours.ink;
    if (style === "true") {
      c.setLineDash([4, 3]);
      c.lineWidth = 1.4;
      c.strokeStyle = colours.ink;
      bodyPath(c, footprint, s);
      c.stroke();
      c.restore();
      return;
    }
    c.globalAlpha = style === "ghost" ? 0.75 : 1;
    c.strokeStyle = colours.card;
    c.lineWidth = 2;
    for (const [wx, wy, wl, ww] of wheels(footprint)) {
      c.beginPath();
      c.roundRect((wx - wl / 2) * s, (wy - ww / 2) * s, wl * s, ww * s, ww * s * 0.3);
      c.fillStyle = paint;
      c.fill();
      c.stroke();
    }
    bodyPath(c, footprint, s);
    c.fill();
    c.stroke();
    const r = footprint.width_m * 0.3 * s; // which way is ahead
    c.beginPath();
    c.moveTo(r * 1.05, 0);
    c.lineTo(-r * 0.7, r * 0.8);
    c.lineTo(-r * 0.3, 0);
    c.lineTo(-r * 0.7, -r * 0.8);
    c.closePath();
    c.fillStyle = colours.card;
    c.fill();
    c.restore();
  }

  #scale(c, w, h) {
    const step = nice((w * 0.3) / this.view.scale), end = 16 + step * this.view.scale, y = h - 16;
    line(c, [[16, y - 5], [16, y], [end, y], [end, y - 5]], colours.muted, 1.5);
    label(c, step >= 1 ? `${num(step, 0)} m` : step >= 0.1 ? `${num(step, 1)} m` : `${num(step * 100, 0)} cm`, end + 8, y - 3, colours.muted, "left", 400);
  }
}

const STYLES = {
  estimate: { colour: "model", width: 2.6, dash: [] },
  truth: { colour: "ink", width: 1.4, dash: [5, 4] },
  ghost: { colour: "ghost", width: 2.4, dash: [9, 7] },
};

const size = ({ length_m, width_m }) => Math.max(length_m, width_m);

function boxOf({ x, y }) { return [Math.min(...x), Math.min(...y), Math.max(...x), Math.max(...y)]; }

/** Wheels as [x, y, long, wide] in the frame of the body. */
function wheels({ kind, length_m: L, width_m: W }) {
  if (kind === "car") return [1, -1].flatMap((a) => [1, -1].map((b) => [0.3 * a * L, 0.42 * b * W, 0.24 * L, 0.2 * W]));
  return [1, -1].map((b) => [0, 0.47 * b * W, 0.46 * L, 0.14 * W]);
}

function bodyPath(c, { kind, length_m: L, width_m: W }, s) {
  c.beginPath();
  if (kind === "car") c.roundRect((-L / 2) * s, (-0.4 * W) * s, L * s, 0.8 * W * s, 0.22 * W * s);
  else c.roundRect((-0.44 * L) * s, (-0.38 * W) * s, 0.88 * L * s, 0.76 * W * s, 0.28 * W * s);
}
