// The parameters that the drive has identified, and the most informative next motion.

import { area, axis, begin, clamp, colours, label, line, ramp, sharp } from "./canvas.js";
import { drag, el, form, put, show, write } from "./dom.js";
import { moving } from "./hand.js";
import { Map2D } from "./map.js";
import { trailsOf } from "./record.js";
import { duration, num, percent, t } from "./strings.js";

const { floor, log, log10, max, min, round } = Math;
const LEAST = 1e-4, POOR = 0.1; // of the value: the start of the scale, and a poor error
const QUIET = 0.1, LOUD = 100; // bits/s, the ends of the colours
const AGO_S = 2.5, EXPERIMENT_S = 60;
const SHADES = 12;

export class Identify {
  static key = "identify";

  constructor(page) {
    Object.assign(this, { page, ...form("identify") });
    this.map = new Map2D(this.mapCard);
    put(this, { quiet: num(QUIET), loud: `${LOUD} ${t("identify.rate")}`, go: t("identify.experiment", { s: EXPERIMENT_S }) });
    this.ends.append(...[0.01, 0.1, 1, 10, 100].map((one) => el("span", `${num(one, max(0, -log10(one)))} %`)));
    show(this.play, page.recorded);
    this.play.onclick = () => this.replay.toggle();
    if (page.recorded) drag(this.curve, ({ offsetX }) => this.replay.seekPart(offsetX / this.right));
    moving(this.go, page, () => page.send({ type: "mission", kind: "experiment", seconds: EXPERIMENT_S }));
    show(this.go, !page.recorded && page.drives);
    this.#clear();
  }

  get replay() { return this.page.screens.replay; }

  shown() {
    const { page } = this, { opened } = page;
    if (!page.recorded) page.send({ type: "identify", on: true });
    else if (opened && this.opened !== opened) {
      this.#clear();
      this.opened = opened;
      write(this.about, t("identify.computing"));
      page.ask("identify", {}, (word) => { if (opened === page.opened) this.identified(word); });
    }
  }

  hidden() { if (!this.page.recorded) this.page.send({ type: "identify", on: false }); }
  opened() { if (this.page.screen === this) this.shown(); }
  buttons() { this.go.disabled = !this.page.ready; }

  identified(word) {
    const { parameters } = word, of = parameters.map((one) => one.path).join();
    if (!parameters.length) { write(this.about, word.reason); return; }
    if (of !== this.of) {
      this.order = null;
      this.rows = parameters.map(({ label, path, unit }) => {
        const row = form("estimate");
        put(row, { label, path: path.replace("drivetrain.", ""), unit });
        return row;
      });
    }
    Object.assign(this, { word, of, shownAt: null });
    if (!this.page.recorded) this.#fill(word, word.std, word.former_std, word.fit, word.bits);
  }

  #clear() {
    this.word = this.trail = this.of = null;
    this.list.replaceChildren();
    put(this, { bits: "0", about: t(this.page.recorded ? "replay.none-how" : "identify.nothing"), next: "–", gain: "" });
    show(this.verdict, false);
    this.buttons();
  }

  #fill({ parameters, next, reason, compiled, first }, now, before, fit, bits) {
    const trusted = fit && fit.verdict_id !== "REFUSED";
    parameters.forEach((one, k) => {
      const row = this.rows[k], own = trusted ? fit.std[k] : null, x = trusted ? fit.value[k] : null, std = own ?? now[k];
      row.past.style.width = `${share(before[k])}%`;
      row.bar.style.width = `${share(now[k])}%`;
      row.own.style.left = `${share(own ?? 1)}%`;
      show(row.own, own !== null);
      row.node.dataset.kind = `${x === null ? "hollow" : "filled"} ${std > POOR ? "poor" : "good"}`;
      show(row.needs, one.needs && std > POOR);
      put(row, { value: x === null ? precise(one.guess, 0.1) : precise(x, std), error: trusted && x === null ? t("identify.unknown") : relative(std), needs: one.needs });
    });
    show(this.verdict, fit);
    this.verdict.dataset.verdict = fit?.verdict_id ?? "";
    put(this, {
      bits: num(bits, 0), verdict: fit?.verdict, next: next ? `${next.motion}.` : "–", gain: next ? `${next.label}: ${relative(next.from)} → ${relative(next.to)}` : "",
      about: fit ? [t("identify.fit", { s: num(fit.t), took: num(fit.took_s) }), fit.reason].filter(Boolean).join(" ") : reason ?? t(compiled ? "identify.hollow" : "identify.slow", { s: first }),
    });
    if (fit?.t !== this.order) {
      this.order = fit?.t;
      const error = (k) => fit?.std[k] ?? now[k];
      this.list.replaceChildren(...[...now.keys()].sort((a, b) => error(b) - error(a)).map((k) => this.rows[k].node));
    }
  }

  #at(seconds) {
    const { word } = this, { expected, step_s, start, fits } = word, step = floor(seconds / step_s);
    if (step === this.shownAt) return;
    this.shownAt = step;
    const at = (s) => expected[clamp(round((s - start) / step_s) - 1, 0, expected.length - 1)] ?? word.std;
    const now = seconds < step_s ? word.std.map(() => 1) : at(seconds);
    this.#fill(word, now, at(max(seconds - AGO_S, step_s)), fits.findLast((one) => one.t <= seconds + 0.05), -now.reduce((sum, std) => sum + Math.log2(std), 0));
  }

  key(event, down) { return this.map.key(event, down) || (this.page.recorded && this.replay.key(event, down)); }

  draw(now_ms) {
    const { page, replay, word } = this, { recorded, shown } = page;
    if (!shown?.record.length) return;
    const { record, about: { vehicle } } = shown;
    if (recorded) {
      replay.advance(now_ms);
      write(this.play, replay.sign);
      if (word) this.#at(replay.now_s - record.start);
    }
    const i = recorded ? record.row(replay.now_s) : record.last, shades = ramp([colours.quiet, colours.middle, colours.loud], SHADES).map((one) => `rgb(${one.join(" ")})`);
    if (this.trail?.record !== record) this.trail = trailsOf(record, vehicle).path;
    const paint = (row) => {
      const rate = this.#rate(record.t[row]);
      return rate === undefined ? "route" : shades[round(clamp(log(rate / QUIET) / log(LOUD / QUIET), 0, 1) * (SHADES - 1))];
    };
    this.map.draw({ trails: [{ trail: this.trail, style: "estimate", row: i, paint }], vehicles: [{ pose: record.pose(i), vehicle }] });
    this.#curve(record, recorded ? replay.now_s : null);
  }

  #rate(s) { const { word } = this; return word?.rate[floor((s - word.start) / word.dt)]; }

  #curve(record, cursor) {
    const [c, w, h] = begin(this.curve), { rate = [], start, dt } = this.word ?? {}, scale = [1, 10, 100];
    if (!c) return;
    const right = this.right = w - 2.2 * colours.rem, level = axis(0, log10(1 + 3 * LOUD), h - 2, 4), Y = (one) => max(level(log10(1 + one)), 4);
    line(c, scale.flatMap((one) => [[0, sharp(Y(one))], [right, sharp(Y(one))], null]), "grid");
    if (rate.length) {
      const X = axis(start, this.page.recorded ? record.end : start + rate.length * dt, 0, right), curve = rate.flatMap((one, k) => [[X(start + k * dt), Y(one)], [X(start + (k + 1) * dt), Y(one)]]);
      area(c, [[0, h], ...curve, [curve.at(-1)[0], h]], "band");
      line(c, curve, "model", 1.6);
      write(this.now, cursor === null ? num(rate.at(-1)) : `${duration(cursor)} · ${num(this.#rate(cursor))}`);
      if (cursor !== null) line(c, [[X(cursor), 0], [X(cursor), h]], "ink", 2);
    }
    for (const one of scale) label(c, `${one}`, w, Y(one), "muted", "right", 400);
  }
}

const share = (std) => clamp(100 * (1 - log10(std) / log10(LEAST)), 1, 100);

const precise = (x, std) => (x === 0 ? "0" : num(x, clamp((std > POOR) - floor(log10(Math.abs(x) * min(std, 1))), 0, 7)));

const relative = (std) => "±\u00a0" + percent(min(std, 1), std < 0.01 ? 2 : std < 0.1 ? 1 : 0);
