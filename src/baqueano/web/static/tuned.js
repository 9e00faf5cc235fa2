// A scene of the demo: how the cost of a lap fell, and the gains before and after.

import { begin, colours, dot, follow, line } from "./canvas.js";
import { calm, el, number } from "./dom.js";
import { t, three } from "./strings.js";

const FALLS_MS = 4000;

export class Tuned {
  static key = "tuned";

  constructor({ history, before, cost, gains }) {
    Object.assign(this, { history, before, cost });
    this.curve = follow(el("canvas", { role: "img", "aria-label": t("tuned.cost") }));
    const head = ["gain", "before", "after"].map((key) => el("th", { scope: "col" }, t(`tuned.${key}`)));
    const much = (name, value) => { const one = number(t(`tuned.${name}`), el("b", three(value)), el("span", "m²")); one.classList.add(name); return one; };
    this.node = el("div.tuned",
      el("section.card", el("h2", t("tuned.cost")), this.curve),
      el("section.card", much("before", before), much("after", cost),
        el("table.compare", el("thead", el("tr", ...head)), el("tbody", ...gains.map((one) => el("tr", el("th", { scope: "row" }, `${one.name} `, el("small", one.unit)), el("td", three(one.before)), el("td.better", three(one.value))))))));
  }

  get told() { return [t("tuned.title"), t("tuned.text", { n: this.history.length, before: three(this.before), after: three(this.cost) })]; }

  draw(now_ms) {
    this.from ??= now_ms;
    const begun = begin(this.curve), { history, before } = this;
    if (!begun) return;
    const [c, w, h] = begun, part = calm() ? 1 : Math.min((now_ms - this.from) / FALLS_MS, 1), shown = Math.max(Math.round(part * history.length), 1);
    const known = [...history, before].filter((x) => x > 0), low = Math.log(Math.min(...known)), high = Math.log(Math.max(...known));
    const X = (k) => 10 + (k / Math.max(history.length - 1, 1)) * (w - 20), Y = (x) => 14 + ((high - Math.log(x)) / (high - low || 1)) * (h - 34);
    if (before > 0) line(c, [[0, Y(before)], [w, Y(before)]], colours.ghost, 1.4, [5, 4]);
    line(c, history.slice(0, shown).flatMap((x, k) => (k ? [[X(k), Y(history[k - 1])], [X(k), Y(x)]] : [[X(k), Y(x)]])), colours.model, 2.4);
    dot(c, X(shown - 1), Y(history[shown - 1]), 5, colours.model);
  }
}
