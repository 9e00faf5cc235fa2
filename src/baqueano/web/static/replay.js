// Any run, to be scrubbed, with the ghost of a second one beside it, paired by distance or by time.

import { area, begin, colours, dot, follow, line } from "./canvas.js";
import { alone, choices, el, empty, fill, select, show, write } from "./dom.js";
import { HonestyCard, Numbers, drawMap, mapKeys } from "./drive.js";
import { Map2D } from "./map.js";
import { Honesty, Trail } from "./record.js";
import { Strip, groupsOf, stripList } from "./strips.js";
import { clock, duration, length, num, t } from "./strings.js";

const RATES = [0.125, 0.25, 0.5, 1, 2, 4, 8];
const RATE_WORDS = ["⅛×", "¼×", "½×", "1×", "2×", "4×", "8×"];
const AHEAD = RATES.indexOf(1);

/** What was opened: its rows, and what is known about it. */
export class Opened {
  constructor(record, about) {
    Object.assign(this, { record, about });
    const step = about.vehicle.footprint.width_m / 18;
    this.estimate = new Trail(record, "eta.x", "eta.y", step, true);
    this.path = new Trail(record, "eta.x", "eta.y", step);
    this.truth = new Trail(record, "truth.x", "truth.y", step);
    this.label = about.filter ? t("replay.through", { name: about.filter }) : about.run.name;
  }
}

export class Replay {
  static key = "replay";

  constructor(page) {
    this.page = page;
    this.now_s = 0;
    this.playing = false;
    this.rate = AHEAD;
    this.by = "distance";
    this.node = el("div.replay");
    this.build();
  }

  get run() { return this.page.opened; }
  get ghost() { return this.page.ghost; }

  /** Make the screen for what is open now. */
  build() {
    const { run, ghost, page } = this;
    this.pairs = null;
    this.table = null;
    if (!run) {
      this.node.replaceChildren(empty(t("replay.none"), el("p", t("replay.none-how")),
        el("button.primary", { onclick: () => page.open("runs") }, t("tab.runs"))));
      return;
    }
    this.map = new Map2D();
    this.numbers = new Numbers();
    this.honesty = new HonestyCard(run.record);
    const groups = ghost ? this.#pairedGroups() : groupsOf(run.record, run.about.vehicle);
    this.strips = groups.flatMap(([, strips]) => strips);
    this.tableNode = el("table.compare");
    this.node.replaceChildren(
      this.map.card(mapKeys(run.record.has("truth.x"), ghost ? t("replay.ghost-of", { name: ghost.label }) : null), this.numbers.node),
      el("section.card.strips", ghost ? this.tableNode : null, stripList(groups), ghost ? null : this.honesty.node),
      this.#transport());
    this.seek(Math.min(this.now_s, run.record.end));
  }

  #pairedGroups() {
    const { run } = this, made = [];
    const add = (name, title, unit, scale = 1) => { if (run.record.has(name)) made.push(new Strip({ title, unit, scale, traces: [{ name, line: "model" }, { name, line: "ghost" }] })); };
    add("cross", t("strip.cross"), "m");
    add("nu.u", t("strip.speed"), "m/s");
    add("nu.r", t("strip.turn"), "rad/s");
    run.about.vehicle.command.forEach(({ low, high, unit }, k) => { if (low < high) add(`u.${k}`, run.record.field(`u.${k}`)?.label ?? `u.${k}`, unit); });
    return [["paired", made, []]];
  }

  #transport() {
    const { page } = this;
    this.play = el("button.primary.play", { onclick: () => this.toggle() });
    this.rates = choices(t("replay.rate"), RATE_WORDS, this.rate, (k) => { this.rate = k; });
    this.scrub = follow(el("canvas.scrub", { tabindex: "0", role: "slider", "aria-label": t("replay.scrub"), "aria-valuemin": "0" }));
    const at = (e) => this.seek(((e.offsetX - 2) / (this.scrub.clientWidth - 4)) * this.run.record.end);
    let held = false;
    this.scrub.addEventListener("pointerdown", (e) => { this.scrub.setPointerCapture(e.pointerId); held = true; this.scrub.focus(); at(e); });
    this.scrub.addEventListener("pointermove", (e) => { if (held) at(e); });
    for (const name of ["pointerup", "lostpointercapture"]) this.scrub.addEventListener(name, () => { held = false; });
    this.when = el("b");
    this.whole = el("span");
    this.happened = el("p.happened");
    const again = (...what) => page.openRun(this.run.about.run.id, ...what);
    this.other = select(t("replay.ghost"), [], "", (id) => again(id || null));
    this.beside = el("label.pick", t("replay.ghost"), this.other);
    this.filter = select(t("replay.filter"), [["", t("replay.no-filter")]], "", (kind) => again(null, kind || null));
    this.through = el("label.pick", t("replay.filter"), this.filter);
    this.filters();
    this.runs();
    const ways = ["distance", "time", ...(this.ghost && this.#marks().every((one) => one.length) ? ["mark"] : [])];
    const pairing = choices(t("replay.pair"), ways.map((one) => t(`replay.by-${one}`)), ways.indexOf(this.by), (k) => { this.by = ways[k]; this.pairs = null; });
    return el("section.card.transport", { "aria-label": t("replay.controls") },
      el("div.line", this.play, this.scrub, el("span.when", this.when, this.whole)),
      el("div.line", this.rates, this.happened, this.beside, this.through,
        this.ghost ? el("div.pick", el("span", t("replay.pair")), pairing) : null));
  }

  /** List the filters through which the same data may go: those of its room, and the project's own. */
  filters() {
    const id = this.run.about.run.id, list = (kinds) => fill(this.filter, [["", t("replay.no-filter")], ...kinds], this.ghost?.about.filter ?? "");
    if (this.kinds?.of === id) list(this.kinds.list);
    else this.page.link.ask("block", { run: id, room: "estimator" }, ({ kinds }) => { this.kinds = { of: id, list: kinds ?? [] }; show(this.through, this.kinds.list.length > 0); list(this.kinds.list); });
  }

  #marks() { return [this.run, this.ghost].map(({ about }) => about.events.filter((one) => one.source === "mark").map((one) => one.t)); }

  /** List what may stand beside the run. */
  runs() {
    if (!this.run) return;
    const others = this.page.runs.filter((one) => one.id !== this.run.about.run.id), ghost = this.ghost?.about.run.id;
    fill(this.other, [["", t("replay.no-ghost")], ...others.map((one) => [one.id, one.name])], this.ghost?.about.filter ? "" : ghost ?? "");
    show(this.beside, others.length > 0);
  }

  toggle() {
    if (!this.run) return;
    this.playing = !this.playing;
    if (this.playing && this.now_s >= this.run.record.end - 1e-3) this.seek(0);
    this.last_ms = null;
  }

  seek(seconds) {
    const { record } = this.run;
    this.now_s = Math.min(Math.max(seconds, record.start), record.end);
  }

  key(event, down) {
    if (!this.run) return false;
    const { record } = this.run, tick = 1 / this.run.about.vehicle.rate_hz, far = event.shiftKey ? 1 : tick;
    const act = {
      KeyK: () => this.toggle(), ...(this.page.hello.mode === "replay" ? { Space: () => this.toggle() } : {}),
      ArrowLeft: () => this.seek(this.now_s - far), ArrowRight: () => this.seek(this.now_s + far),
      PageUp: () => this.seek(this.now_s - 5), PageDown: () => this.seek(this.now_s + 5),
      Home: () => this.seek(0), End: () => this.seek(record.end),
      BracketLeft: () => this.#faster(-1), BracketRight: () => this.#faster(1), KeyN: () => this.#event(1), KeyV: () => this.#event(-1),
    }[event.code];
    if (!act || !alone(event) || event.target.tagName === "SELECT") return this.map.key(event, down);
    if (down) act();
    return true;
  }

  #faster(more) {
    this.rates.children[Math.min(Math.max(this.rate + more, 0), RATES.length - 1)].click();
  }

  #event(way) {
    const times = this.run.about.events.map((one) => one.t).sort((a, b) => a - b);
    const next = way > 0 ? times.find((s) => s > this.now_s + 1e-6) : times.reverse().find((s) => s < this.now_s - 1e-6);
    if (next !== undefined) this.seek(next);
  }

  opened() { this.build(); }

  /** Return the ghost's row for each row of the run. */
  #paired() {
    const { run, ghost } = this;
    if (this.pairs && this.pairs.rows === run.record.length && this.pairs.others === ghost.record.length) return this.pairs;
    const marks = this.by === "mark" ? this.#marks() : null;
    const key = this.by === "distance" && [run, ghost].every((one) => Number.isFinite(one.record.value("progress", one.record.last))) ? "progress" : "t";
    const mine = marks ? run.record.t.map((s) => aligned(s, ...marks)) : run.record.column(key), theirs = ghost.record.column(key), map = new Int32Array(run.record.length);
    for (let i = 0, j = 0; i < map.length; i++) {
      while (j + 1 < ghost.record.length && !(theirs[j] >= mine[i])) j++;
      map[i] = mine[i] > theirs[ghost.record.last] ? -1 : j;
    }
    const columns = new Map();
    const source = {
      column: (name) => {
        if (!columns.has(name)) { const from = ghost.record.column(name); columns.set(name, from && Float32Array.from(map, (j) => (j < 0 ? NaN : from[j]))); }
        return columns.get(name);
      },
      value: (name, i) => source.column(name)?.[i] ?? NaN,
    };
    for (const strip of this.strips) strip.traces[1].source = source;
    return (this.pairs = { map, rows: run.record.length, others: ghost.record.length });
  }

  /** Let time go on while it plays. */
  advance(now_ms) {
    if (!this.playing) return;
    if (this.last_ms) this.seek(this.now_s + ((now_ms - this.last_ms) / 1000) * RATES[this.rate]);
    this.last_ms = now_ms;
    if (this.now_s >= this.run.record.end) this.playing = false;
  }

  draw(now_ms) {
    const { run, ghost } = this;
    if (!run?.record.length) return;
    const { record } = run;
    this.advance(now_ms);
    const i = record.row(this.now_s), row = ghost ? this.#paired().map[i] : -1;
    const other = ghost && { record: ghost.record, trail: ghost.path, row: row < 0 ? ghost.record.last : row, footprint: ghost.about.vehicle.footprint };
    drawMap(this.map, run.about.route, record, ghost ? run.path : run.estimate, run.truth, i, run.about.vehicle.footprint, i, other);
    this.numbers.draw(record, i);
    for (const one of this.strips) one.draw(record, record.start, Math.max(record.end, record.start + 1e-3), i, this.now_s);
    if (ghost) this.#compare(); else this.honesty.draw(i, record.start, record.end);
    this.#scrubbing(i);
  }

  #scrubbing() {
    const { record } = this.run, { scrub } = this;
    const sign = this.playing ? "❚❚" : "▶";
    if (this.play.textContent !== sign) { this.play.textContent = sign; this.play.setAttribute("aria-label", t(this.playing ? "replay.pause" : "replay.play")); }
    write(this.when, duration(this.now_s));
    write(this.whole, ` / ${duration(record.end)}`);
    scrub.setAttribute("aria-valuemax", record.end.toFixed(2));
    scrub.setAttribute("aria-valuenow", this.now_s.toFixed(2));
    scrub.setAttribute("aria-valuetext", duration(this.now_s));
    const near = this.run.about.events.filter((one) => one.t <= this.now_s + 1e-6 && one.t > this.now_s - 3).pop();
    write(this.happened, near ? `${duration(near.t)} · ${near.text}` : "");
    const begun = begin(scrub);
    if (!begun) return;
    const [c, w, h] = begun, X = (s) => 2 + ((w - 4) * (s - record.start)) / Math.max(record.end - record.start, 1e-3);
    const { peaks, most } = this.#peaks(Math.floor(w - 4)), shape = Array.from(peaks, (peak, x) => [x + 2, h - 5 - (peak / most) * (h - 12)]);
    area(c, [[2, h - 4], ...shape, [w - 2, h - 4]], colours.band);
    line(c, shape, colours.muted, 1.3);
    line(c, shape.filter(([x]) => x <= X(this.now_s)), colours.model, 2.2);
    for (const one of this.run.about.events) {
      const grave = ["warning", "error", "fatal"].includes(one.severity), x = X(one.t), colour = grave ? colours.alarm : colours.sim;
      line(c, [[x, 3], [x, h - 4]], colour, grave ? 2.4 : 1.6, grave ? [] : [4, 3]);
      if (grave) area(c, [[x - 4, 0], [x + 4, 0], [x, 7]], colour);
    }
    const x = X(this.now_s);
    line(c, [[x, 0], [x, h]], colours.ink, 2);
    dot(c, x, h - 5, 5, colours.ink);
  }

  /** Return the greatest error in each column of the scrub bar: off the route, or where there is none, off the truth. */
  #peaks(columns) {
    const { record } = this.run;
    if (this.curve?.of === record && this.curve.peaks.length === columns) return this.curve;
    const cross = record.column("cross"), X = record.column("eta.x"), Y = record.column("eta.y"), TX = record.column("truth.x"), TY = record.column("truth.y");
    const peaks = new Float32Array(columns), span = Math.max(record.end - record.start, 1e-3);
    for (let i = 0; i < record.length; i++) {
      const x = Math.min(Math.floor(((record.t[i] - record.start) / span) * columns), columns - 1);
      const error = cross && Number.isFinite(cross[i]) ? Math.abs(cross[i]) : TX ? Math.hypot(TX[i] - X[i], TY[i] - Y[i]) : 0;
      if (error > peaks[x]) peaks[x] = error;
    }
    return (this.curve = { of: record, peaks, most: peaks.reduce((a, b) => Math.max(a, b), 1e-6) });
  }

  /** Write which of the two is better: a smaller number, in bold. */
  #compare() {
    const { run, ghost } = this, key = `${run.record.length}|${ghost.record.length}`;
    if (this.table === key) return;
    this.table = key;
    const [a, b] = [run, ghost].map(({ record, about }) => figures(record, about));
    const centimetres = (x) => length(x).join(" "), percent = (x) => `${num(100 * x, 0)} %`;
    const rows = [["rms", centimetres, 1], ["most", centimetres, 1], ["honest", percent, -1], ["jerk", (x) => num(x, 3), 1]];
    const cell = (mine, other, shown, sign) => el("td", { class: sign * mine < sign * other ? "better" : null }, Number.isFinite(mine) ? shown(mine) : "–");
    this.tableNode.replaceChildren(
      el("thead", el("tr", el("td"), el("th", { scope: "col" }, el("i.dot.estimate"), run.label), el("th", { scope: "col" }, el("i.dot.ghosted"), ghost.label))),
      el("tbody", ...rows.map(([name, shown, sign]) => el("tr", el("th", { scope: "row" }, t(`compare.${name}`)), cell(a[name], b[name], shown, sign), cell(b[name], a[name], shown, sign)))));
  }
}

/** Return the time of the other run that a time of this one is paired with: marks pair, between them time runs evenly. */
function aligned(s, mine, theirs) {
  const last = Math.min(mine.length, theirs.length) - 1, k = Math.min(mine.findLastIndex((one) => one <= s), last);
  if (k < 0) return theirs[0] + s - mine[0];
  return k < last ? theirs[k] + ((s - mine[k]) * (theirs[k + 1] - theirs[k])) / (mine[k + 1] - mine[k]) : theirs[k] + s - mine[k];
}

/** Return what the table compares. */
function figures(record, { vehicle }) {
  const cross = record.column("cross"), honesty = new Honesty(record);
  let sum = 0, n = 0, most = 0, inside = 0, judged = 0, jerk = 0, steps = 0;
  for (let i = 0; i < record.length; i++) {
    if (cross && Number.isFinite(cross[i])) { sum += cross[i] ** 2; n++; most = Math.max(most, Math.abs(cross[i])); }
    if (i % 10 === 0) { const one = honesty.at(i); if (one) { judged++; if (one.mean >= one.low && one.mean <= one.high) inside++; } }
  }
  vehicle.command.forEach(({ low, high }, k) => {
    const u = record.column(`u.${k}`);
    if (!u || low === high) return;
    for (let i = 1; i < record.length; i++) { const d = u[i] - u[i - 1]; if (Number.isFinite(d)) { jerk += d * d; steps++; } }
  });
  return { rms: n ? Math.sqrt(sum / n) : NaN, most: n ? most : NaN, honest: judged ? inside / judged : NaN, jerk: steps ? Math.sqrt(jerk / steps) : NaN };
}
