// Elements and their texts. Data from outside are only inserted as text.

import { follow } from "./canvas.js";
import { t } from "./strings.js";

/** Make an element: `el("button.primary.play", { onclick: f }, "text", child)`; null adds nothing. */
export function el(what, ...rest) {
  const [tag, ...classes] = what.split("."), made = document.createElement(tag);
  made.classList.add(...classes);
  if (rest[0]?.constructor === Object) Object.assign(made, rest.shift());
  made.append(...rest.flat().filter((child) => child !== null));
  return made;
}

/** Write a text if it differs, to avoid a new layout. A list of texts is written into the children. */
export function write(node, text) {
  if (Array.isArray(text)) { text.forEach((one, k) => write(node.children[k], one)); return; }
  const plain = String(text ?? "");
  if (node.textContent !== plain) node.textContent = plain;
}

export function put(parts, texts) { for (const [name, text] of Object.entries(texts)) write(parts[name], text); }

/** Set the actions of buttons, by the names of the parts. */
export function press(parts, acts) { for (const [name, act] of Object.entries(acts)) parts[name].onclick = act; }

export function show(node, visible) { node.hidden = !visible; }

/** Write the texts of the elements in a node; return the elements that have a name. */
export function texts(root) {
  const parts = {};
  for (const one of root.querySelectorAll("*")) {
    const { t: text, label, title, as } = one.dataset;
    if (text) write(one, t(text));
    if (label) one.ariaLabel = t(label);
    if (title) [one.title, one.ariaLabel] = [t(title), `${one.textContent} ${t(title)}`.trim()];
    if (as) parts[as] = one;
  }
  return parts;
}

/** Copy a form of index.html, into `node` if it is given; return the node and its named parts. */
export function form(id, node = null) {
  const copy = document.getElementById(`form-${id}`).content.cloneNode(true), parts = texts(copy);
  copy.querySelectorAll("canvas").forEach(follow);
  parts.node = node ?? copy.firstElementChild;
  node?.replaceChildren(copy);
  return parts;
}

export const calm = () => matchMedia("(prefers-reduced-motion: reduce)").matches;

/** Let a person press one of a row of choices; `onpick` gets its index. */
export function choices(group, picked, onpick) {
  const all = [...group.children], press = (k) => all.forEach((one, j) => { one.ariaPressed = j === k; });
  all.forEach((one, k) => { one.onclick = () => { press(k); onpick(k); }; });
  press(picked);
}

/** Fill a list: `options` are values or [value, text]; `onpick` gets the value. */
export function fill(list, options, picked, onpick) {
  list.replaceChildren(...options.map((one) => { const [value, text = value] = [one].flat(); return el("option", { value, selected: value === picked }, text); }));
  if (onpick) list.onchange = () => onpick(list.value);
}

export function slide(input, part, text) {
  input.style.setProperty("--part", `${100 * part}%`);
  input.ariaValueText = text;
}

export const row = (head, cells, better = -1) =>
  el("tr", el("th", { scope: "row" }, head), cells.map((one, k) => el(k === better ? "td.better" : "td", one)));

export const head = (...names) => el("thead", el("tr", el("td"), names.map((one) => el("th", { scope: "col" }, one))));

export const empty = (title, ...more) => el("section.card.empty", el("h2", title), ...more);

export function drag(node, at, over = () => {}, may = () => true) {
  let on = false;
  const end = (lost) => () => { if (on) { on = false; over(lost); } };
  Object.assign(node, {
    onpointerdown(e) { if (may()) { node.setPointerCapture(e.pointerId); on = true; at(e); } },
    onpointermove(e) { if (on) at(e); },
    onpointerup: end(false), onlostpointercapture: end(true),
  });
}

export const alone = (event) => !(event.ctrlKey || event.metaKey || event.altKey);

/** Execute the entry of a table for a key; return the entry, if it exists. */
export function keyed(table, event, down) {
  const act = alone(event) && (table[event.code] ?? table[event.key]);
  if (act && down) act();
  return act;
}
