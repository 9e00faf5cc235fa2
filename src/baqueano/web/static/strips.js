// Strips: a signal over time, with a line per pixel column from its least to its greatest value.

import { area, axis, begin, follow, line, sharp, stroke } from "./canvas.js";
import { el, write } from "./dom.js";
import { movable } from "./record.js";
import { t, three } from "./strings.js";

const { floor, max, min } = Math;
const LINES = {
  measured: { colour: "measured", width: 1.1 },
  model: { colour: "model", width: 1.7 },
  applied: { colour: "ink", width: 1.4 },
  requested: { colour: "ghost", width: 1.4, dash: [4, 3] },
  ghost: { colour: "ghost", width: 1.4, dash: [6, 3] },
};

class Strip {
  constructor(record, { lines, title, band, ghost = false, kind = "strip" }) {
    const [[name]] = lines, { label, unit } = record.field(name), same = lines.every(([name]) => record.field(name).unit === unit);
    this.traces = [...lines, ...(ghost ? [[name, "ghost"]] : [])].map(([name, kind]) => ({ name, kind, source: record }));
    this.canvas = follow(el("canvas", { ariaHidden: true }));
    this.values = this.traces.map((one) => el(`b.value.${one.kind}`));
    this.node = el(`figure.${kind}`, el("figcaption", el("b", title ?? label), " ", el("span.unit", same ? unit : ""), el("span.values", this.values)), this.canvas);
    this.plain = kind !== "strip";
    this.record = record;
    this.std = record.has(band) ? band : null;
  }

  draw(from, to, row, cursor = null) {
    const { record, traces } = this;
    traces.forEach(({ name, source }, k) => write(this.values[k], three(source.value(name, row))));
    const [c, w, h] = begin(this.canvas);
    if (!c) return;
    const first = max(record.lower(from) - 1, 0), last = record.lower(to), columns = traces.map(({ name, source }) => source.column(name)), std = record.column(this.std);
    this.#range(columns, std, first, last);
    if (!(this.high > this.low)) return;
    const X = axis(from, to, 0, w), Y = axis(this.low, this.high, h - 3, 3), edges = std ? band(record.t, std, first, last, X, Y, w) : [];
    if (!this.plain) this.#grid(c, w, h, X, Y, from, to);
    for (const [upper, lower] of edges) area(c, [...upper, ...lower.toReversed()], "band");
    traces.forEach(({ kind }, k) => {
      const { colour, width, dash } = LINES[kind];
      if (!columns[k]) return;
      trace(c, record.t, columns[k], first, last, X, Y);
      stroke(c, colour, width, dash);
    });
    for (const edge of edges.flat()) line(c, edge, "model", 1.2, [2, 2]);
    if (cursor !== null) line(c, [[X(cursor), 0], [X(cursor), h]], "ink", 1.4);
  }

  /** Take a wider range at once, and a narrower one slowly. */
  #range(columns, std, first, last) {
    let low = Infinity, high = -Infinity;
    for (const v of columns) for (let i = first; v && i < last; i++) { if (v[i] < low) low = v[i]; if (v[i] > high) high = v[i]; }
    if (std && last > first) {
      const half = min(1.96 * std[last - 1], 3 * max(-low, high)); // at present: the first values may be far wider
      if (half > 0) [low, high] = [min(low, -half), max(high, half)];
    }
    if (!(low <= high)) return;
    if (low > 0 && low < 0.5 * high) low = 0;
    if (high < 0 && high > 0.5 * low) high = 0;
    const margin = max((high - low) * 0.06, 1e-6 + Math.abs(high) * 1e-3);
    low -= margin;
    high += margin;
    this.low = this.low <= low ? this.low + 0.06 * (low - this.low) : low;
    this.high = this.high >= high ? this.high + 0.06 * (high - this.high) : high;
  }

  #grid(c, w, h, X, Y, from, to) {
    const step = to - from > 150 ? 60 : to - from > 45 ? 10 : to - from > 15 ? 5 : 1, zero = sharp(Y(0)), ways = [];
    for (let s = Math.ceil(from / step) * step; s < to; s += step) ways.push([sharp(X(s)), 0], [sharp(X(s)), h], null);
    line(c, ways, "grid");
    if (this.low < 0 && this.high > 0) line(c, [[0, zero], [w, zero]], "line");
  }
}

/** Make a path of the least and greatest value in each pixel column, in their order. */
function trace(c, time, v, first, last, X, Y) {
  let pen = "moveTo", column = NaN, low = 0, high = 0, lowAt = 0, highAt = 0;
  const flush = () => {
    const x = column + 0.5, [a, b] = lowAt < highAt ? [low, high] : [high, low];
    c[pen](x, Y(a));
    if (b !== a) c.lineTo(x, Y(b));
    pen = "lineTo";
  };
  c.beginPath();
  for (let i = first; i < last; i++) {
    const y = v[i], x = y === y ? floor(X(time[i])) : NaN;
    if (x === column) {
      if (y < low) { low = y; lowAt = i; } else if (y > high) { high = y; highAt = i; }
      continue;
    }
    if (column === column) flush();
    if (x !== x) pen = "moveTo";
    column = x; low = high = y; lowAt = highAt = i;
  }
  if (column === column) flush();
}

/** Return the edges ± 1.96 σ about zero, in the parts with a prediction. */
function band(time, std, first, last, X, Y, w) {
  const pieces = [], every = max(1, floor((last - first) / w));
  let upper = null, lower;
  for (let i = first; i < last; i += every) {
    const half = 1.96 * std[i], x = X(time[i]);
    if (half !== half) { upper = null; continue; }
    if (!upper) pieces.push([upper, lower] = [[], []]);
    upper.push([x, Y(half)]);
    lower.push([x, Y(-half)]);
  }
  return pieces;
}

/** Make strips from {lines: {column: kind}, band: the column of a standard deviation, ghost: also for another run}. */
export const stripsOf = (record, specs) =>
  specs.map((one) => ({ ...one, lines: Object.entries(one.lines).filter(([name]) => record.has(name)) })).filter((one) => one.lines.length).map((one) => new Strip(record, one));

export const signals = (record, vehicle) => ({
  measured: record.channels.map((one) => ({ lines: { [`z.${one}`]: "measured", [`model.${one}`]: "model" } })),
  innovations: record.channels.map((one) => ({ lines: { [`innov.${one}`]: "measured" }, band: `S.${one}` })),
  commands: movable(vehicle).map((k) => ({ lines: { [`u.${k}`]: "applied", [`requested.${k}`]: "requested" } })),
});

const KEYS = { measured: ["measured", "model"], innovations: ["band"], commands: ["applied", "requested"], paired: [] };

export function stripList(list, record, groups) {
  const made = Object.entries(groups).map(([name, specs]) => [name, stripsOf(record, specs)]).filter(([, strips]) => strips.length);
  list.replaceChildren(...made.flatMap(([name, strips]) =>
    [el("div.group", el("h2", t(`strips.${name}`)), KEYS[name].map((kind) => el(`span.key.${kind}`, t(`strip.${kind}`)))), ...strips.map((one) => one.node)]));
  return made.flatMap(([, strips]) => strips);
}
