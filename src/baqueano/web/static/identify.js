// What the drive has taught about its vehicle: errors that shrink, the path by what it taught, what to drive next.

import { area, begin, colours, follow, label, line, ramp } from "./canvas.js";
import { el, icon, key, number, show, write } from "./dom.js";
import { poseOf } from "./drive.js";
import { moving } from "./hand.js";
import { Map2D } from "./map.js";
import { Trail } from "./record.js";
import { clock, num, t } from "./strings.js";

const LEAST = 1e-4, POOR = 0.1; // of the value: where the scale begins, and from where on an error is poor
const QUIET = 0.1, LOUD = 100; // bits/s, the ends of the colours
const AGO_S = 2.5, EXPERIMENT_S = 60;
const SHADES = 12;

export class Identify {
  static key = "identify";

  constructor(page) {
    this.page = page;
    this.rows = [];
    this.map = new Map2D();
    this.bits = el("b", "0");
    this.learned = el("div.numbers", number(t("identify.learned"), this.bits, el("span", t("identify.bits"))));
    this.list = el("ol.knowns", { tabindex: "0", "aria-label": t("identify.known") });
    this.verdict = el("span.chip");
    this.about = el("p.about");
    this.now = el("b");
    this.curve = follow(el("canvas.curve", { "aria-hidden": "true" })); // the keys of Replay scrub it as well
    this.play = el("button.primary.play", { "aria-label": t("replay.play"), onclick: () => this.replay.toggle() });
    if (this.recorded) for (const name of ["pointerdown", "pointermove"]) this.curve.addEventListener(name, (e) => { if (e.buttons) this.#seek(e); });
    this.next = el("p", el("strong", t("identify.next")), " ", el("span"), " ", el("span.gain"));
    this.go = el("button.action.primary", t("identify.experiment", { s: EXPERIMENT_S }));
    moving(this.go, page, () => page.link.send({ is: "mission", kind: "experiment", seconds: EXPERIMENT_S }));
    const ends = [0.01, 0.1, 1, 10, 100].map((one) => el("span", `${num(one, one < 0.1 ? 2 : one < 1 ? 1 : 0)} %`));
    this.node = el("div.identify",
      el("section.card.known-card",
        el("header", el("h2", t("identify.known")), this.verdict, this.about),
        this.list, el("div.scale", { "aria-hidden": "true" }, el("div", ...ends)),
        el("div.legend", ...["expected", "filled", "own", "ago"].map((kind) => key(kind, t(`identify.${kind}`))))),
      this.map.card([el("span", t("identify.path")), el("span.key.ramp", num(QUIET, 1), el("i", { "aria-hidden": "true" }), `${LOUD} ${t("identify.rate")}`)], this.learned),
      el("section.card.curve-card", this.recorded ? this.play : null, el("figure", el("figcaption", el("b", t("identify.curve")), " ", el("span.unit", t("identify.rate")), this.now), this.curve)),
      el("section.card.next-card", icon("M4 9a6 6 0 1 1 1.8 5.2M4 4v5h5"), this.next, this.go));
    this.#clear();
  }

  get recorded() { return this.page.hello.mode === "replay"; }
  get replay() { return this.page.screens.replay; }

  shown() {
    const { page } = this;
    if (!this.recorded) page.link.send({ is: "identify", on: true });
    else if (page.opened && this.asked !== page.opened) {
      this.#clear();
      const of = this.asked = page.opened;
      write(this.about, t("identify.computing"));
      page.link.ask("identify", { run: of.about.run.id }, (word) => { if (of === page.opened) this.take(word); });
    }
  }

  hidden() { if (!this.recorded) this.page.link.send({ is: "identify", on: false }); }
  opened() { if (this.page.screen === this) this.shown(); }
  state() { this.go.disabled = !(this.page.hand?.mine && this.page.state.state === "READY"); }

  /** Take what came: of the drive, or of the run at all its times. */
  take(word) {
    if (!word.parameters.length) { write(this.about, word.why); return; }
    this.word = word;
    if (this.rows.length !== word.parameters.length || this.first !== word.parameters[0].path) this.#make(word);
    this.shownAt = null;
    if (!this.recorded) this.#fill(word, word.now, word.before, word.fit, word.bits);
  }

  #clear() {
    this.word = this.trail = null;
    this.rows = [];
    this.list.replaceChildren();
    write(this.bits, "0");
    write(this.about, t(this.recorded ? "replay.none-how" : "identify.nothing"));
    show(this.verdict, false);
    write(this.next.children[1], "–");
    show(this.go, !this.recorded && this.page.hello.role === "drive");
  }

  #make({ parameters }) {
    this.first = parameters[0].path;
    this.order = null;
    this.rows = parameters.map((one) => {
      const rail = ["past", "bar", "own"].map((kind) => el(`i.${kind}`));
      const value = el("b"), error = el("span"), needs = el("p.needs");
      const node = el("li", el("div.who", el("b", one.label), el("span", one.path.replace("drivetrain.", ""))), el("div.rail", ...rail), el("div.much", value, error, el("small", one.unit)), needs);
      return { node, rail, value, error, needs };
    });
    this.list.replaceChildren(...this.rows.map((one) => one.node));
  }

  /** Show errors expected now and a while ago, and a fit. */
  #fill(word, now, before, fit, bits) {
    const trusted = fit && fit.verdict_is !== "REFUSED";
    word.parameters.forEach((one, k) => {
      const { node, rail, value, error, needs } = this.rows[k], own = trusted ? fit.sd[k] : null, x = trusted ? fit.value[k] : null;
      const [past, bar, mark] = rail, seen = x !== null, sd = own ?? now[k];
      past.style.width = `${share(before[k])}%`;
      bar.style.width = `${share(now[k])}%`;
      mark.style.left = `${share(own ?? 1)}%`;
      show(mark, own !== null);
      node.dataset.kind = `${seen ? "filled" : "hollow"} ${sd > POOR ? "poor" : "good"}`;
      write(value, precise(seen ? x : one.guess, seen ? sd : 0.1));
      write(error, trusted && !seen ? t("identify.not-seen") : `± ${percent(sd)}`);
      show(needs, Boolean(one.needs) && sd > POOR);
      write(needs, one.needs);
    });
    write(this.bits, num(bits, 0));
    show(this.verdict, Boolean(fit));
    if (fit) { write(this.verdict, fit.verdict); this.verdict.dataset.verdict = fit.verdict_is; }
    write(this.about, fit ? [t("identify.fit", { s: num(fit.t, 1), took: num(fit.took_s, 1) }), fit.why].filter(Boolean).join(" ") : word.why ?? t(word.compiled ? "identify.hollow" : "identify.slow", { s: word.first }));
    if (fit?.t !== this.order) {
      this.order = fit?.t;
      const rank = now.map((sd, k) => [fit?.sd[k] ?? sd, k]).sort((a, b) => b[0] - a[0]);
      this.list.replaceChildren(...rank.map(([, k]) => this.rows[k].node));
    }
    const { next } = word, [, text, gain] = this.next.children;
    write(text, next ? `${next.motion}.` : "–");
    write(gain, next ? `${next.label}: ± ${percent(next.from)} → ± ${percent(next.to)}` : "");
  }

  /** Show a recorded run as it was known at a time. */
  #at(seconds) {
    const { word } = this, { expected, step_s } = word, last = expected.length - 1;
    const at = (s) => expected[Math.min(Math.max(Math.round((s - word.start) / step_s) - 1, 0), last)] ?? word.now;
    const key = `${Math.floor(seconds / step_s)}`;
    if (key === this.shownAt) return;
    this.shownAt = key;
    const now = seconds < step_s ? word.now.map(() => 1) : at(seconds), fit = word.fits.filter((one) => one.t <= seconds + 0.05).pop() ?? null;
    this.#fill(word, now, at(Math.max(seconds - AGO_S, step_s)), fit, -now.reduce((sum, sd) => sum + Math.log2(sd), 0));
  }

  key(event, down) { return this.map.key(event, down) || (this.recorded && this.replay.key(event, down)); }

  #seek({ offsetX }) {
    const { start, end } = this.page.opened.record;
    this.replay.seek(start + (offsetX / this.curve.clientWidth) * (end - start));
  }

  draw(now_ms) {
    const { page, word } = this, of = this.recorded ? page.opened : page;
    if (!of?.record.length) return;
    const { record } = of, { footprint } = this.recorded ? of.about.vehicle : page.hello.vehicle;
    if (this.recorded) {
      this.replay.advance(now_ms);
      write(this.play, this.replay.playing ? "❚❚" : "▶");
      if (word) this.#at(this.replay.now_s - record.start);
    } else this.state();
    const i = this.recorded ? record.row(this.replay.now_s) : record.last;
    if (this.trail?.record !== record) this.trail = new Trail(record, "eta.x", "eta.y", footprint.width_m / 18);
    const shades = ramp(SHADES);
    const paint = (row) => {
      const rate = this.#rate(record.t[row]);
      return rate === undefined ? colours.route : shades[Math.round(Math.min(Math.max(Math.log(rate / QUIET) / Math.log(LOUD / QUIET), 0), 1) * (SHADES - 1))];
    };
    this.map.draw({ route: null, trails: [{ trail: this.trail, style: "estimate", row: i, paint }], vehicles: [{ pose: poseOf(record, i), footprint, style: "now" }], reference: null });
    this.#draw(record, this.recorded ? this.replay.now_s : null);
  }

  #rate(s) { const { word } = this; return word?.rate[Math.floor((s - word.start) / word.dt)]; }

  #draw(record, cursor) {
    const { word } = this, begun = begin(this.curve);
    if (!begun) return;
    const [c, w, h] = begun, most = Math.log10(1 + 3 * LOUD), Y = (rate) => h - 2 - (Math.min(Math.log10(1 + rate) / most, 1)) * (h - 6);
    const scale = [1, 10, 100];
    line(c, scale.flatMap((rate) => [[0, Math.round(Y(rate)) + 0.5], [w, Math.round(Y(rate)) + 0.5], null]), colours.grid, 1);
    const named = () => { for (const rate of scale) label(c, `${rate}`, w, Y(rate) - 0.6 * colours.rem, colours.muted, "right", 400); };
    if (!word?.rate.length) { named(); return; }
    const from = word.start, end = this.recorded ? record.end : from + word.rate.length * word.dt, X = (s) => ((s - from) / (end - from)) * w;
    const curve = word.rate.flatMap((rate, k) => [[X(from + k * word.dt), Y(rate)], [X(from + (k + 1) * word.dt), Y(rate)]]);
    area(c, [[0, h], ...curve, [curve.at(-1)[0], h]], colours.band);
    line(c, curve, colours.model, 1.6);
    named();
    write(this.now, cursor === null ? num(word.rate.at(-1), 1) : `${clock(cursor)} s · ${num(this.#rate(cursor), 1)}`);
    if (cursor === null) return;
    line(c, [[X(cursor), 0], [X(cursor), h]], colours.ink, 2);
  }
}

/** Return where an error stands on the scale [%]. */
const share = (sd) => Math.min(Math.max(100 * (1 - Math.log10(sd) / Math.log10(LEAST)), 1), 100);

/** Return a number with the figures that its error leaves. */
const precise = (x, sd) => (x === 0 ? "0" : num(x, Math.min(Math.max((sd > POOR) - Math.floor(Math.log10(Math.abs(x) * Math.min(sd, 1))), 0), 7)));

const percent = (sd) => (sd >= 1 ? `${num(100, 0)} %` : `${num(100 * sd, sd < 0.01 ? 2 : sd < 0.1 ? 1 : 0)} %`);
