// The list of runs.

import { clamp } from "./canvas.js";
import { el, form, head, press, put, row, show, write } from "./dom.js";
import { duration, language, t, wordFor } from "./strings.js";

const PAGE = 25, MOST = 6; // runs of a page, and side by side

export class Runs {
  static key = "runs";

  constructor(page) {
    Object.assign(this, { page, ...form("runs"), first: 0, chosen: new Set() });
    const turn = (way) => () => { this.first += way * PAGE; this.runs(); };
    this.filter.placeholder = this.filter.ariaLabel = t("runs.filter");
    this.filter.oninput = () => { this.first = 0; this.runs(); };
    press(this, { compare: () => this.comparing(), back: turn(-1), next: turn(1) });
    this.list = [...this.node.children];
    this.runs();
  }

  opened() { this.runs(); }

  #choose() {
    const n = this.chosen.size;
    write(this.count, n ? t("runs.chosen", { n }) : t("runs.how"));
    this.compare.disabled = n < 2;
  }

  comparing() {
    const { leave, compared } = form("compared", this.node);
    leave.onclick = () => this.node.replaceChildren(...this.list);
    leave.focus();
    this.page.ask("compare", { runs: [...this.chosen] }, ({ names, sections, reasons, no }) => {
      if (no) { write(compared.firstElementChild, no); return; }
      compared.replaceChildren(el("table.compared", head(...names), sections.map(({ title, rows }) => el("tbody",
        title ? el("tr", el("th", { scope: "rowgroup", colSpan: names.length + 1 }, title)) : null,
        ...rows.map(({ label, unit, cells, best }) => row([label, " ", el("small", unit)], cells, best))))), ...reasons.map((one) => el("p.none", one)));
    });
  }

  runs() {
    const { page, chosen } = this, { runs } = page, filterText = this.filter.value.trim().toLowerCase(), openId = page.opened?.about.run.id;
    const listed = runs.filter((one) => `${one.name} ${one.kind ?? ""}`.toLowerCase().includes(filterText)), n = listed.length;
    write(this.none, t(runs.length ? "runs.no-match" : "runs.none"));
    show(this.none, !n);
    this.first = clamp(this.first, 0, Math.max(n - 1, 0));
    this.first -= this.first % PAGE;
    const last = Math.min(this.first + PAGE, n);
    for (const id of chosen) if (!runs.some((one) => one.id === id)) chosen.delete(id);
    write(this.pages, t("runs.page", { from: n && this.first + 1, to: last, n }));
    this.back.disabled = !this.first;
    this.next.disabled = last === n;
    for (const one of [this.pages, this.back, this.next]) show(one, n > PAGE);
    this.#choose();
    this.body.replaceChildren(...listed.slice(this.first, last).map((one) => this.#row(one, openId)));
  }

  #row({ id, name, kind, when, seconds, laps, report }, openId) {
    const { page, chosen } = this, row = form("run"), { box, beside } = row, isOpen = id === openId, path = encodeURIComponent(id);
    put(row, { name, kind: kind ? wordFor("kind", kind) : "–", when: whenOf(when), long: Number.isFinite(seconds) ? duration(seconds) : "–", laps: laps ?? "–" });
    if (kind) row.kind.className = "chip plain";
    if (isOpen) row.node.ariaCurrent = "true";
    box.ariaLabel = t("runs.choose", { name });
    box.checked = chosen.has(id);
    box.onchange = () => {
      if (box.checked && chosen.size < MOST) chosen.add(id); else chosen.delete(id);
      box.checked = chosen.has(id);
      this.#choose();
    };
    press(row, { open: () => page.openRun(id), beside: () => page.openRun(openId, id) });
    show(beside, openId && !isOpen);
    row.report.href = `/report/${path}`;
    show(row.report, report !== false);
    row.file.href = `/run/${path}`;
    return row.node;
  }
}

function whenOf(stamp) {
  const when = new Date(stamp ?? NaN);
  return isNaN(when) ? stamp ?? "–" : when.toLocaleString(language, { dateStyle: "medium", timeStyle: "short" });
}
