// Elements and their texts. What comes from outside is only ever put in as text.

export const $ = (id) => document.getElementById(id);

/** Make an element: `el("button.primary.play", { onclick: f }, "text", child)`; the attributes may be left out. */
export function el(what, ...rest) {
  const [tag, ...classes] = what.split(".").filter(Boolean), made = document.createElement(tag), attributes = rest[0]?.constructor === Object ? rest.shift() : {};
  if (tag === "button") made.type = "button";
  if (classes.length) made.classList.add(...classes);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else if (value === true) made.setAttribute(name, "");
    else if (value !== false && value !== null && value !== undefined) made.setAttribute(name, value);
  }
  for (const child of rest) if (child !== null && child !== undefined) made.append(child);
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
    el("button", { "aria-pressed": String(k === picked), onclick: () => pick(k) }, label));
  const pick = (k) => {
    buttons.forEach((one, j) => one.setAttribute("aria-pressed", String(j === k)));
    onpick(k);
  };
  return el("div.choices", { role: "group", "aria-label": name }, ...buttons);
}

/** A list to choose from: `options` are values or [value, text]; `onpick` gets the value. */
export function select(label, options, picked, onpick) {
  const made = fill(el("select", { "aria-label": label }), options, picked);
  made.addEventListener("change", () => onpick?.(made.value));
  return made;
}

export function fill(list, options, picked) {
  list.replaceChildren(...options.map((one) => { const [value, text] = [one].flat(); return el("option", { value, selected: value === picked }, text ?? value); }));
  return list;
}

/** An entry of a legend, as `key("estimate", "estimate")`. */
export const key = (kind, text) => el(`span.key.${kind}`, el("i", { "aria-hidden": "true" }), text);

/** A large number under its name: `number("speed", value, unit)`, both of them elements. */
export const number = (of, ...much) => el("div.number", el("span.of", of), el("span.much", ...much));

/** A part of a screen that a keyboard can scroll. */
export const region = (what, label, ...children) => el(what, { tabindex: "0", role: "region", "aria-label": label }, ...children);

/** What stands in place of a screen that has nothing to show. */
export const empty = (title, ...more) => el("section.card.empty", el("h2", title), ...more);

/** Whether a key was pressed without Ctrl, Alt or Meta. */
export const alone = (event) => !(event.ctrlKey || event.metaKey || event.altKey);
