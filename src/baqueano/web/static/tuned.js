// A scene of the demo: the decrease of the cost of a lap, and the gains before and after.

import { axis, begin, dot, line } from "./canvas.js";
import { calm, el, form, row, write } from "./dom.js";
import { t, three } from "./strings.js";

const FALLS_MS = 4000;

export class Tuned {
  static key = "tuned";

  constructor({ history, start_cost: start, cost, gains }) {
    Object.assign(this, { history, start, ...form("tuned") });
    const [was, is] = [start, cost].map(three);
    write(this.was, was);
    write(this.is, is);
    this.body.append(...gains.map((one) => row([`${one.name} `, el("small", one.unit)], [three(one.file_value), three(one.value)], 1)));
    this.summary = [t("tuned.title"), t("tuned.text", { n: history.length, before: was, after: is })];
  }

  draw(now_ms) {
    this.from ??= now_ms;
    const [c, w, h] = begin(this.curve), { history, start } = this, n = history.length;
    if (!c) return;
    const shown = calm() ? n : Math.max(Math.min(Math.round(((now_ms - this.from) / FALLS_MS) * n), n), 1);
    const logs = [...history, start].filter((x) => x > 0).map(Math.log), low = Math.min(...logs), high = Math.max(...logs);
    const X = axis(0, Math.max(n - 1, 1), 10, w - 10), level = axis(high, high > low ? low : high - 1, 14, h - 20), Y = (x) => level(Math.log(x));
    if (start > 0) line(c, [[0, Y(start)], [w, Y(start)]], "ghost", 1.4, [5, 4]);
    line(c, history.slice(0, shown).flatMap((x, k) => [[X(k), Y(history[Math.max(k - 1, 0)])], [X(k), Y(x)]]), "model", 2.4);
    dot(c, X(shown - 1), Y(history[shown - 1]), 5, "model");
  }
}
