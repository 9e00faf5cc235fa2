// A run with a slider for its time, beside the ghost of a second run.

import { area, axis, begin, clamp, dot, line } from "./canvas.js";
import { choices, drag, el, empty, fill, form, head, keyed, put, row, show, write } from "./dom.js";
import { drawMap, nisCard } from "./drive.js";
import { Map2D } from "./map.js";
import { nisMean, movable } from "./record.js";
import { signals, stripList } from "./strips.js";
import { duration, length, num, percent, t } from "./strings.js";

const { abs, floor, max, min } = Math;
const WAYS = ["distance", "time", "mark"];
const RATES = [0.125, 0.25, 0.5, 1, 2, 4, 8];

export class Replay {
  static key = "replay";

  constructor(page) {
    Object.assign(this, { page, now_s: 0, playing: false, rate: RATES.indexOf(1), by: WAYS[0], node: el("div.replay") });
    this.build();
  }

  get run() { return this.page.opened; }
  get ghost() { return this.page.ghost; }
  get sign() { return this.playing ? "❚❚" : "▶"; }

  build() {
    const { run, ghost, page } = this;
    this.pairs = this.curve = null;
    if (!run) {
      this.node.replaceChildren(empty(t("replay.none"), el("p", t("replay.none-how")), el("button.primary", { onclick: () => page.open("runs") }, t("tab.runs"))));
      return;
    }
    const { record, about: { vehicle } } = run;
    Object.assign(this, form("replay", this.node));
    this.map = new Map2D(this.mapCard);
    write(this.ghostKey, ghost && t("replay.ghost-of", { name: ghost.label }));
    this.node.dataset.ghost = Boolean(ghost);
    show(this.truthKey, !ghost && record.has("truth.x"));
    this.nis = nisCard(record);
    if (ghost) this.#compare(); else this.side.append(this.nis.node);
    const same = (name) => ({ lines: { [name]: "model" }, ghost: true });
    this.strips = stripList(this.list, record, ghost ? { paired: ["cross", "nu.u", "nu.r", ...movable(vehicle).map((k) => `u.${k}`)].map(same) } : signals(record, vehicle));
    this.#transport();
    this.seek(this.now_s);
  }

  #transport() {
    const { page, run, ghost, scrub } = this, again = (...what) => page.openRun(run.about.run.id, ...what);
    this.play.onclick = () => this.toggle();
    choices(this.rates, this.rate, (k) => { this.rate = k; });
    drag(scrub, ({ offsetX }) => this.seekPart((offsetX - 2) / (scrub.clientWidth - 4)));
    this.other.onchange = () => again(this.other.value);
    this.runs();
    const { id } = run.about.run, list = (kinds) => { // filters for the same data
      this.kinds = { id, kinds };
      show(this.through, kinds.length > 0);
      fill(this.filter, [["", t("replay.no-filter")], ...kinds], ghost?.about.filter ?? "", (kind) => again(null, kind));
    };
    list(this.kinds?.id === id ? this.kinds.kinds : []);
    if (!this.kinds.kinds.length) page.ask("block", { run: id, room: "estimator" }, ({ kinds = [] }) => { if (run === this.run) list(kinds); });
    const marked = Boolean(ghost) && this.#marks().every((one) => one.length), { ways } = this;
    if (this.by === "mark" && !marked) this.by = WAYS[0];
    show(ways.lastElementChild, marked);
    choices(ways, WAYS.indexOf(this.by), (k) => { this.by = WAYS[k]; this.pairs = null; });
  }

  #marks() { return [this.run, this.ghost].map(({ about }) => about.events.filter((one) => one.source === "mark").map((one) => one.t)); }

  runs() {
    if (!this.run) return;
    const { about } = this.ghost ?? {}, others = this.page.runs.filter((one) => one.id !== this.run.about.run.id);
    fill(this.other, [["", t("replay.no-ghost")], ...others.map((one) => [one.id, one.name])], about && !about.filter ? about.run.id : "");
    show(this.beside, others.length > 0);
  }

  opened() { this.build(); }

  toggle() {
    if (!this.run) return;
    this.playing = !this.playing;
    if (this.playing && this.now_s >= this.run.record.end - 1e-3) this.seek(0);
    this.last_ms = null;
  }

  seek(seconds) { this.now_s = clamp(seconds, this.run.record.start, this.run.record.end); }

  seekPart(part) { if (this.run) this.seek(axis(0, 1, this.run.record.start, this.run.record.end)(part)); }

  key(event, down) {
    if (!this.run) return false;
    const { run: { record, about }, now_s } = this, far = event.shiftKey ? 1 : 1 / about.vehicle.rate_hz, to = (seconds) => () => this.seek(seconds), toggle = () => this.toggle();
    const acts = {
      KeyK: toggle, ...(this.page.recorded && { Space: toggle }), Home: to(0), End: to(record.end),
      ArrowLeft: to(now_s - far), ArrowRight: to(now_s + far), PageUp: to(now_s - 5), PageDown: to(now_s + 5),
      BracketLeft: () => this.#faster(-1), BracketRight: () => this.#faster(1), KeyN: () => this.#event(1), KeyV: () => this.#event(-1),
    };
    return (event.target.tagName !== "SELECT" && keyed(acts, event, down)) || this.map.key(event, down);
  }

  #faster(more) { this.rates.children[clamp(this.rate + more, 0, RATES.length - 1)].click(); }

  #event(way) {
    const later = this.run.about.events.map((one) => way * (one.t - this.now_s)).filter((far) => far > 1e-6);
    if (later.length) this.seek(this.now_s + way * min(...later));
  }

  #paired() {
    const { run: { record: mine }, ghost: { record: other } } = this;
    const marks = this.by === "mark" ? this.#marks() : null, key = this.by === "distance" && [mine, other].every((one) => Number.isFinite(one.value("progress"))) ? "progress" : "t";
    const from = marks ? mine.t.map((s) => aligned(s, ...marks)) : mine.column(key), to = other.column(key);
    let j = 0;
    const map = Int32Array.from({ length: mine.length }, (_, i) => {
      while (j < other.last && !(to[j] >= from[i])) j++;
      return from[i] > to[other.last] ? -1 : j;
    });
    for (const { traces: [{ name }, ghost] } of this.strips) {
      const theirs = other.column(name), column = theirs && Float32Array.from(map, (k) => theirs[k] ?? NaN);
      ghost.source = { column: () => column, value: (_, i) => column?.[i] ?? NaN };
    }
    return { map };
  }

  advance(now_ms) {
    if (!this.playing) return;
    if (this.last_ms) this.seek(this.now_s + ((now_ms - this.last_ms) / 1000) * RATES[this.rate]);
    this.last_ms = now_ms;
    if (this.now_s >= this.run.record.end) this.playing = false;
  }

  draw(now_ms) {
    const { run, ghost } = this;
    if (!run?.record.length) return;
    this.advance(now_ms);
    const { record, about } = run, { start, end } = record, { now_s } = this, i = record.row(now_s), paired = ghost && (this.pairs ??= this.#paired()).map[i];
    drawMap(this, about.route, run, i, i, ghost && { ...ghost, row: paired < 0 ? ghost.record.last : paired });
    for (const one of this.strips) one.draw(start, record.edge, i, now_s);
    if (!ghost) this.nis.draw(i, start, end);
    this.#scrubbing();
  }

  #scrubbing() {
    const { scrub, now_s, run: { record, about: { events } } } = this, { start, end } = record;
    this.play.ariaLabel = t(this.playing ? "replay.pause" : "replay.play");
    Object.assign(scrub, { ariaValueMax: end.toFixed(2), ariaValueNow: now_s.toFixed(2), ariaValueText: duration(now_s) });
    const near = events.findLast((one) => one.t <= now_s + 1e-6 && one.t > now_s - 3);
    put(this, { play: this.sign, when: duration(now_s), whole: ` / ${duration(end)}`, happened: near && `${duration(near.t)} · ${near.text}` });
    const [c, w, h] = begin(scrub);
    if (!c) return;
    const X = axis(start, record.edge, 2, w - 2), { peaks, most } = this.#peaks(floor(w - 4)), Y = axis(0, most, h - 5, 7), shape = Array.from(peaks, (peak, x) => [x + 2, Y(peak)]), now = X(now_s);
    area(c, [[2, h - 4], ...shape, [w - 2, h - 4]], "band");
    line(c, shape, "muted", 1.3);
    line(c, shape.filter(([x]) => x <= now), "model", 2.2);
    for (const one of events) {
      const grave = ["warning", "error"].includes(one.severity), x = X(one.t), colour = grave ? "alarm" : "sim";
      line(c, [[x, 3], [x, h - 4]], colour, grave ? 2.4 : 1.6, grave ? [] : [4, 3]);
      if (grave) area(c, [[x - 4, 0], [x + 4, 0], [x, 7]], colour);
    }
    line(c, [[now, 0], [now, h]], "ink", 2);
    dot(c, now, h - 5, 5, "ink");
  }

  /** Return the greatest error of each pixel column, from the route or from the truth. */
  #peaks(columns) {
    const { record } = this.run;
    if (this.curve?.peaks.length === columns) return this.curve;
    const peaks = new Float32Array(columns), place = axis(record.start, record.edge, 0, columns);
    for (let i = 0; i < record.length; i++) {
      const [cross, x, y, X, Y] = record.values(i, "cross", "eta.x", "eta.y", "truth.x", "truth.y"), k = min(floor(place(record.t[i])), columns - 1);
      const error = Number.isFinite(cross) ? abs(cross) : Math.hypot(X - x, Y - y);
      if (error > peaks[k]) peaks[k] = error;
    }
    return (this.curve = { peaks, most: peaks.reduce((a, b) => max(a, b), 1e-6) });
  }

  #compare() {
    const { run, ghost } = this, [a, b] = [run, ghost].map(figures), name = ({ label }, kind) => [el(`i.dot.${kind}`), label];
    const cm = (x) => length(x).join(" "), rows = { rms: [cm, 1], peak: [cm, 1], nis: [percent, -1], jerk: [(x) => num(x, 3), 1] };
    this.table.replaceChildren(head(name(run, "estimate"), name(ghost, "ghosted")), el("tbody", Object.entries(rows).map(([key, [shown, sign]]) =>
      row(t(`compare.${key}`), [a, b].map((one) => (Number.isFinite(one[key]) ? shown(one[key]) : "–")), [1, -1].indexOf(Math.sign(sign * (b[key] - a[key])))))));
  }
}

/** Align the times of two runs by marks, linearly between them. */
function aligned(s, mine, theirs) {
  const last = min(mine.length, theirs.length) - 1, k = min(mine.findLastIndex((one) => one <= s), last);
  if (k < 0) return theirs[0] + s - mine[0];
  return k < last ? axis(mine[k], mine[k + 1], theirs[k], theirs[k + 1])(s) : theirs[k] + s - mine[k];
}

function figures({ record, about: { vehicle } }) {
  const all = (name) => Array.from(record.column(name)?.subarray(0, record.length) ?? []), mean = (values) => values.reduce((sum, one) => sum + one, 0) / values.length, rms = (values) => Math.sqrt(mean(values.map((one) => one * one)));
  const cross = all("cross").filter(Number.isFinite).map(abs), jerks = movable(vehicle).flatMap((k) => all(`u.${k}`).map((u, i, us) => u - us[i - 1])).filter(Number.isFinite);
  const judged = Array.from({ length: Math.ceil(record.length / 10) }, (_, k) => nisMean(record, 10 * k)).filter(Boolean).map(({ mean, low, high }) => Number(mean >= low && mean <= high));
  return { rms: rms(cross), peak: cross.reduce((a, b) => max(a, b), cross.length ? 0 : NaN), nis: mean(judged), jerk: rms(jerks) };
}
