// The list of runs: open one, put another beside it, read its report, take it home.

import { el, show } from "./dom.js";
import { duration, language, t } from "./strings.js";

export class Runs {
  static key = "runs";

  constructor(page) {
    this.page = page;
    this.body = el("tbody", {});
    this.empty = el("p", { class: "none" });
    this.filter = el("input", { type: "search", placeholder: t("runs.filter"), "aria-label": t("runs.filter") });
    this.filter.addEventListener("input", () => this.fill());
    const head = ["name", "kind", "when", "long", "laps", "do"].map((key) => el("th", { scope: "col", class: `of-${key}` }, t(`runs.${key}`)));
    this.node = el("section", { class: "card runs" }, el("header", {}, el("h2", {}, t("tab.runs")), this.filter),
      el("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": t("tab.runs") }, el("table", {}, el("thead", {}, el("tr", {}, ...head)), this.body), this.empty));
    this.fill();
  }

  opened() { this.fill(); }
  runs() { this.fill(); }

  fill() {
    const { page } = this, wanted = this.filter.value.trim().toLowerCase();
    const listed = page.runs.filter((one) => `${one.name} ${one.kind ?? ""}`.toLowerCase().includes(wanted));
    this.empty.textContent = page.runs.length ? t("runs.no-match") : t("runs.none");
    show(this.empty, listed.length === 0);
    const openId = page.opened?.about.run.id;
    this.body.replaceChildren(...listed.map((one) => {
      const isOpen = one.id === openId, path = encodeURIComponent(one.id);
      return el("tr", { "aria-current": isOpen ? "true" : null },
        el("th", { scope: "row", class: "of-name" }, one.name), el("td", { class: "of-kind" }, one.kind ? el("span", { class: "chip plain" }, kindOf(one.kind)) : "–"), el("td", { class: "of-when" }, whenOf(one.when)),
        el("td", { class: "of-long" }, Number.isFinite(one.seconds) && one.seconds !== null ? duration(one.seconds) : "–"), el("td", { class: "of-laps" }, one.laps ?? "–"),
        el("td", { class: "of-do" }, el("div", { class: "do" },
          el("button", { type: "button", class: "primary", onclick: () => page.openRun(one.id, null) }, t("runs.open")),
          openId && !isOpen ? el("button", { type: "button", onclick: () => page.openRun(openId, one.id) }, t("runs.beside")) : null,
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
