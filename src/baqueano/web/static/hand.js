// Driving by hand: touch pad, keys, game pad; and the beats that keep the vehicle ours.
// A beat comes from the drawing loop alone and names the last frame drawn: a hidden tab or a frozen picture falls silent.

import { el } from "./dom.js";
import { t } from "./strings.js";

const EVERY_MS = 45; // 20 beats a second out of 60 pictures
const WAYS = { KeyW: [1, 0], ArrowUp: [1, 0], KeyS: [-1, 0], ArrowDown: [-1, 0], KeyA: [0, 1], ArrowLeft: [0, 1], KeyD: [0, -1], ArrowRight: [0, -1] };
const DEAD = 0.1; // of a game pad's stick
const PAD_STOP = 1; // its button B, or circle

export class Hand {
  constructor(page) {
    this.page = page;
    this.mine = false;
    this.part = 0.5; // of the command at full stick
    this.keys = new Set();
    this.stick = null; // [ahead, left] while the pad is held
    this.n = 0;
    this.sent_ms = 0;
    this.#makePad();
    addEventListener("blur", () => { if (this.keys.size) this.letGo(); });
    addEventListener("pagehide", () => this.letGo());
    document.addEventListener("visibilitychange", () => { if (document.hidden) this.letGo(); });
    addEventListener("gamepaddisconnected", () => { if (this.fromPad) this.letGo(); });
  }

  take() { this.page.link.send({ is: "take" }); }

  /** Stand still at once, and give the vehicle away. */
  letGo() {
    this.still();
    if (!this.mine) return;
    this.beat(performance.now(), true);
    this.page.link.send({ is: "give" });
  }

  still() {
    this.keys.clear();
    this.stick = null;
    this.fromPad = false;
    this.#knob();
  }

  toggle() { if (this.mine) this.letGo(); else this.take(); }

  lease({ you }) {
    this.mine = you;
    if (!you) this.still();
    this.pad.classList.toggle("live", you);
  }

  /** Return whether the key was one of ours. */
  key(event, down) {
    if (!(event.code in WAYS) || event.ctrlKey || event.metaKey || event.altKey) return false;
    if (down !== this.keys.has(event.code)) this.sent_ms = 0; // the next picture has its beat
    if (down && this.mine) this.keys.add(event.code); else this.keys.delete(event.code);
    this.#knob();
    return this.mine;
  }

  /** Return (ahead, to the left), each in [-1, 1]. */
  get wanted() {
    if (this.stick) return this.stick;
    if (this.keys.size) {
      const sum = [0, 1].map((k) => [...this.keys].reduce((all, key) => all + WAYS[key][k], 0));
      return sum.map((one) => Math.min(Math.max(one, -1), 1));
    }
    return this.#gamePad() ?? [0, 0];
  }

  #gamePad() {
    this.fromPad = false;
    for (const one of navigator.getGamepads?.() ?? []) {
      if (!one?.connected) continue;
      const stop = one.buttons[PAD_STOP]?.pressed ?? false;
      if (stop && !this.padStopped) this.page.stop();
      this.padStopped = stop;
      const beyond = (x = 0) => (Math.abs(x) < DEAD ? 0 : (x - Math.sign(x) * DEAD) / (1 - DEAD));
      const way = [-beyond(one.axes[1]), -beyond(one.axes.length > 2 && Math.abs(one.axes[2]) > DEAD ? one.axes[2] : one.axes[0])];
      if (way[0] || way[1]) { this.fromPad = true; return way; }
    }
    return null;
  }

  /** Return the command: the first that lives drives ahead, the last one turns to the left. */
  get command() {
    const { command } = this.page.hello.vehicle, live = command.flatMap(({ low, high }, k) => (low < high ? [k] : []));
    const u = command.map(() => 0), [ahead, left] = this.wanted;
    const set = (k, share) => { const v = share * this.part; u[k] = v >= 0 ? v * command[k].high : -v * command[k].low; };
    if (live.length) set(live[0], ahead);
    if (live.length > 1) set(live[live.length - 1], left);
    return u;
  }

  /** Called once a picture, after it was drawn. */
  beat(now_ms, still = false) {
    if (!this.mine || (!still && now_ms - this.sent_ms < EVERY_MS)) return;
    this.sent_ms = now_ms;
    const u = this.command;
    this.page.link.send({ is: "beat", n: ++this.n, seen: this.page.link.seen, u: still ? u.map(() => 0) : u });
    this.#knob();
  }

  #makePad() {
    this.knob = el("span", { class: "knob" });
    this.pad = el("div", { class: "pad", tabindex: "0", role: "application", "aria-label": t("pad.label") }, this.knob);
    const { pad } = this;
    const move = (e) => {
      const box = pad.getBoundingClientRect(), r = box.width / 2;
      const x = (e.clientX - box.left - r) / (r * 0.72), y = (e.clientY - box.top - r) / (r * 0.72), far = Math.max(1, Math.hypot(x, y));
      this.stick = [-y / far, -x / far];
      this.#knob();
    };
    let held = false;
    pad.addEventListener("pointerdown", (e) => {
      if (!this.mine) { this.page.say(t("pad.take")); return; }
      pad.setPointerCapture(e.pointerId);
      held = true;
      move(e);
    });
    pad.addEventListener("pointermove", (e) => { if (held) move(e); });
    pad.addEventListener("pointerup", () => { held = false; this.stick = null; this.#knob(); });
    pad.addEventListener("lostpointercapture", () => { if (held) { held = false; this.letGo(); } });
  }

  #knob() {
    const [ahead, left] = this.wanted;
    this.knob.style.transform = `translate(${(-left * 72).toFixed(0)}%, ${(-ahead * 72).toFixed(0)}%)`;
  }
}

/** A button that acts after a hold of 0.6 s where a real vehicle would move, at once elsewhere. */
export function moving(button, page, act) {
  let timer = 0;
  const real = () => ["real", "emulated"].includes(page.hello.vehicle.world);
  const drop = () => { clearTimeout(timer); timer = 0; button.classList.remove("held"); };
  button.press = () => {
    if (button.disabled) return;
    if (!real()) { act(); return; }
    if (timer) return;
    button.classList.add("held");
    timer = setTimeout(() => { drop(); act(); }, 600);
  };
  button.drop = () => { if (timer) { drop(); page.say(t("hold.longer")); } };
  button.addEventListener("pointerdown", () => { if (real()) button.press(); });
  for (const name of ["pointerup", "pointerleave", "pointercancel", "blur"]) button.addEventListener(name, button.drop);
  button.addEventListener("click", () => { if (!real()) button.press(); });
  button.addEventListener("keydown", (e) => { if (e.code === "Enter" && real()) { e.preventDefault(); if (!e.repeat) button.press(); } });
  button.addEventListener("keyup", (e) => { if (e.code === "Enter") button.drop(); });
  return button;
}
