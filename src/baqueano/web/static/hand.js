// Manual driving: touch pad, keys, game pad; and the beats that retain the control.
// Only the drawing loop sends a beat, with the last drawn frame. A hidden or frozen tab does not send a beat.

import { clamp } from "./canvas.js";
import { alone, drag, el, write } from "./dom.js";
import { movable } from "./record.js";
import { t } from "./strings.js";

const EVERY_MS = 45; // 20 beats a second out of 60 pictures
const DEAD = 0.1; // of a game pad's stick
const PAD_STOP = 1; // the button B, or circle
const KEYS = { KeyW: [0, 1], KeyS: [0, -1], KeyA: [-1, 0], KeyD: [1, 0] }, { KeyW, KeyS, KeyA, KeyD } = KEYS;
export const WAYS = { ...KEYS, ArrowUp: KeyW, ArrowDown: KeyS, ArrowLeft: KeyA, ArrowRight: KeyD };

export class Hand {
  constructor(page) {
    Object.assign(this, { page, mine: false, n: 0, sent_ms: 0, keys: new Set() });
    this.part = 0.5; // of the command at full stick
    this.padWay = null; // [right, up] while a finger is on the pad
    const put = (way) => { this.padWay = way; this.#knob(); };
    this.pad = stick(72, (...way) => put(way), (lost) => { if (lost) this.letGo(); else put(null); }, () => { if (!this.mine) page.say(t("pad.take")); return this.mine; });
    addEventListener("blur", () => { if (this.keys.size) this.letGo(); });
    addEventListener("pagehide", () => this.letGo());
    document.addEventListener("visibilitychange", () => { if (document.hidden) this.letGo(); });
    addEventListener("gamepaddisconnected", () => { if (this.fromPad) this.letGo(); });
  }

  /** Stop at once, and release the control, or give it to another visitor. */
  letGo(to) {
    this.still();
    if (!this.mine) return;
    this.beat(performance.now(), true);
    this.page.send({ type: "give", to });
  }

  still() {
    this.keys.clear();
    this.padWay = null;
    this.fromPad = false;
    this.#knob();
  }

  toggle() { if (this.mine) this.letGo(); else this.page.send({ type: "take" }); }

  lease({ you }) {
    this.mine = you;
    if (!you) this.still();
    this.pad.classList.toggle("live", you);
  }

  key(event, down) {
    const { code } = event;
    if (!(code in WAYS) || !alone(event)) return false;
    if (down !== this.keys.has(code)) this.sent_ms = 0; // send a beat with the next picture
    if (down && this.mine) this.keys.add(code); else this.keys.delete(code);
    this.#knob();
    return this.mine;
  }

  /** Return [right, ahead], each in [-1, 1]. */
  get way() {
    if (this.padWay) return this.padWay;
    if (this.keys.size) return [0, 1].map((k) => clamp([...this.keys].reduce((sum, key) => sum + WAYS[key][k], 0), -1, 1));
    return this.#gamePad() ?? [0, 0];
  }

  get #pads() { return [...navigator.getGamepads?.() ?? []].filter((one) => one?.connected); }

  /** Return [right, ahead, lateral]: with two commands both sticks turn, with three the left one moves sideways. */
  #gamePad() {
    const beyond = (x = 0) => (Math.abs(x) < DEAD ? 0 : (x - Math.sign(x) * DEAD) / (1 - DEAD)), three = movable(this.page.hello.vehicle)[2];
    return (this.fromPad = this.#pads.map(({ axes: [x, y, turn] }) => [beyond(turn) || (three ? 0 : beyond(x)), -beyond(y), beyond(x)]).find((way) => way.some(Boolean)));
  }

  /** Stop as the button STOP does, also without the control. */
  #padStop() {
    const pressed = this.#pads.some(({ buttons }) => buttons[PAD_STOP]?.pressed);
    if (pressed && !this.padStopped) this.page.stop();
    this.padStopped = pressed;
  }

  /** Return the command: its first movable component is ahead, the middle one left, the last one a left turn. */
  get command() {
    const { vehicle } = this.page.hello, [right, ahead, lateral] = this.way, [first, ...more] = movable(vehicle), share = { [first]: ahead, [more[0]]: -lateral, [more.at(-1)]: -right };
    return vehicle.command.map(({ low, high }, k) => { const part = this.part * (share[k] || 0); return part >= 0 ? part * high : -part * low; });
  }

  beat(now_ms, still = false) {
    this.#padStop();
    if (!this.mine || (!still && now_ms - this.sent_ms < EVERY_MS)) return;
    this.sent_ms = now_ms;
    const u = this.command;
    this.page.send({ type: "beat", n: ++this.n, frame: this.page.link.frame, u: still ? u.map(() => 0) : u });
    this.#knob();
  }

  #knob() { this.pad.put(...this.way); }
}

/** Make a round pad: `move` gets the position of the finger to the right and up, within a circle of 1. */
export function stick(travel, move, over, may) {
  const knob = el("span.knob"), pad = el("div.pad", { tabIndex: 0, role: "application" }, knob);
  drag(pad, (e) => {
    const r = pad.clientWidth / 2, x = (e.offsetX - r) / (0.72 * r), y = (r - e.offsetY) / (0.72 * r), far = Math.max(1, Math.hypot(x, y));
    move(x / far, y / far);
  }, over, may);
  pad.put = (x, y) => { knob.style.transform = `translate(${(travel * x).toFixed(0)}%, ${(-travel * y).toFixed(0)}%)`; };
  return pad;
}

/** Make a button with a key. `free`: it can be pressed; `on`: it acts; with `page` it moves the vehicle. */
export function action(name, code, act, free, on = null, page = null) {
  const made = Object.assign(el("button.action", el("span", t(name)), el("kbd", code.slice(3))), { code, free, on });
  if (page) return moving(made, page, act);
  made.onclick = made.press = () => { if (!made.disabled) act(); };
  return made;
}

export function pauseButton(page) {
  return action("drive.pause", "KeyP", () => page.send({ type: page.state.paused ? "go" : "pause" }), () => page.moves && page.state.paused !== null, () => Boolean(page.state.paused));
}

export function enable(actions, { hand, state }) {
  for (const one of actions) {
    const free = one.free(), on = one.on?.() ?? null;
    one.disabled = !(hand.mine && free);
    one.ariaPressed = on;
    one.classList.toggle("off", !free && !on);
    if (one.code === "KeyP") write(one.firstChild, t(state.paused ? "drive.go" : "drive.pause"));
  }
}

export function pressed(actions, event, down) {
  const button = actions.find((one) => one.code === event.code && !one.hidden);
  if (!button || !alone(event)) return false;
  if (!down) button.drop?.();
  else if (!event.repeat) button.press();
  return true;
}

/** Let a button act after 0.6 s if a real vehicle would move, and else at once. */
export function moving(button, page, act) {
  let timer = 0;
  const real = () => ["real", "emulated"].includes(page.hello.vehicle.world);
  const end = () => { clearTimeout(timer); timer = 0; button.classList.remove("hold"); };
  const drop = () => { if (timer) { end(); page.say(t("hold.longer")); } };
  const press = () => {
    if (button.disabled || timer) return;
    if (!real()) { act(); return; }
    button.classList.add("hold");
    timer = setTimeout(() => { end(); act(); }, 600);
  };
  return Object.assign(button, {
    press, drop, onpointerup: drop, onpointerleave: drop, onpointercancel: drop, onblur: drop,
    onpointerdown() { if (real()) press(); },
    onclick() { if (!real()) press(); },
    onkeydown(e) { if (e.code === "Enter" && real()) { e.preventDefault(); if (!e.repeat) press(); } },
    onkeyup(e) { if (e.code === "Enter") drop(); },
  });
}
