// A scene of the demo: how the cost of a lap fell, and the gains before and after.

import { begin, colours, follow } from "./canvas.js";
import { calm, el } from "./dom.js";
import { t, three } from "./strings.js";

const FALLS_MS = 4000;

export class Tuned {
  static key = "tuned";

  constructor({ history, before, cost, gains }) {
    Object.assign(this, { history, before, cost });
    this.curve = follow(el("canvas", { role: "img", "aria-label": t("tuned.cost") }));
    const head = ["gain", "before", "after"].map((key) => el("th", { scope: "col" }, t(`tuned.${key}`)));
    const number = (key, value) => el("div", { class: `number ${key}` }, el("span", { class: "of" }, t(`tuned.${key}`)), el("span", { class: "much" }, el("b", {}, three(value)), el("span", {}, "m²")));
    this.node = el("div", { class: "tuned" },
      el("section", { class: "card" }, el("h2", {}, t("tuned.cost")), this.curve),
      el("section", { class: "card" }, number("before", before), number("after", cost),
        el("table", { class: "compare" }, el("thead", {}, el("tr", {}, ...head)), el("tbody", {}, ...gains.map((one) => el("tr", {}, el("th", { scope: "row" }, `${one.name} `, el("small", {}, one.unit)), el("td", {}, three(one.before)), el("td", { class: "better" }, three(one.value))))))));
  }

  get told() { return [t("tuned.title"), t("tuned.text", { n: this.history.length, before: three(this.before), after: three(this.cost) })]; }

  draw(now_ms) {
    this.from ??= now_ms;
    const begun = begin(this.curve), { history, before } = this;
    if (!begun) return;
    const [c, w, h] = begun, part = calm() ? 1 : Math.min((now_ms - this.from) / FALLS_MS, 1), shown = Math.max(Math.round(part * history.length), 1);
    const known = [...history, before].filter((x) => x > 0), low = Math.log(Math.min(...known)), high = Math.log(Math.max(...known));
    const X = (k) => 10 + (k / Math.max(history.length - 1, 1)) * (w - 20), Y = (x) => 14 + ((high - Math.log(x)) / (high - low || 1)) * (h - 34);
    c.setLineDash([5, 4]);
    c.strokeStyle = colours.ghost;
    if (before > 0) { c.beginPath(); c.moveTo(0, Y(before)); c.lineTo(w, Y(before)); c.stroke(); }
    c.setLineDash([]);
    c.beginPath();
    for (let k = 0; k < shown; k++) { if (k) c.lineTo(X(k), Y(history[k - 1])); c.lineTo(X(k), Y(history[k])); }
    c.strokeStyle = colours.model;
    c.lineWidth = 2.4;
    c.stroke();
    c.beginPath();
    c.arc(X(shown - 1), Y(history[shown - 1]), 5, 0, 7);
    c.fillStyle = colours.model;
    c.fill();
  }
}
