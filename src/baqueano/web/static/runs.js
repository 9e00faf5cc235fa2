// The list of runs: open one, put another beside it, read its report, take it home.

import { el, region, show, write } from "./dom.js";
import { duration, language, t } from "./strings.js";

const PAGE = 25, MOST = 6; // runs of a page, and side by side

export class Runs {
  static key = "runs";

  constructor(page) {
    this.page = page;
    this.body = el("tbody");
    this.empty = el("p.none");
    this.filter = el("input", { type: "search", placeholder: t("runs.filter"), "aria-label": t("runs.filter") });
    this.filter.addEventListener("input", () => { this.first = 0; this.fill(); });
    this.first = 0;
    this.chosen = new Set();
    this.compare = el("button.action.primary", { onclick: () => this.comparing() }, t("runs.compare"));
    this.count = el("span");
    const step = (sign, key, way) => el("button.action", { "aria-label": t(key), onclick: () => { this.first += way * PAGE; this.fill(); } }, sign);
    this.pages = el("span");
    this.back = step("‹", "runs.before", -1);
    this.next = step("›", "runs.after", 1);
    this.foot = el("footer", this.count, this.compare, this.pages, this.back, this.next);
    const head = ["name", "kind", "when", "long", "laps", "do"].map((key) => el(`th.of-${key}`, { scope: "col" }, t(`runs.${key}`)));
    this.node = el("section.card.runs", el("header", el("h2", t("tab.runs")), this.filter),
      region("div.scroll", t("tab.runs"), el("table", el("thead", el("tr", ...head)), this.body), this.empty), this.foot);
    this.list = [...this.node.children];
    this.fill();
  }

  opened() { this.fill(); }
  runs() { this.fill(); }

  #box({ id, name }) {
    const box = el("input", { type: "checkbox", "aria-label": t("runs.choose", { name }) });
    box.checked = this.chosen.has(id);
    box.addEventListener("change", () => { if (box.checked && this.chosen.size < MOST) this.chosen.add(id); else this.chosen.delete(id); box.checked = this.chosen.has(id); this.#choose(); });
    return box;
  }

  #choose() {
    write(this.count, this.chosen.size ? t("runs.chosen", { n: this.chosen.size }) : t("runs.how"));
    this.compare.disabled = this.chosen.size < 2;
  }

  /** Show the table of `compare` for the chosen runs; the smaller error is bold. */
  comparing() {
    const back = el("button.action", { onclick: () => this.node.replaceChildren(...this.list) }, t("runs.back"));
    const body = region("div.scroll", t("runs.compare"), el("p.none", t("runs.comparing")));
    this.node.replaceChildren(el("header", el("h2", t("runs.compare")), back), body);
    back.focus();
    this.page.link.ask("compare", { runs: [...this.chosen] }, ({ names, sections, reasons, no }) => {
      if (no) { body.firstChild.textContent = no; return; }
      const row = ({ label, unit, cells, best }) => el("tr", el("th", { scope: "row" }, label, " ", el("small", unit)), ...cells.map((cell, k) => el("td", { class: k === best ? "better" : null }, cell)));
      body.replaceChildren(el("table.compared", el("thead", el("tr", el("td"), ...names.map((name) => el("th", { scope: "col" }, name)))),
        ...sections.map(({ title, rows }) => el("tbody", title ? el("tr", el("th", { scope: "rowgroup", colspan: names.length + 1 }, title)) : null, ...rows.map(row)))), ...reasons.map((one) => el("p.none", one)));
    });
  }

  fill() {
    const { page } = this, wanted = this.filter.value.trim().toLowerCase();
    const listed = page.runs.filter((one) => `${one.name} ${one.kind ?? ""}`.toLowerCase().includes(wanted));
    this.empty.textContent = page.runs.length ? t("runs.no-match") : t("runs.none");
    show(this.empty, listed.length === 0);
    const openId = page.opened?.about.run.id;
    this.first = Math.max(0, Math.min(this.first, listed.length - 1));
    this.first -= this.first % PAGE;
    const last = Math.min(this.first + PAGE, listed.length);
    for (const id of this.chosen) if (!page.runs.some((one) => one.id === id)) this.chosen.delete(id);
    write(this.pages, t("runs.page", { from: listed.length && this.first + 1, to: last, n: listed.length }));
    this.back.disabled = this.first === 0;
    this.next.disabled = last === listed.length;
    for (const one of [this.pages, this.back, this.next]) show(one, listed.length > PAGE);
    this.#choose();
    this.body.replaceChildren(...listed.slice(this.first, last).map((one) => {
      const isOpen = one.id === openId, path = encodeURIComponent(one.id);
      return el("tr", { "aria-current": isOpen ? "true" : null },
        el("th.of-name", { scope: "row" }, el("label", this.#box(one), one.name)), el("td.of-kind", one.kind ? el("span.chip.plain", kindOf(one.kind)) : "–"), el("td.of-when", whenOf(one.when)),
        el("td.of-long", Number.isFinite(one.seconds) && one.seconds !== null ? duration(one.seconds) : "–"), el("td.of-laps", one.laps ?? "–"),
        el("td.of-do", el("div.do",
          el("button.primary", { onclick: () => page.openRun(one.id, null) }, t("runs.open")),
          openId && !isOpen ? el("button", { onclick: () => page.openRun(openId, one.id) }, t("runs.beside")) : null,
          one.report === false ? null : el("a", { href: `/report/${path}`, target: "_blank", rel: "noopener" }, t("runs.report")),
          el("a", { href: `/run/${path}`, download: true }, t("runs.download")))));
    }));
  }
}

/** Return a date of the list as people of this language write it. */
function whenOf(stamp) {
  const when = new Date(stamp ?? NaN);
  return Number.isNaN(when.getTime()) ? (stamp ?? "–") : when.toLocaleString(language, { dateStyle: "medium", timeStyle: "short" });
}

/** Return the word for a kind of run; a kind that the page does not know keeps its own name. */
function kindOf(kind) {
  const key = `kind.${kind}`, word = t(key);
  return word === key ? kind : word;
}
