// Strips: a signal against time, one line a pixel column from its least to its greatest value.

import { begin, colours, follow, line } from "./canvas.js";
import { el, key, region, write } from "./dom.js";
import { t, three } from "./strings.js";

const LINES = {
  measured: { colour: "measured", width: 1.1, dash: [], alpha: 0.9 },
  model: { colour: "model", width: 1.7, dash: [], alpha: 1 },
  applied: { colour: "ink", width: 1.4, dash: [], alpha: 1 },
  asked: { colour: "ghost", width: 1.4, dash: [4, 3], alpha: 1 },
  ghost: { colour: "ghost", width: 1.4, dash: [6, 3], alpha: 1 },
};

export class Strip {
  /** `traces`: [{name, line}]; `band`: the name of a standard deviation, drawn ± 1.96 of it about zero. */
  constructor({ title, unit, traces, band = null, scale = 1 }) {
    Object.assign(this, { title, traces, band, scale });
    this.canvas = follow(el("canvas", { "aria-hidden": "true" }));
    this.values = traces.map(({ line }) => el(`b.value.${line}`));
    this.node = el("figure.strip",
      el("figcaption", el("b", title), " ", el("span.unit", unit), el("span.values", ...this.values)),
      this.canvas);
    this.low = this.high = NaN;
  }

  /** Draw from `from` to `to` [s]; the values are those of `row`; `cursor` is a time, or null. */
  draw(record, from, to, row, cursor = null) {
    this.traces.forEach(({ name, source }, k) => write(this.values[k], three((source ? source.value(name, row) : record.value(name, row)) * this.scale)));
    const begun = begin(this.canvas);
    if (!begun) return;
    const [c, w, h] = begun, first = Math.max(record.lower(from) - 1, 0), last = record.lower(to);
    const columns = this.traces.map(({ name, source }) => (source ?? record).column(name));
    const sd = this.band ? record.column(this.band) : null;
    this.#range(columns, sd, first, last);
    if (!(this.high > this.low)) return;
    const { low, high } = this, span = high - low;
    const X = w / (to - from), Y = (v) => h - 3 - ((v - low) / span) * (h - 6);
    this.#axes(c, w, h, Y, from, to, X);
    const time = record.t;
    if (sd) band(c, time, sd, first, last, from, X, Y, w, true);
    this.traces.forEach(({ line }, k) => {
      if (!columns[k]) return;
      const style = LINES[line];
      c.strokeStyle = colours[style.colour];
      c.lineWidth = style.width;
      c.globalAlpha = style.alpha;
      c.setLineDash(style.dash);
      c.lineJoin = "round";
      trace(c, time, columns[k], first, last, from, X, Y, w);
    });
    c.globalAlpha = 1;
    c.setLineDash([]);
    if (sd) band(c, time, sd, first, last, from, X, Y, w, false);
    if (cursor !== null) {
      const x = (cursor - from) * X;
      line(c, [[x, 0], [x, h]], colours.ink, 1.4);
    }
  }

  /** Take a wider range at once, and a narrower one slowly, so that the picture does not breathe. */
  #range(columns, sd, first, last) {
    let low = Infinity, high = -Infinity;
    for (const v of columns) {
      if (!v) continue;
      for (let i = first; i < last; i++) { const x = v[i]; if (x < low) low = x; if (x > high) high = x; }
    }
    if (sd && last > first) {
      const half = Math.min(1.96 * sd[last - 1], 3 * Math.max(-low, high)); // that of now: the band of the first moments may be far wider
      if (half > 0) { high = Math.max(high, half); low = Math.min(low, -half); }
    }
    if (!(low <= high)) { if (Number.isFinite(this.low)) return; [this.low, this.high] = [NaN, NaN]; return; }
    if (low > 0 && low < 0.5 * high) low = 0;
    if (high < 0 && high > 0.5 * low) high = 0;
    const margin = Math.max((high - low) * 0.06, 1e-6 + Math.abs(high) * 1e-3);
    [low, high] = [low - margin, high + margin];
    const part = 0.06;
    this.low = !(this.low <= low) ? low : this.low + part * (low - this.low);
    this.high = !(this.high >= high) ? high : this.high + part * (high - this.high);
  }

  #axes(c, w, h, Y, from, to, X) {
    const step = to - from > 150 ? 60 : to - from > 45 ? 10 : to - from > 15 ? 5 : 1;
    const ways = [];
    for (let s = Math.ceil(from / step) * step; s < to; s += step) { const x = Math.round((s - from) * X) + 0.5; ways.push([x, 0], [x, h], null); }
    line(c, ways, colours.grid, 1);
    const zero = Math.round(Y(0)) + 0.5;
    if (this.low < 0 && this.high > 0) line(c, [[0, zero], [w, zero]], colours.line, 1);
  }
}

/** One line a pixel column, from its least to its greatest value, in the order in which they came. */
function trace(c, time, v, first, last, from, X, Y, w) {
  c.beginPath();
  let column = -1e9, low = 0, high = 0, lowAt = 0, highAt = 0, broken = true;
  const flush = () => {
    if (column < -1e8) return;
    const x = column + 0.5, [a, b] = lowAt < highAt ? [low, high] : [high, low];
    if (broken) c.moveTo(x, Y(a)); else c.lineTo(x, Y(a));
    if (b !== a) c.lineTo(x, Y(b));
    broken = false;
  };
  for (let i = first; i < last; i++) {
    const y = v[i];
    if (y !== y) { flush(); column = -1e9; broken = true; continue; }
    const x = Math.floor((time[i] - from) * X);
    if (x !== column) {
      flush();
      column = x; low = high = y; lowAt = highAt = i;
    } else if (y < low) { low = y; lowAt = i; } else if (y > high) { high = y; highAt = i; }
  }
  flush();
  c.stroke();
}

/** ± 1.96 standard deviations about zero, as an area or as its two edges; where nothing was predicted there is none. */
function band(c, time, sd, first, last, from, X, Y, w, area) {
  const every = Math.max(1, Math.floor((last - first) / w)), upper = [];
  c.beginPath();
  const close = () => {
    if (area) for (let k = upper.length - 2; k >= 0; k -= 2) c.lineTo(upper[k], Y(-upper[k + 1]));
    else for (let k = 0; k < upper.length; k += 2) c[k ? "lineTo" : "moveTo"](upper[k], Y(-upper[k + 1]));
    if (area) c.closePath();
    upper.length = 0;
  };
  for (let i = first; i < last; i += every) {
    const half = 1.96 * sd[i], x = (time[i] - from) * X;
    if (half !== half) { if (upper.length) close(); continue; }
    if (upper.length) c.lineTo(x, Y(half)); else c.moveTo(x, Y(half));
    upper.push(x, half);
  }
  if (upper.length) close();
  if (area) { c.fillStyle = colours.band; c.fill(); return; }
  c.strokeStyle = colours.model;
  c.lineWidth = 1.2;
  c.setLineDash([2, 2]);
  c.stroke();
  c.setLineDash([]);
}

/** Return the strips of a vehicle in three groups: measurement against model, innovation in its band, command. */
export function groupsOf(record, vehicle) {
  const measured = [], innovations = [], commands = [], known = (name) => record.has(name);
  for (const channel of record.channels) {
    const { label, unit } = record.field(`z.${channel}`), [model, innovation, sd] = ["model", "innov", "S"].map((one) => `${one}.${channel}`);
    measured.push(new Strip({ title: label, unit, traces: [{ name: `z.${channel}`, line: "measured" }, ...(known(model) ? [{ name: model, line: "model" }] : [])] }));
    if (known(innovation)) innovations.push(new Strip({ title: label, unit, traces: [{ name: innovation, line: "measured" }], band: known(sd) ? sd : null }));
  }
  vehicle.command.forEach(({ low, high, unit }, k) => {
    if (low === high || !known(`u.${k}`)) return;
    commands.push(new Strip({ title: record.field(`u.${k}`).label, unit, traces: [{ name: `u.${k}`, line: "applied" }, ...(known(`asked.${k}`) ? [{ name: `asked.${k}`, line: "asked" }] : [])] }));
  });
  return [["measured", measured, ["measured", "model"]], ["innovations", innovations, ["band"]], ["commands", commands, ["applied", "asked"]]].filter(([, strips]) => strips.length);
}

/** The list of strips, each group under its own line that says what the lines mean. */
export function stripList(groups) {
  const keys = (kinds) => kinds.map((kind) => key(kind, t(`strip.${kind}`)));
  return region("div.strip-list", t("strips"), ...groups.flatMap(([name, strips, kinds]) => [
    el("div.group", el("h2", t(`strips.${name}`)), ...keys(kinds)), ...strips.map((one) => one.node)]));
}
