// A canvas that has the size of its box, and the colours of the theme.

const NAMES = ["ink", "muted", "faint", "line", "grid", "card", "measured", "model", "route", "ghost", "alarm", "band", "corridor", "sim", "quiet", "middle", "loud"];
export const colours = {};

export function readColours() {
  const style = getComputedStyle(document.documentElement);
  for (const name of NAMES) colours[name] = style.getPropertyValue(`--${name}`).trim();
  colours.font = style.getPropertyValue("--font").trim();
  colours.rem = parseFloat(style.fontSize);
}

/** Return so many colours from quiet to loud: lighter or darker all the way, so that they need no hue. */
export function ramp(count) {
  const ends = ["quiet", "middle", "loud"].map((name) => colours[name]).join();
  if (ramp.ends !== ends) {
    const rgb = ends.split(",").map((one) => [1, 3, 5].map((k) => parseInt(one.slice(k, k + 2), 16)));
    ramp.made = Array.from({ length: count }, (_, k) => {
      const at = (2 * k) / (count - 1), from = rgb[Math.min(Math.floor(at), 1)], to = rgb[Math.min(Math.floor(at), 1) + 1], part = at - Math.min(Math.floor(at), 1);
      return `rgb(${from.map((c, j) => Math.round(c + part * (to[j] - c))).join(" ")})`;
    });
    ramp.ends = ends;
  }
  return ramp.made;
}

const sizes = new ResizeObserver((entries) => {
  for (const { target } of entries) target.fitted = false;
  readColours();
});

/** Follow the box of a canvas from now on. */
export function follow(canvas) { sizes.observe(canvas); return canvas; }
export function leave(canvas) { sizes.unobserve(canvas); }

/** Return [context, width, height] in CSS pixels, cleared; null for a box without size. */
export function begin(canvas) {
  if (!canvas.fitted) {
    const box = canvas.getBoundingClientRect(), scale = Math.min(devicePixelRatio || 1, 2);
    canvas.w = box.width;
    canvas.h = box.height;
    canvas.width = Math.round(box.width * scale);
    canvas.height = Math.round(box.height * scale);
    canvas.scale = scale;
    canvas.fitted = true;
  }
  if (canvas.w < 8 || canvas.h < 8) return null;
  const c = canvas.context ??= canvas.getContext("2d");
  c.setTransform(canvas.scale, 0, 0, canvas.scale, 0, 0);
  c.clearRect(0, 0, canvas.w, canvas.h);
  return [c, canvas.w, canvas.h];
}

/** Return 1, 2 or 5 times a power of ten, the largest that does not exceed a size. */
export function nice(size) {
  const ten = 10 ** Math.floor(Math.log10(size));
  return ten * (size / ten >= 5 ? 5 : size / ten >= 2 ? 2 : 1);
}

/** Draw a line through points [x, y]; null lifts the pen. */
export function line(c, points, colour, width, dash = []) {
  let down = false;
  c.beginPath();
  for (const one of points) {
    if (one && down) c.lineTo(...one);
    else if (one) c.moveTo(...one);
    down = Boolean(one);
  }
  c.strokeStyle = colour;
  c.lineWidth = width;
  c.lineJoin = "round";
  c.setLineDash(dash);
  c.stroke();
  c.setLineDash([]);
}

/** Draw a disc, with an edge where a colour of it is given. */
export function dot(c, x, y, r, fill, edge = null) {
  c.beginPath();
  c.arc(x, y, r, 0, 7);
  if (fill) { c.fillStyle = fill; c.fill(); }
  if (edge) { c.strokeStyle = edge; c.lineWidth = 2; c.stroke(); }
}

/** Fill a polygon. */
export function area(c, points, colour) {
  c.beginPath();
  for (const one of points) c.lineTo(...one);
  c.fillStyle = colour;
  c.fill();
}

/** Draw a way whose last piece ends in a head. */
export function arrow(c, way, colour, width, head) {
  const [[x0, y0], [x, y]] = way.slice(-2), far = Math.hypot(x - x0, y - y0) || 1, ux = (x - x0) / far, uy = (y - y0) / far;
  line(c, [...way.slice(0, -1), [x - 0.75 * head * ux, y - 0.75 * head * uy]], colour, width);
  area(c, [[x, y], [x - head * ux - 0.5 * head * uy, y - head * uy + 0.5 * head * ux], [x - head * ux + 0.5 * head * uy, y - head * uy - 0.5 * head * ux]], colour);
}

/** Write a text with a halo, so that it reads on any line. */
export function label(c, text, x, y, colour, align = "center", weight = 600) {
  c.font = `${weight} ${0.8 * colours.rem}px ${colours.font}`;
  c.textAlign = align;
  c.textBaseline = "middle";
  c.lineWidth = 4;
  c.lineJoin = "round";
  c.strokeStyle = colours.card;
  c.strokeText(text, x, y);
  c.fillStyle = colour;
  c.fillText(text, x, y);
}
