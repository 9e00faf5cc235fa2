// Draws a picture once, and returns what it draws on a canvas: lines and areas with their colour and their points [px].
(canvas, draw) => {
  const c = canvas.context, style = getComputedStyle(document.documentElement), probe = document.createElement("canvas").getContext("2d"), names = {}, marks = [];
  for (const name of ["ink", "muted", "card", "line", "grid", "model", "measured", "route", "ghost", "alarm", "sim", "band", "corridor"]) {
    probe.fillStyle = style.getPropertyValue(`--${name}`).trim();
    names[probe.fillStyle] = name;
  }
  let path = [];
  const add = (kind) => (x, y, ...more) => { const p = c.getTransform().transformPoint({ x, y }); path.push([kind, p.x / canvas.scale, p.y / canvas.scale, ...more]); };
  const mark = (kind, colour, more) => marks.push({ kind, colour: names[colour] ?? String(colour), alpha: c.globalAlpha, path, ...more });
  const spied = {
    beginPath() { path = []; },
    moveTo: add("move"), lineTo: add("line"), arc: add("arc"), ellipse: add("ellipse"),
    roundRect(x, y, w, h) { add("box")(x + w / 2, y + h / 2, w, h); },
    stroke() { mark("line", c.strokeStyle, { width: Math.round(100 * c.lineWidth) / 100, dash: c.getLineDash() }); },
    fill() { mark("area", c.fillStyle); },
  };
  for (const [name, spy] of Object.entries(spied)) c[name] = (...all) => { spy(...all); CanvasRenderingContext2D.prototype[name].apply(c, all); };
  try { draw(); } finally { for (const name of Object.keys(spied)) delete c[name]; }
  return marks;
}
