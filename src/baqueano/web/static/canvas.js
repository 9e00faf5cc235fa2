// A canvas of the size of its box, and its drawing functions.

const { floor, max, min, round } = Math;
let cache = {};
const style = () => getComputedStyle(document.documentElement);

/** `colours.ink` is `--ink` of the style sheet, read once for a theme. */
export const colours = new Proxy({}, { get: (_, name) => cache[name] ??= style().getPropertyValue(`--${name}`).trim() });
export function readColours() { cache = { rem: parseFloat(style().fontSize) }; }
const paint = (colour) => colours[colour] || colour; // a name of the theme, or any colour

/** Return `count` colours [red, green, blue] along a row of "#rrggbb". */
export function ramp(row, count) {
  const stops = row.map((one) => [1, 3, 5].map((k) => parseInt(one.slice(k, k + 2), 16)));
  return Array.from({ length: count }, (_, n) => {
    const at = (n / (count - 1)) * (stops.length - 1), k = min(floor(at), stops.length - 2);
    return stops[k].map((from, j) => from + (at - k) * (stops[k + 1][j] - from));
  });
}

const sizes = new ResizeObserver((entries) => {
  for (const { target } of entries) target.fitted = false;
  readColours();
});

export function follow(canvas) { sizes.observe(canvas); return canvas; }

/** Return [context, width, height] in CSS pixels, cleared; nothing for an empty box. */
export function begin(canvas) {
  if (!canvas.fitted) {
    const { width, height } = canvas.getBoundingClientRect(), scale = min(devicePixelRatio, 2);
    Object.assign(canvas, { w: width, h: height, width: round(width * scale), height: round(height * scale), scale, fitted: true });
  }
  const { w, h, scale } = canvas;
  if (w < 8 || h < 8) return [];
  const c = canvas.context ??= canvas.getContext("2d");
  c.setTransform(scale, 0, 0, scale, 0, 0);
  c.clearRect(0, 0, w, h);
  return [c, w, h];
}

export const clamp = (x, low, high) => min(max(x, low), high);

/** Map [from, to] to the pixels [first, last]. */
export function axis(from, to, first, last) {
  const scale = (last - first) / (to - from);
  return (x) => first + scale * (x - from);
}

/** Move a thin line to the middle of a pixel, where it is sharp. */
export const sharp = (x) => round(x) + 0.5;

/** Return the largest 1, 2 or 5 times a power of ten within a size. */
export function nice(size) {
  const ten = 10 ** floor(Math.log10(size));
  return ten * (size / ten >= 5 ? 5 : size / ten >= 2 ? 2 : 1);
}

export function stroke(c, colour, width = 1, dash = []) {
  c.strokeStyle = paint(colour);
  c.lineWidth = width;
  c.lineJoin = "round";
  c.setLineDash(dash);
  c.stroke();
}

export function fill(c, colour) {
  c.fillStyle = paint(colour);
  c.fill();
}

/** Draw a line through points [x, y]; null lifts the pen. */
export function line(c, points, colour, width, dash) {
  let down = false;
  c.beginPath();
  for (const one of points) {
    if (one) c[down ? "lineTo" : "moveTo"](...one);
    down = one;
  }
  stroke(c, colour, width, dash);
}

export function dot(c, x, y, r, inside, edge = null) {
  c.beginPath();
  c.arc(x, y, r, 0, 7);
  if (inside) fill(c, inside);
  if (edge) stroke(c, edge, 2);
}

export function area(c, points, colour) {
  c.beginPath();
  for (const one of points) c.lineTo(...one);
  fill(c, colour);
}

export function box(c, x, y, w, h, r) {
  c.beginPath();
  c.roundRect(x, y, w, h, r);
}

export function arrow(c, way, colour, width, head) {
  const [[x0, y0], [x, y]] = way.slice(-2), far = Math.hypot(x - x0, y - y0) || 1, ux = (head * (x - x0)) / far, uy = (head * (y - y0)) / far;
  line(c, [...way.slice(0, -1), [x - 0.75 * ux, y - 0.75 * uy]], colour, width);
  area(c, [[x, y], [x - ux - 0.5 * uy, y - uy + 0.5 * ux], [x - ux + 0.5 * uy, y - uy - 0.5 * ux]], colour);
}

/** Write a text with a halo, so that it reads on any line. */
export function label(c, text, x, y, colour, align = "center", weight = 600) {
  c.font = `${weight} ${0.8 * colours.rem}px ${colours.font}`;
  c.textAlign = align;
  c.textBaseline = "middle";
  c.lineWidth = 4;
  c.lineJoin = "round";
  c.setLineDash([]);
  c.strokeStyle = colours.card;
  c.strokeText(text, x, y);
  c.fillStyle = paint(colour);
  c.fillText(text, x, y);
}
