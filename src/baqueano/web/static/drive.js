// The screen that shows and drives the vehicle.

import { area, axis, begin, clamp, line } from "./canvas.js";
import { choices, fill, form, press, put, show, slide, write } from "./dom.js";
import { action, enable, pauseButton, pressed } from "./hand.js";
import { Map2D } from "./map.js";
import { nisMean, trailsOf } from "./record.js";
import { signals, stripList } from "./strips.js";
import { length, num, t } from "./strings.js";

const { abs, max, min } = Math;
const SPANS = [10, 20, 60]; // s
const PACES = [0.25, 0.5, 1, 2, 4, 8]; // stops of a slider

export class Drive {
  static key = "drive";

  constructor(page) {
    const { record, hello: { vehicle, routes }, hand } = page;
    Object.assign(this, { page, ...form("drive"), laps: 3 });
    this.map = new Map2D(this.mapCard);
    show(this.truthKey, record.has("truth.x"));
    this.drawn = { record, about: page.hello, ...trailsOf(record, vehicle) };
    this.nis = nisCard(record);
    this.console.prepend(hand.pad);
    this.console.append(this.nis.node);
    this.strips = stripList(this.list, record, signals(record, vehicle));
    const span = (k) => { this.span = SPANS[k]; write(this.since, `−${SPANS[k]} s`); };
    choices(this.spans, 1, span);
    span(1);
    this.#controls();
    this.routes(routes);
  }

  #controls() {
    const { page } = this, { hand } = page, [paceText, paces] = this.pace.children, [shareText, share] = this.share.children;
    const now = (name, code) => action(`drive.${name}`, code, () => page.send({ type: name }), () => page.moves);
    const mission = (name, code, kind, more = () => null, may = () => true) => action(`drive.${name}`, code, () => page.send({ type: "mission", kind, ...more() }), () => page.state.state === "READY" && may(), () => page.state.mission?.kind === kind, page);
    this.repeat = mission("repeat", "KeyR", "repeat", () => ({ route: this.route.value, laps: this.laps }), () => this.names.length);
    this.repeat.classList.add("repeat");
    this.pause = pauseButton(page);
    this.closed = action("drive.closed", "KeyC", () => { page.send({ type: "write", lap: page.runs[0].id, route: this.name }); this.name = ""; this.runs(); }, () => true);
    this.actions = [mission("teach", "KeyT", "teach", () => ({ name: this.name = this.#freeName() })), this.repeat, mission("manual", "KeyB", "drive"), this.pause, now("mark", "KeyM"), now("end", "KeyE"), this.closed];
    this.bar.prepend(...this.actions);
    const laps = (more) => { this.laps = clamp(this.laps + more, 1, 99); write(this.count, t(this.laps === 1 ? "drive.one-lap" : "drive.laps", { n: this.laps })); };
    press(this, { fewer: () => laps(-1), more: () => laps(1) });
    laps(0);
    share.value = 100 * hand.part;
    share.oninput = () => {
      const text = t("drive.stick", { part: share.value });
      hand.part = share.value / 100;
      write(shareText, text);
      slide(share, (share.value - 10) / 90, text);
    };
    share.oninput();
    this.paced = (factor) => {
      const k = max(PACES.findLastIndex((one) => one <= factor), 0), text = t("drive.pace-is", { n: { 0.125: "⅛", 0.25: "¼", 0.5: "½" }[factor] ?? num(factor, factor % 1 ? 1 : 0) });
      if (document.activeElement !== paces) paces.value = k;
      slide(paces, k / (PACES.length - 1), text);
      write(paceText, text);
    };
    paces.oninput = () => { const factor = PACES[paces.value]; this.paced(factor); page.send({ type: "pace", factor }); };
  }

  #freeName() {
    for (let k = 1; ; k++) if (!this.names.includes(`route-${k}`)) return `route-${k}`;
  }

  routes(names) {
    this.names = names;
    fill(this.route, names, this.route.value, () => this.buttons());
    show(this.missions, names.length);
    this.buttons();
  }

  /** Let a lap that was just taught end at its start. */
  runs() { show(this.closed, this.name && this.page.runs[0]?.kind === "teach"); }

  buttons() {
    const { page } = this, { state: { state, mission, pace, lap, laps }, drives } = page, paced = Number.isFinite(pace), plan = drives && state === "READY" && this.route.value;
    if (plan !== this.plan) {
      this.plan = plan;
      if (plan) page.ask("route", { route: plan }, (route) => { if (plan === this.plan) page.route = route.x && route; });
    }
    show(page.hand.pad, drives);
    show(this.controls, drives);
    enable(this.actions, page);
    write(this.repeat.firstChild, t("drive.repeat") + (mission?.kind === "repeat" && laps ? ` · ${lap ?? 1}/${laps}` : ""));
    if (mission || !this.name) show(this.closed);
    show(this.pace, paced);
    if (paced) this.paced(pace);
  }

  key(event, down) { return this.page.hand.key(event, down) || pressed(this.actions, event, down) || this.map.key(event, down); }

  draw() {
    const { record, route } = this.page, i = record.last, to = record.end;
    show(this.limitKey, route?.room);
    drawMap(this, route, this.drawn, i);
    for (const one of this.strips) one.draw(to - this.span, to, i);
    this.nis.draw(i);
  }
}

/** Draw the common parts of Drive and Replay; with a ghost, corridor and truth are omitted. */
export function drawMap(screen, route, { record, about: { vehicle }, estimate, path, truth }, i, row, ghost = null) {
  const [cross, u, v] = record.values(i, "cross", "nu.u", "nu.v"), [within, unit] = length(record.across(i)[0]);
  put(screen, { away: length(abs(cross)), within: [unit ? `± ${within}` : within, unit], speed: num(Math.hypot(u, v), 2) });
  const vehicles = [{ pose: record.pose(i), vehicle, std_psi: Math.sqrt(record.value("P.psi", i)) }], trails = [{ trail: ghost ? path : estimate, style: "estimate", row }];
  if (ghost) {
    trails.unshift({ trail: ghost.path, style: "ghost", row: ghost.row });
    vehicles.push({ pose: ghost.record.pose(ghost.row), vehicle: ghost.about.vehicle, style: "ghost" });
  } else if (record.has("truth.x")) {
    trails.push({ trail: truth, style: "truth", row });
    vehicles.push({ pose: record.pose(i, "truth"), vehicle, style: "true" });
  }
  const reference = record.values(i, "ref.x", "ref.y");
  screen.map.draw({ route, trails, vehicles, reference: reference.every(Number.isFinite) ? reference : null });
}

export function nisCard(record) {
  const parts = form("nis"), { node, canvas } = parts;
  const draw = (i, from = record.end - 60, to = record.end) => {
    const now = nisMean(record, i), kind = !now ? "unknown" : now.mean < now.low ? "below" : now.mean > now.high ? "above" : "inside";
    put(parts, { verdict: `NIS ${num(now?.mean, 2)}`, words: t(`nis.${kind}`) });
    if (node.dataset.kind !== kind) node.dataset.kind = kind;
    const [c, w, h] = begin(canvas), points = [], time = axis(0, w, from, to);
    if (!c) return;
    for (let x = 0; x <= w; x += 2) points.push([x, time(x) < record.start || time(x) > record.end ? null : nisMean(record, record.row(time(x)))?.mean ?? null]);
    const half = min(1.2 * max(0.25, ...points.map(([, mean]) => abs((mean ?? 1) - 1))), 1); // at most 0 to 2
    const Y = axis(1 - half, 1 + half, h - 2, 2), { low, high } = now ?? { low: 0.9, high: 1.1 }, top = Y(min(high, 2)), bottom = max(Y(max(low, 0)), top + 2);
    area(c, [[0, top], [w, top], [w, bottom], [0, bottom]], "band");
    line(c, points.map(([x, mean]) => mean !== null && [x, Y(clamp(mean, 0, 2))]), { above: "alarm", below: "sim" }[kind] ?? "model", 1.8);
  };
  return { node, draw };
}
