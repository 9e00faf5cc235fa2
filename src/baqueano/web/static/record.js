// The rows of a drive by column.

const { max, min, sqrt } = Math;

/** Return the first of 0 … count from which a test is true. */
function first(count, holds) {
  let low = 0, high = count;
  while (low < high) { const middle = (low + high) >> 1; if (holds(middle)) high = middle; else low = middle + 1; }
  return low;
}

export class Record {
  /** `rows`: the least number to keep; a record that does not roll grows. */
  constructor(fields, rows, rolling) {
    Object.assign(this, { fields, rolling, rows: max(rows, 64), length: 0 });
    this.version = 0; // grows if a row gets another index
    this.at = new Map(fields.map((field, k) => [field.name, k]));
    this.columns = fields.map(() => new Float32Array(2 * this.rows));
  }

  get t() { return this.column("t"); }
  get last() { return this.length - 1; }
  get start() { return this.length ? this.t[0] : 0; }
  get end() { return this.length ? this.t[this.last] : 0; }

  get edge() { return max(this.end, this.start + 1e-3); } // for an axis

  has(name) { return this.at.has(name); }
  field(name) { return this.fields[this.at.get(name)]; }
  column(name) { return this.columns[this.at.get(name)]; }
  value(name, i = this.last) { return this.column(name)?.[i] ?? NaN; }
  values(i, ...names) { return names.map((name) => this.value(name, i)); }

  get channels() { return this.fields.filter((one) => one.name.startsWith("z.")).map((one) => one.name.slice(2)); }

  /** Return [x, y, ψ] of a row, or null if one is not finite. */
  pose(i, of = "eta") {
    const pose = this.values(i, `${of}.x`, `${of}.y`, `${of}.psi`);
    return pose.every(Number.isFinite) ? pose : null;
  }

  /** Return the variances [m²] of the place along its long and short axis, and the angle of the long one. */
  ellipse(i) {
    const [xx, xy, yy] = this.values(i, "P.xx", "P.xy", "P.yy"), middle = (xx + yy) / 2, apart = Math.hypot((xx - yy) / 2, xy);
    return [max(middle + apart, 0), max(middle - apart, 0), 0.5 * Math.atan2(2 * xy, xx - yy)];
  }

  /** Return 1.96 √(nᵀ P n) [m], and n: to the left of the heading. */
  across(i) {
    const [psi, xx, xy, yy] = this.values(i, "eta.psi", "P.xx", "P.xy", "P.yy"), nx = -Math.sin(psi), ny = Math.cos(psi);
    return [1.96 * sqrt(max(nx * nx * xx + 2 * nx * ny * xy + ny * ny * yy, 0)), nx, ny];
  }

  /** Add R rows × F values. An earlier time begins a new drive. */
  add(values, R) {
    if (!R) return;
    const F = this.fields.length, time = this.at.get("t");
    let from = 0, before = this.length ? this.end : -Infinity, back = false;
    for (let r = 0; r < R; r++) {
      const now = values[r * F + time];
      if (now < before - 1e-3) [from, back] = [r, true];
      before = now;
    }
    if (back) { this.length = 0; this.version++; }
    this.#room(R - from);
    this.columns.forEach((column, k) => { for (let r = from, i = this.length; r < R; r++, i++) column[i] = values[r * F + k]; });
    this.length += R - from;
  }

  #room(more) {
    const capacity = this.columns[0].length;
    if (this.length + more <= capacity) return;
    if (this.rolling && more <= this.rows) {
      const gone = max(this.length - this.rows, 0);
      for (const column of this.columns) column.copyWithin(0, gone, this.length);
      this.length -= gone;
      this.version++;
      return;
    }
    const size = max(2 * capacity, this.length + more);
    this.columns = this.columns.map((column) => { const grown = new Float32Array(size); grown.set(column); return grown; });
  }

  kept() {
    const { fields, columns, length } = this;
    return Object.assign(new Record(fields, 0, false), { columns: columns.map((one) => one.slice(0, length)), length });
  }

  lower(seconds) { const { t } = this; return first(this.length, (i) => t[i] >= seconds); }

  row(seconds) { const { t } = this; return max(first(this.length, (i) => t[i] > seconds) - 1, 0); }
}

const MOST = 2000; // points of a trail

/** The places of a record at visible steps, each with its row. */
class Trail {
  /** `of`: eta or truth; `corridor`: with the 95 % corridor. */
  constructor(record, { footprint }, of, corridor = false) {
    Object.assign(this, { record, of, corridor, least_m: footprint.width_m / 18 });
  }

  update() {
    const { record, of, corridor } = this, X = record.column(`${of}.x`), Y = record.column(`${of}.y`), rows = X && Y ? record.length : 0;
    if (this.version !== record.version) {
      Object.assign(this, { points: [], box: [Infinity, Infinity, -Infinity, -Infinity], done: 0, step_m: this.least_m, version: record.version }); // points: x, y, row, half width as a vector
    }
    let [lastX, lastY] = this.points.at(-1) ?? [NaN, NaN];
    for (let i = this.done; i < rows; i++) {
      const x = X[i], y = Y[i];
      if (!Number.isFinite(x + y) || (x - lastX) ** 2 + (y - lastY) ** 2 < this.step_m ** 2) continue;
      const [half, nx, ny] = corridor ? record.across(i) : [0, 0, 0], side = [nx * half || 0, ny * half || 0], [wide, high] = side.map(Math.abs);
      this.points.push([x, y, i, ...side]);
      this.box = union(this.box, [x - wide, y - high, x + wide, y + high]);
      [lastX, lastY] = [x, y];
      if (this.points.length > MOST) { this.points = this.points.filter((_, k) => k % 2 < 1); this.step_m *= 2; }
    }
    this.done = rows;
    return this;
  }

  until(row = Infinity) { return first(this.points.length, (k) => this.points[k][2] > row); }
}

export function trailsOf(record, vehicle) {
  const trail = (...what) => new Trail(record, vehicle, ...what);
  return { estimate: trail("eta", true), path: trail("eta"), truth: trail("truth") };
}

export const movable = ({ command }) => command.flatMap(({ low, high }, k) => (low < high ? [k] : []));

/** A box is [least x, y, greatest x, y]. */
export const union = (a, b) => [min(a[0], b[0]), min(a[1], b[1]), max(a[2], b[2]), max(a[3], b[3])];

export const boxOf = ({ x, y }) => [min(...x), min(...y), max(...x), max(...y)];

/** Return the mean NIS over 10 s and its 95 % band, χ² of n·m degrees over n·m; null before 2 s. */
export function nisMean(record, i) {
  const nis = record.column("nis"), { t } = record;
  if (!nis || i < 0 || i >= record.length) return null;
  const from = record.lower(t[i] - 10), m = max(1, record.channels.length);
  let sum = 0, n = 0;
  for (let k = from; k <= i; k++) if (nis[k] === nis[k]) { sum += nis[k]; n++; }
  if (n < 20 || t[i] - t[from] < 2) return null;
  const half = 1.96 * sqrt(2 / (n * m)), mean = sum / n;
  return { mean, low: 1 - half, high: 1 + half };
}
