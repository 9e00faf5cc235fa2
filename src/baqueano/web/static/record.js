// The rows of a drive by column: a window that rolls while it drives, or a whole run.

export class Record {
  /** `rows`: how many to keep at least; a record that does not roll grows. */
  constructor(fields, rows, rolling) {
    this.fields = fields;
    this.at = new Map(fields.map((field, k) => [field.name, k]));
    this.rows = Math.max(rows, 64);
    this.rolling = rolling;
    this.columns = fields.map(() => new Float32Array(2 * this.rows));
    this.length = 0;
    this.version = 0; // grows whenever a row has another index than before
  }

  get t() { return this.columns[this.at.get("t")]; }
  get last() { return this.length - 1; }
  get start() { return this.length ? this.t[0] : 0; }
  get end() { return this.length ? this.t[this.length - 1] : 0; }

  has(name) { return this.at.has(name); }
  column(name) { const k = this.at.get(name); return k === undefined ? null : this.columns[k]; }
  value(name, i = this.last) { const k = this.at.get(name); return k === undefined || i < 0 ? NaN : this.columns[k][i]; }

  clear() { this.length = 0; this.version++; }

  /** Add R rows × F values. Time that goes back is a new drive: what was before it goes. */
  add(values, R) {
    const F = this.fields.length, time = this.at.get("t");
    if (R && this.length && values[time] < this.end - 1e-3) this.clear();
    let from = 0;
    for (let r = 1; r < R; r++) if (values[r * F + time] < values[(r - 1) * F + time] - 1e-3) from = r;
    if (from) this.clear();
    this.#room(R - from);
    for (let k = 0; k < F; k++) {
      const column = this.columns[k];
      for (let r = from, i = this.length; r < R; r++, i++) column[i] = values[r * F + k];
    }
    this.length += R - from;
  }

  #room(more) {
    const capacity = this.columns[0].length;
    if (this.length + more <= capacity) return;
    if (this.rolling && more <= this.rows) {
      const gone = this.length - Math.min(this.length, this.rows);
      for (const column of this.columns) column.copyWithin(0, gone, this.length);
      this.length -= gone;
      this.version++;
      return;
    }
    const size = Math.max(2 * capacity, this.length + more);
    this.columns = this.columns.map((column) => { const grown = new Float32Array(size); grown.set(column); return grown; });
  }

  /** Return the first row at or after a time. */
  lower(seconds) {
    const t = this.t;
    let low = 0, high = this.length;
    while (low < high) { const middle = (low + high) >> 1; if (t[middle] < seconds) low = middle + 1; else high = middle; }
    return low;
  }

  /** Return the row in force at a time. */
  row(seconds) {
    const i = this.lower(seconds);
    return i < this.length && this.t[i] === seconds ? i : Math.max(0, Math.min(i, this.length) - 1);
  }

  /** Return the channels that are measured, as their names without the prefix. */
  get channels() { return this.fields.filter((f) => f.name.startsWith("z.")).map((f) => f.name.slice(2)); }

  field(name) { return this.fields[this.at.get(name)]; }
}

/** The places of a record, thinned to steps that can be seen; each knows its row. */
export class Trail {
  /** `x`, `y`: names of columns; `step_m`: shorter steps are left out; `across`: with the corridor. */
  constructor(record, x, y, step_m, across = false) {
    Object.assign(this, { record, x, y, step_m, across, version: -1 });
    this.reset();
  }

  reset() {
    this.points = []; // x, y, row, and with a corridor the half width as a vector
    this.done = 0;
    this.box = [Infinity, Infinity, -Infinity, -Infinity];
    this.version = this.record.version;
  }

  update() {
    const { record, box, step_m } = this;
    if (this.version !== record.version) { this.reset(); return this.update(); }
    const X = record.column(this.x), Y = record.column(this.y);
    if (!X || !Y) return this;
    let [lastX, lastY] = this.points.length ? this.points[this.points.length - 1] : [NaN, NaN];
    for (; this.done < record.length; this.done++) {
      const i = this.done, x = X[i], y = Y[i];
      if (!(Number.isFinite(x) && Number.isFinite(y))) continue;
      if ((x - lastX) ** 2 + (y - lastY) ** 2 < step_m * step_m) continue;
      this.points.push(this.across ? [x, y, i, ...this.#side(i)] : [x, y, i]);
      [lastX, lastY] = [x, y];
      const [, , , wide = 0, high = 0] = this.points.at(-1).map(Math.abs);
      box[0] = Math.min(box[0], x - wide); box[1] = Math.min(box[1], y - high);
      box[2] = Math.max(box[2], x + wide); box[3] = Math.max(box[3], y + high);
    }
    return this;
  }

  /** 1.96 standard deviations across the path, as a vector to the left. */
  #side(i) {
    const half = 1.96 * across(this.record, i), psi = this.record.value("eta.psi", i);
    return Number.isFinite(half) ? [-Math.sin(psi) * half, Math.cos(psi) * half] : [0, 0];
  }

  /** Return how many points lie at or before a row. */
  until(row) {
    let low = 0, high = this.points.length;
    while (low < high) { const m = (low + high) >> 1; if (this.points[m][2] <= row) low = m + 1; else high = m; }
    return low;
  }
}

/** Return the standard deviation [m] of the place across the path: √(nᵀ P n), n to the left of the heading. */
export function across(record, i) {
  const psi = record.value("eta.psi", i), nx = -Math.sin(psi), ny = Math.cos(psi);
  const variance = nx * nx * record.value("P.xx", i) + 2 * nx * ny * record.value("P.xy", i) + ny * ny * record.value("P.yy", i);
  return Math.sqrt(Math.max(variance, 0));
}

/** The mean of the NIS over a window, and its 95 % band: a χ² of n·m degrees over n·m. */
export class Honesty {
  constructor(record, window_s = 10) {
    Object.assign(this, { record, window_s, version: -1 });
    this.components = Math.max(1, record.fields.filter((f) => f.name.startsWith("innov.")).length);
  }

  #update() {
    const { record } = this;
    if (this.version !== record.version || this.sums.length < record.columns[0].length + 1) {
      this.sums = new Float64Array(record.columns[0].length + 1);
      this.counts = new Float64Array(record.columns[0].length + 1);
      this.done = 0;
      this.version = record.version;
    }
    const nis = record.column("nis");
    for (; this.done < record.length; this.done++) {
      const i = this.done, seen = nis && Number.isFinite(nis[i]) ? 1 : 0;
      this.sums[i + 1] = this.sums[i] + (seen ? nis[i] : 0);
      this.counts[i + 1] = this.counts[i] + seen;
    }
  }

  /** Return {mean, low, high} of the window that ends at this row; null where less than 2 s are known. */
  at(i) {
    this.#update();
    const { record } = this;
    if (i < 0 || i >= record.length) return null;
    const from = record.lower(record.t[i] - this.window_s), n = this.counts[i + 1] - this.counts[from];
    if (n < 20 || record.t[i] - record.t[from] < 2) return null;
    const half = 1.96 * Math.sqrt(2 / (n * this.components));
    return { mean: (this.sums[i + 1] - this.sums[from]) / n, low: 1 - half, high: 1 + half };
  }
}
