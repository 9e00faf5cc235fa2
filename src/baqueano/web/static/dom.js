// Elements and their texts. What comes from outside is only ever put in as text.

export const $ = (id) => document.getElementById(id);

/** Make an element: `el("button", {class: "x", onclick: f}, "text", child)`. */
export function el(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else if (value === true) made.setAttribute(name, "");
    else if (value !== false && value !== null && value !== undefined) made.setAttribute(name, value);
  }
  for (const child of children) if (child !== null && child !== undefined) made.append(child);
  return made;
}

/** Write a text if it differs: a browser lays out again only what changed. */
export function write(node, text) {
  const plain = String(text ?? "");
  if (node.textContent !== plain) node.textContent = plain;
}

export function show(node, visible) {
  if (node.hidden === visible) node.hidden = !visible;
}

/** A line drawing of 20 × 20, in the colour of the text. */
export function icon(path) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", "svg"), line = document.createElementNS(made.namespaceURI, "path");
  for (const [name, value] of [["viewBox", "0 0 20 20"], ["width", "18"], ["height", "18"], ["aria-hidden", "true"], ["class", "icon"]]) made.setAttribute(name, value);
  line.setAttribute("d", path);
  made.append(line);
  return made;
}

export const calm = () => matchMedia("(prefers-reduced-motion: reduce)").matches;

/** A row of choices of which one is pressed; `labels` are texts, `onpick` gets the index. */
export function choices(name, labels, picked, onpick) {
  const buttons = labels.map((label, k) =>
    el("button", { type: "button", "aria-pressed": String(k === picked), onclick: () => pick(k) }, label));
  const pick = (k) => {
    buttons.forEach((one, j) => one.setAttribute("aria-pressed", String(j === k)));
    onpick(k);
  };
  return el("div", { class: "choices", role: "group", "aria-label": name }, ...buttons);
}
