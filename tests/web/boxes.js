// Returns what a person would see as wrong on the page: cut or overlapping texts, things beyond the edge, faint texts.
(() => {
  const wrong = [], name = (node) => `${node.tagName.toLowerCase()}${node.id ? `#${node.id}` : ""}.${node.className?.baseVal ?? node.className} “${(node.textContent || "").trim().slice(0, 40)}”`;
  const shown = (node) => node.checkVisibility({ opacityProperty: true, visibilityProperty: true }), covers = (box) => box.width > 0 && box.height > 0;
  const visible = (node) => shown(node) && covers(node.getBoundingClientRect());
  const scroller = (node) => {
    for (let one = node.parentElement; one; one = one.parentElement) {
      const style = getComputedStyle(one);
      if (/auto|scroll/.test(style.overflowY + style.overflowX) && (one.scrollHeight > one.clientHeight + 1 || one.scrollWidth > one.clientWidth + 1)) return one;
    }
    return null;
  };
  const root = document.querySelector("dialog[open]") ?? document.body; // what lies under a dialog is out of reach
  const leaves = [...root.querySelectorAll("*")].filter((node) => shown(node) && !node.closest("svg, dialog:not([open]), option, select") &&
    [...node.childNodes].some((child) => child.nodeType === 3 && child.data.trim()));
  const texts = leaves.map((node) => {
    const range = document.createRange();
    range.selectNodeContents(node);
    return { node, box: range.getBoundingClientRect(), lines: [...range.getClientRects()] };
  }).filter(({ box }) => covers(box)); // a text can leave an element of no width
  const SIDEWAYS = ".scroll, .content, pre"; // can be scrolled sideways, too
  // cut: the text is wider or higher than the nearest box that clips it
  for (const { node, box } of texts) {
    for (let one = node; one && one !== document.documentElement; one = one.parentElement) {
      const style = getComputedStyle(one);
      if (style.overflowX === "visible" && style.overflowY === "visible") continue;
      const home = one.getBoundingClientRect(), scrolls = /auto|scroll/.test(style.overflowX + style.overflowY);
      if (!scrolls && (box.right > home.right + 1 || box.left < home.left - 1 || box.bottom > home.bottom + 2 || box.top < home.top - 2)) wrong.push(`cut: ${name(node)} in ${name(one).slice(0, 40)}`);
      if (scrolls && !one.matches(SIDEWAYS) && box.right > home.right + 1) wrong.push(`cut: ${name(node)} in ${name(one).slice(0, 40)}`);
      if (scrolls) break;
    }
    if (!scroller(node) && (box.right > innerWidth + 1 || box.left < -1 || box.bottom > innerHeight + 1)) wrong.push(`beyond the edge: ${name(node)}`);
    if (node.closest("button, .chip, kbd")) {
      const holder = node.closest("button, .chip, kbd").getBoundingClientRect();
      if (box.left < holder.left - 1 || box.right > holder.right + 1) wrong.push(`wider than its box: ${name(node)}`);
    }
  }
  if (document.documentElement.scrollWidth > innerWidth + 1) wrong.push("the page scrolls sideways");
  // overlapping: two texts, or a text and a button that is not its own
  const solid = [...texts, ...[...root.querySelectorAll("button, select, input, .pad")].filter(visible).map((node) => ({ node, lines: [node.getBoundingClientRect()] }))];
  const over = (p, q) => Math.min(p.right, q.right) - Math.max(p.left, q.left) > 2 && Math.min(p.bottom, q.bottom) - Math.max(p.top, q.top) > 3;
  for (const one of solid) Object.assign(one, { whole: one.box ?? one.lines[0], scroller: scroller(one.node), sticky: one.node.closest(".transport"), above: one.node.closest("#stop") });
  for (const [i, a] of solid.entries()) for (const b of solid.slice(i + 1)) {
    if (!over(a.whole, b.whole) || a.above || b.above || a.scroller !== b.scroller || (a.scroller && a.sticky !== b.sticky)) continue;
    if (a.node.contains(b.node) || b.node.contains(a.node)) continue;
    if (a.lines.some((p) => b.lines.some((q) => over(p, q)))) wrong.push(`overlap: ${name(a.node)} and ${name(b.node)}`);
  }
  // faint: contrast of a text against what lies behind it
  const canvas = document.createElement("canvas").getContext("2d", { willReadFrequently: true });
  const read = new Map();
  const rgba = (colour) => { if (!read.has(colour)) read.set(colour, pixel(colour)); return read.get(colour); };
  const pixel = (colour) => { canvas.clearRect(0, 0, 1, 1); canvas.fillStyle = "#000"; canvas.fillStyle = colour; canvas.fillRect(0, 0, 1, 1); return [...canvas.getImageData(0, 0, 1, 1).data]; };
  const upon = (top, below) => [0, 1, 2].map((k) => (top[k] * top[3] + below[k] * (255 - top[3])) / 255).concat(255);
  const behind = (node) => {
    const layers = [];
    for (let one = node; one; one = one.parentElement) { const colour = rgba(getComputedStyle(one).backgroundColor); layers.push(colour); if (colour[3] === 255) break; }
    return layers.reverse().reduce((below, top) => upon(top, below), [255, 255, 255, 255]);
  };
  const light = (c) => [0.2126, 0.7152, 0.0722].reduce((sum, part, k) => { const x = c[k] / 255; return sum + part * (x <= 0.04045 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4); }, 0);
  for (const { node } of texts) {
    if (node.closest(":disabled")) continue;
    const back = behind(node), front = upon(rgba(getComputedStyle(node).color), back), [a, b] = [light(front), light(back)];
    const ratio = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
    if (ratio < 4.5) wrong.push(`faint, ${ratio.toFixed(2)}: ${name(node)}`);
  }
  // names: each element that can be pressed has a name
  for (const node of document.querySelectorAll("button, a, select, input, [tabindex='0']")) {
    const label = node.getAttribute("aria-label") || node.textContent.trim() || node.labels?.[0]?.textContent;
    if (visible(node) && !label) wrong.push(`nameless: ${name(node)}`);
  }
  return [...new Set(wrong)];
})()
