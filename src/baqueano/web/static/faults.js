// Faults of a simulated vehicle, their detection, and the drive without them.

import { arrow, axis, begin, clamp, colours, dot, label, line } from "./canvas.js";
import { choices, el, fill, form, put, show, write } from "./dom.js";
import { WAYS, action, enable, pauseButton, pressed, stick } from "./hand.js";
import { Map2D } from "./map.js";
import { trailsOf } from "./record.js";
import { num, percent, t, three } from "./strings.js";

const { hypot, max, PI } = Math;
const PACES = [0.125, 0.25, 1, 4];
const PUSH = 0.003, MOST_PUSH = 0.6, KEY_PUSH = 0.2; // N s: of a pixel, the largest, of a key
const STEEPEST = 0.1, KEY_TILT = PI / 360; // rad: at the edge of the pad, of a key
const SPAN = 20; // s
const BEFORE = 1; // s, for which the twin is shown before the fault

export class Faults {
  static key = "faults";

  constructor(page) {
    Object.assign(this, { page, rows: [], ...form("faults") });
    const { record, hello: { vehicle } } = page;
    this.map = new Map2D(this.mapCard);
    this.map.canvas.ariaLabel = t("faults.map");
    this.map.beside = () => (this.tiltCard.offsetTop > this.map.canvas.offsetHeight ? 0 : this.tiltCard.offsetWidth);
    this.map.pull = (drag, done) => {
      this.drag = done === undefined ? drag : null;
      if (done && hypot(drag[2] - drag[0], drag[3] - drag[1]) > 8) this.#push(impulse(drag));
    };
    this.trails = trailsOf(record, vehicle);
    this.pad = stick(92, (x, y) => this.#lean([STEEPEST * x, STEEPEST * y]), () => this.#tilted());
    this.pad.classList.add("live");
    this.pad.ariaLabel = t("faults.tilt-label");
    this.tiltCard.firstElementChild.after(this.pad);
    this.level.onclick = () => { this.#lean([0, 0]); this.#tilted(); };
    this.#breakers(vehicle);
    this.#bar();
    this.#before(null);
    this.ledger(page.ledger);
  }

  #push([x, y]) { this.#send({ kind: "push", frame: "map", x, y }); }

  /** `tilt`: rise of the floor towards x and y of the map [rad]. */
  #lean(tilt) {
    this.tilt = tilt;
    this.pad.put(tilt[0] / STEEPEST, tilt[1] / STEEPEST);
    write(this.steep, `${num((hypot(...tilt) * 180) / PI, 1)}°`);
  }

  #tilted() { this.#send({ kind: "tilt", x: this.tilt[0], y: this.tilt[1] }); }

  #breakers({ sensors = [], footprint }) {
    const imu = sensors.find((one) => one.kind === "imu"), of = (imu ?? sensors[0])?.name, gyro = imu ? 2 : 0;
    const unit = (channel) => this.page.record.field(`z.${of}[${channel}]`)?.unit ?? "", parts = (...all) => all.map((part) => [percent(part), { part }]);
    const kinds = {
      cut: sensors.map(({ name }) => [name, { target: name }]),
      drift: of ? [0.15, 0.05, 0.5].map((size) => [`+ ${num(size, 2)} ${unit(gyro)}`, { target: `${of}[${gyro}]`, size }]) : [],
      spikes: of ? [5, 20].map((size) => [`± ${size} ${unit(0)}, 2 %`, { target: `${of}[0]`, size, part: 0.02 }]) : [],
      slip: (footprint.kind === "car" ? ["all"] : ["left", "right", "all"]).map((one) => [`${t(`faults.wheel-${one}`)}, 30 %`, { target: one, part: 0.3 }]),
      sag: parts(0.84, 0.7), lose: parts(0.3, 0.6),
    };
    this.breakers = Object.entries(kinds).filter(([, options]) => options.length).map(([kind, options]) => this.#breaker(kind, options, t(`faults.${kind}${imu && ["drift", "spikes"].includes(kind) ? "-imu" : ""}`)));
    this.breakerCard.append(...this.breakers.map((one) => one.node));
  }

  #breaker(kind, options, name) {
    const parts = form("breaker"), { button, which, how } = parts, several = options.length > 1;
    put(parts, { name, how: options[0][0] });
    fill(which, options.map(([text], k) => [k, text]), 0);
    which.ariaLabel = `${name}: ${t("faults.how")}`;
    show(which, several);
    show(how, !several);
    button.ariaLabel = name;
    button.onclick = () => {
      const active = this.#active(kind);
      this.#send(active ? { end: active.number } : { kind, ...options[which.value][1] });
    };
    return { kind, ...parts };
  }

  #active(kind) { return this.rows.findLast((row) => row.fault.kind === kind && !row.ended); }

  #send(word) {
    if (this.page.hand.mine) this.page.send({ type: "shake", ...word });
    else this.page.say(t("pad.take"));
  }

  #bar() {
    const { page } = this;
    this.start = action("faults.start", "KeyR", () => this.#begin(), () => page.ready);
    this.pause = pauseButton(page);
    this.again = action("faults.again", "KeyG", () => this.#again(this.rows.at(-1)), () => this.rows.length && page.state.state !== "STOPPED");
    const tick = action("faults.tick", "KeyN", () => page.send({ type: "go", ticks: 1 }), () => page.moves);
    this.again.classList.add("again");
    this.start.classList.add("primary");
    this.actions = [this.start, this.pause, tick, this.again];
    this.bar.prepend(this.start, this.pause, tick);
    this.faultBar.append(this.again);
    choices(this.paces, PACES.indexOf(page.state.pace ?? 1), (k) => page.send({ type: "pace", factor: PACES[k] }));
  }

  /** Start a drive without a person, so that it can be repeated. */
  #begin() {
    const { page } = this, [route] = page.screens.drive.names;
    this.#before(null);
    page.send({ type: "mission", ...(route ? { kind: "repeat", route, laps: 5 } : { kind: "experiment", seconds: 120 }) });
  }

  #before(ghost) { this.ghost = ghost; show(this.ghostKey, ghost); }

  /** Drive again without a fault; the former drive stays as a ghost. */
  #again(row) {
    const { page } = this;
    if (!row) return;
    const record = page.record.kept();
    this.#before({ record, trail: trailsOf(record, page.hello.vehicle).truth, pushes: this.#arrows(record) });
    page.send({ type: "again", from_s: max(0, row.t_s - BEFORE), without: [row.number] });
  }

  ledger(rows) {
    this.rows = rows;
    const last = rows.at(-1), tilt = this.#active("tilt");
    this.list.replaceChildren(...(last ? rows.toReversed().map(entry) : [el("li.none", t("faults.none"))]));
    for (const made of this.breakers) made.button.ariaChecked = Boolean(this.#active(made.kind));
    if (!this.pad.matches(":active")) this.#lean(tilt ? [tilt.fault.x, tilt.fault.y] : [0, 0]);
    write(this.again.firstChild, last ? t("faults.again-of", { fault: last.text }) : t("faults.again"));
    this.buttons();
  }

  buttons() {
    show(this.start, !this.page.moves);
    show(this.pause, this.page.moves);
    enable(this.actions, this.page);
  }

  key(event, down) {
    const way = WAYS[event.code];
    if (way && event.target === this.pad) {
      const lean = this.tilt.map((x, k) => x + KEY_TILT * way[k]);
      if (!down) this.#tilted();
      else if (hypot(...lean) <= STEEPEST) this.#lean(lean);
      return true;
    }
    if (way && event.shiftKey) { if (down && !event.repeat) this.#push(way.map((x) => KEY_PUSH * x)); return true; }
    return pressed(this.actions, event, down) || this.map.key(event, down);
  }

  /** Return the pushes at the place of the vehicle: [x, y, N s to x, to y]. */
  #arrows(record) {
    return this.rows.filter((row) => row.fault.kind === "push" && row.t_s >= record.start).flatMap(({ t_s, fault: { frame, x, y } }) => {
      const pose = record.pose(record.row(t_s), "truth"), turn = frame === "map" ? 0 : pose?.[2], c = Math.cos(turn), s = Math.sin(turn);
      return pose ? [[pose[0], pose[1], c * x - s * y, s * x + c * y]] : [];
    });
  }

  draw() {
    const { page, map, ghost, drag } = this, { record, hello: { vehicle } } = page, i = record.last, truth = record.pose(i, "truth"), estimate = record.pose(i);
    const vehicles = [{ pose: truth, vehicle }], trails = ["estimate", "truth"].map((style) => ({ trail: this.trails[style], style }));
    if (ghost) {
      trails.unshift({ trail: ghost.trail, style: "ghost" });
      vehicles.push({ pose: ghost.record.pose(ghost.record.row(record.end), "truth"), vehicle, style: "ghost" });
    }
    map.draw({ route: page.route, trails, vehicles });
    const c = map.canvas.context;
    if (map.view) {
      if (estimate) this.#estimate(c, estimate, truth, vehicle.footprint);
      for (const one of ghost?.pushes ?? []) this.#arrow(c, one, "ghost");
      for (const one of this.#arrows(record)) this.#arrow(c, one, "alarm");
      if (drag) pushed(c, drag, "alarm", impulse(drag));
    }
    show(this.hint, !this.rows.length && !drag);
    for (const made of this.breakers) { const row = this.#active(made.kind); write(made.lasts, row && `${three(max(0, record.end - row.t_s))} s`); }
    this.#errors(record);
  }

  #estimate(c, pose, truth, { width_m }) {
    const { map } = this, [x, y] = map.at(pose), r = 0.55 * width_m * map.view.scale;
    dot(c, x, y, max(r, 11), null, "model");
    dot(c, x, y, 4, "model");
    if (!truth) return;
    const [X, Y] = map.at(truth), far = (y < Y ? -1 : 1) * (max(r, 14) + 0.8 * colours.rem);
    if (hypot(x - X, y - Y) < 2.2 * colours.rem) return;
    label(c, t("faults.estimate"), x, y + far, "model");
    label(c, t("faults.true-here"), X, Y - far, "ink");
  }

  #arrow(c, [x, y, dx, dy], colour) {
    const much = hypot(dx, dy), [px, py] = this.map.at([x, y]), near = 12, far = near + clamp(much / PUSH, 26, 90), ux = dx / much, uy = -dy / much;
    pushed(c, [px - ux * far, py - uy * far, px - ux * near, py - uy * near], colour, [dx, dy]);
  }

  #errors(record) {
    const [c, w, h] = begin(this.strip), points = [];
    if (!c || record.length < 2) return;
    const end = max(record.end, record.start + SPAN), from = end - SPAN, left = 3.6 * colours.rem, X = axis(from, end, left, w);
    let most = 0.02;
    for (let x = left; x <= w; x += 2) {
      const s = axis(left, w, from, end)(x);
      if (s < record.start || s > record.end) continue;
      const i = record.row(s), [ex, ey, tx, ty] = record.values(i, "eta.x", "eta.y", "truth.x", "truth.y"), off = hypot(ex - tx, ey - ty), within = 1.96 * Math.sqrt(record.ellipse(i)[0]);
      points.push([x, off, within]);
      most = max(most, off, within);
    }
    for (const { t_s, fault } of this.rows) if (t_s > from) line(c, [[X(t_s), 0], [X(t_s), h]], fault.kind === "tilt" ? "sim" : "alarm", 1.5);
    const Y = axis(0, most, h - 3, 3);
    line(c, points.map(([x, , within]) => [x, Y(within)]), "model", 2.2);
    line(c, points.map(([x, off]) => [x, Y(off)]), "ink", 1.6, [5, 4]);
    label(c, `${num(100 * most, most < 0.1 ? 1 : 0)} cm`, 0, 0.6 * colours.rem, "muted", "left");
  }
}

function entry({ fault, text, t_s, until_s, ended, detections, undetected, missed_by }) {
  const lines = detections.map((one) => el("p.detected", el("b", one.detector), ` ${t("faults.after", { s: num(one.after_s, one.after_s < 0.95 ? 2 : 1) })}: `, el("span", one.text)));
  if (undetected) lines.push(el("p.undetected", el("b", t("faults.undetected")), ` ${undetected}`));
  else lines.push(el("p.missed", detections.length ? `${t("faults.missed")} ${missed_by.join(", ")}` : t("faults.wait")));
  const long = ended && fault.kind !== "push" ? t("faults.ended", { s: num(until_s - t_s) }) : "";
  return el("li", el("time", num(t_s)), el("div", el("p.fault", el("b", text), " ", el("span", long)), lines));
}

/** Return the impulse [N s] of a drag, to x and y of the map. */
function impulse([x0, y0, x1, y1]) {
  const x = PUSH * (x1 - x0), y = PUSH * (y0 - y1), less = Math.min(1, MOST_PUSH / hypot(x, y));
  return [x * less, y * less];
}

function pushed(c, [x0, y0, x1, y1], colour, push) {
  const long = hypot(x1 - x0, y1 - y0), ux = (x1 - x0) / long, uy = (y1 - y0) / long;
  if (long < 4) return;
  c.lineCap = "butt";
  arrow(c, [[x0, y0], [x1, y1]], colour, 3.5, 12);
  label(c, `${num(hypot(...push), 2)} N s`, x0 - ux * 8, y0 - uy * 8 - (Math.abs(uy) < 0.5 ? 0.9 * colours.rem : 0), colour);
}
