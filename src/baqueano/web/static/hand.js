// Driving by hand: touch pad, keys, game pad; and the beats that keep the vehicle ours.
// A beat comes from the drawing loop alone and names the last frame drawn: a hidden tab or a frozen picture falls silent.

import { alone, el } from "./dom.js";
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
    this.pad = stick(t("pad.label"), 72, () => { if (!this.mine) page.say(t("pad.take")); return this.mine; },
      (right, ahead) => { this.stick = [ahead, -right]; this.#knob(); }, () => { this.stick = null; this.#knob(); }, () => this.letGo());
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
    if (!(event.code in WAYS) || !alone(event)) return false;
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

  get #pads() { return [...navigator.getGamepads?.() ?? []].filter((one) => one?.connected); }

  #gamePad() {
    const beyond = (x = 0) => (Math.abs(x) < DEAD ? 0 : (x - Math.sign(x) * DEAD) / (1 - DEAD));
    const ways = this.#pads.map(({ axes }) => [-beyond(axes[1]), -(beyond(axes[2]) || beyond(axes[0]))]), way = ways.find(([ahead, left]) => ahead || left) ?? null;
    this.fromPad = Boolean(way);
    return way;
  }

  /** Stop by a pad's button: as STOP on the page, whoever drives. */
  #padStop() {
    const pressed = this.#pads.some(({ buttons }) => buttons[PAD_STOP]?.pressed);
    if (pressed && !this.padStopped) this.page.stop();
    this.padStopped = pressed;
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
    this.#padStop();
    if (!this.mine || (!still && now_ms - this.sent_ms < EVERY_MS)) return;
    this.sent_ms = now_ms;
    const u = this.command;
    this.page.link.send({ is: "beat", n: ++this.n, seen: this.page.link.seen, u: still ? u.map(() => 0) : u });
    this.#knob();
  }

  #knob() {
    const [ahead, left] = this.wanted;
    this.pad.put(-left, ahead);
  }
}

/** A round pad with a knob: `move` gets how far the finger is to the right and up, within a circle of 1. */
export function stick(label, travel, may, move, drop, lost = drop) {
  const knob = el("span.knob"), pad = el("div.pad", { tabindex: "0", role: "application", "aria-label": label }, knob);
  let held = false;
  const at = (e) => {
    const box = pad.getBoundingClientRect(), r = box.width / 2, x = (e.clientX - box.left - r) / (0.72 * r), y = (box.top + r - e.clientY) / (0.72 * r), far = Math.max(1, Math.hypot(x, y));
    move(x / far, y / far);
  };
  const over = (act) => () => { if (held) { held = false; act(); } };
  pad.addEventListener("pointerdown", (e) => { if (may()) { pad.setPointerCapture(e.pointerId); held = true; at(e); } });
  pad.addEventListener("pointermove", (e) => { if (held) at(e); });
  pad.addEventListener("pointerup", over(drop));
  pad.addEventListener("lostpointercapture", over(lost));
  pad.put = (x, y) => { knob.style.transform = `translate(${(travel * x).toFixed(0)}%, ${(-travel * y).toFixed(0)}%)`; };
  return pad;
}

/** A button with the key that does the same; with a page, one that moves its vehicle. */
export function action(name, code, act, page = null) {
  const made = el("button.action", el("span", t(name)), el("kbd", code.slice(3)));
  made.code = code;
  if (page) return moving(made, page, act);
  made.press = () => { if (!made.disabled) act(); };
  made.addEventListener("click", made.press);
  return made;
}

/** Press the button that has this key, and return whether there is one. */
export function pressed(actions, event, down) {
  const button = actions.find((one) => one.code === event.code && !one.hidden);
  if (!button || !alone(event)) return false;
  if (!down) button.drop?.();
  else if (!event.repeat) button.press();
  return true;
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
