// The frame around the screens, the messages in both directions, the drawing loop.

import { readColours } from "./canvas.js";
import { Blocks } from "./blocks.js";
import { alone, el, fill, press, put, show, texts } from "./dom.js";
import { Drive } from "./drive.js";
import { Faults } from "./faults.js";
import { Hand } from "./hand.js";
import { Identify } from "./identify.js";
import { Link } from "./link.js";
import { Record, trailsOf } from "./record.js";
import { Replay } from "./replay.js";
import { Runs } from "./runs.js";
import { Tune } from "./tune.js";
import { Tuned } from "./tuned.js";
import { language, num, otherLanguage, speak, t } from "./strings.js";

const KEPT_S = 60;
const OLD_MS = 200; // age of the picture from which it is shown
const SCREENS = [Drive, Identify, Replay, Tune, Runs, Blocks, Faults];
const NO_VEHICLE = { name: "", footprint: {}, command: [], rate_hz: 100, world: "recorded" };

const page = {
  hello: null, state: {}, screens: {}, screen: null, hand: null, link: null,
  say, stop, open,
  send(word) { this.link.send(word); },
  ask(what, more, then) { this.link.ask(what, { ...(this.recorded && this.opened && { run: this.opened.about.run.id }), ...more }, then); },
  openRun(run, ghost, filter) {
    this.send({ type: "open", run, ghost, filter });
    open("replay");
  },
  get recorded() { return this.hello?.mode === "replay"; },
  get drives() { return this.hello.role === "drive"; },
  get moves() { return ["MISSION", "MANUAL"].includes(this.state.state); },
  get ready() { return this.hand?.mine && this.state.state === "READY"; },
  /** Return the record that the screens show: the live drive, or the open run. */
  get shown() { return this.recorded ? this.opened : { record: this.record, about: this.hello }; },
};
const pending = {};
const ui = Object.fromEntries([...document.querySelectorAll("body [id]")].map((one) => [one.id, one]));

function tell(what, word) { for (const one of Object.values(page.screens)) one[what]?.(word); }

const on = {
  hello(word) {
    word.vehicle ??= NO_VEHICLE;
    Object.assign(page, { hello: word, state: word.state ?? {}, route: word.route, runs: word.runs, opened: null, ghost: null, ledger: [] });
    page.record = new Record(word.fields, KEPT_S * word.vehicle.rate_hz, true);
    page.hand ??= new Hand(page);
    page.hand.lease({ you: false });
    page.hand.pad.ariaLabel = t("pad.label");
    frame();
    if (word.open) page.send({ type: "open", ...word.open });
  },
  rows(stream, values, count) { (stream ? pending[stream] : page)?.record.add(values, count); },
  down() {
    show(ui.stop, true);
    sentence("error", t("link.lost"), t("link.again"));
    this.lease({ you: false });
  },
  over() {
    page.hand?.lease({ you: false });
    stoppable(false);
    show(ui.lease, false);
  },
  state(word) {
    page.state = word;
    tell("buttons");
    follow(word.scene);
    announce();
  },
  ledger({ rows }) { page.ledger = rows; tell("ledger", rows); },
  route(word) { page.route = word.x?.length ? word : null; },
  routes({ routes }) { tell("routes", routes.map((one) => one.name)); },
  blocks({ blocks, gains, swapped }) {
    Object.assign(page.hello, { blocks, swapped });
    page.hello.vehicle.gains = gains;
    tell("blocks");
  },
  runs({ runs }) { page.runs = runs; tell("runs"); },
  identify(word) { tell("identified", word); },
  lease(word) { page.hand?.lease(word); lease(word); tell("buttons"); },
  event({ severity, text }) { if (["warning", "error"].includes(severity)) say(text); },
  refused({ reason }) {
    if (page.hello && page.link.up) say(reason);
    else sentence("error", t("link.refused"), reason);
  },
  answer({ stream, done, ...word }) {
    if (!done) {
      pending[stream] = { record: new Record(word.fields, word.rows, false), about: word };
      return;
    }
    const came = pending[stream];
    if (!came) return;
    pending[stream] = null;
    Object.assign(page, stream === 1 ? { opened: opened(came), ghost: null } : { ghost: opened(came) });
    tell("opened");
    if (page.recorded) put(ui, { vehicle: page.opened.about.vehicle.name });
    announce();
  },
};

function opened({ record, about }) {
  return { record, about, ...trailsOf(record, about.vehicle), label: about.filter ? t("replay.through", { name: about.filter }) : about.run.name };
}

function frame() {
  const { hello, recorded } = page, { name, world } = hello.vehicle;
  document.title = [name, "baqueano"].filter(Boolean).join(" · ");
  document.body.dataset.mode = hello.mode;
  put(ui, { vehicle: name, world: t(`world.${world}`) });
  ui.vehicle.style.borderColor = hello.robot ? `hsl(${70 + parseInt(hello.robot.slice(0, 4), 16) % 230} 60% 45%)` : "transparent"; // of a visitor, and never red
  ui.world.className = `chip world-${world}`;
  fixedTexts();
  show(ui.shared, hello.shared);
  const fits = { drive: !recorded, faults: !recorded && world === "simulated" }, shown = SCREENS.filter(({ key }) => fits[key] ?? true), before = page.screen?.constructor.key ?? location.hash.slice(1);
  page.screens = Object.fromEntries(shown.map((one) => [one.key, new one(page)]));
  ui.tabs.replaceChildren(...shown.map(({ key }) => el("button", { role: "tab", id: `tab-${key}`, onclick: () => open(key) }, t(`tab.${key}`))));
  for (const one of ui.tabs.children) one.setAttribute("aria-controls", "screen");
  stoppable(!recorded && hello.role !== "view");
  show(ui.meters, !recorded);
  show(ui.lease, !recorded && page.drives);
  lease(hello);
  open(page.screens[before] ? before : recorded ? "replay" : shown[0].key, false);
  follow(page.state.scene);
  ping();
}

function stoppable(can) {
  show(ui.stop, can);
  document.body.classList.toggle("no-stop", !can);
}

function fixedTexts() {
  put(ui, { language: otherLanguage().toUpperCase() });
  texts(document.body);
}

/** Show the screen of the played drives, until a person chooses another. */
function follow(scene) {
  if (!scene || page.chosen || scene.screen === page.scene) return;
  page.scene = scene.screen;
  if (scene.screen === Tuned.key) page.screens.tuned = new Tuned(scene);
  open(scene.screen, false);
}

function open(key, chosen = true) {
  if (!page.screens[key]) return;
  page.chosen ||= chosen;
  page.screen?.hidden?.();
  page.screen = page.screens[key];
  ui.screen.replaceChildren(page.screen.node);
  document.body.dataset.screen = key;
  for (const one of ui.tabs.children) one.ariaSelected = one.id === `tab-${key}`;
  page.hand.still();
  page.screen.shown?.();
  announce();
}

function announce() {
  const { state, hello, opened, recorded, screen } = page;
  if (!page.link.up) return;
  show(ui.clear, state.state === "STOPPED" && !recorded && page.drives);
  if (screen?.summary) sentence("info", ...screen.summary);
  else if (opened && (recorded || screen instanceof Replay)) sentence("info", opened.label, opened.about.sentence);
  else if (recorded) sentence("info", t(hello.open ? "replay.loading" : "replay.none"), "");
  else sentence(state.severity, state.title, [state.sentence, ...state.warnings].join(" "));
}

function sentence(severity, title, text) {
  put(ui, { title, text });
  ui.sentence.dataset.severity = severity;
}

function lease({ driver, you = false, watching = 0, others = [] } = {}) {
  const { recorded } = page;
  put(ui, {
    driver: t(`driver.${recorded ? "recorded" : you ? "you" : driver ? "other" : "none"}`, { driver }),
    watching: recorded || !watching ? "" : t(watching === 1 ? "driver.one-viewer" : "driver.viewers", { n: watching }),
    lease: t(you ? "lease.give" : "lease.take"),
  });
  ui.driver.classList.toggle("you", you);
  ui.lease.ariaPressed = you;
  show(ui.give, others.length);
  fill(ui.give, [["", t("lease.to")], ...others], "", (to) => page.hand.letGo(to));
  ui.clear.disabled = !you;
}

function meters() {
  const { record } = page, battery = record.value("battery");
  show(ui.battery.parentElement, Number.isFinite(battery));
  put(ui, { battery: `${num(battery, 2)} V`, delay: `${num(page.link_ms, 0)} ms`, late: `${num(record.value("late_ms"))} ms` });
}

function flash(id, name, ms) {
  const { classList } = ui[id];
  classList.add(name);
  clearTimeout(flash[id]);
  flash[id] = setTimeout(() => classList.remove(name), ms);
}

function say(text) {
  put(ui, { toast: text });
  flash("toast", "shown", 5000);
}

/** Stop without the control and without a confirmation, on each screen. */
function stop() {
  if (page.recorded) return;
  page.hand?.still();
  page.send({ type: "stop" });
  flash("stop", "pressed", 400);
}

function key(event, down) {
  if (page.hello && keyDone(event, down)) event.preventDefault();
}

function keyDone(event, down) {
  const { code, target, repeat } = event, { recorded, screen } = page, range = target.type === "range";
  if (code === "Space" && !recorded) {
    if (down && !repeat) stop();
    return true;
  }
  if (ui.keys.open && code === "Escape") ui.keys.close();
  if ((target.tagName === "INPUT" && !range) || ui.keys.open) return false;
  if ((target.tagName === "SELECT" || range) && /^(Arrow|Home|End|Page)/.test(code)) return false;
  const names = Object.keys(page.screens);
  if (target.role === "tab" && !event.shiftKey && /^Arrow(Left|Right)$/.test(code)) {
    const next = names.at((names.indexOf(screen.constructor.key) + (code === "ArrowRight" ? 1 : -1)) % names.length);
    if (down) { open(next); ui.tabs.querySelector("[aria-selected=true]")?.focus(); }
    return true;
  }
  if (screen.key?.(event, down)) return true;
  if (!down || !alone(event) || repeat) return false;
  if (/^Digit[1-9]$/.test(code)) open(names[code[5] - 1]);
  else if (code === "KeyL" && page.drives && !recorded) page.hand.toggle();
  else if (event.key === "?") help();
  return false;
}

/** Keep STOP within reach; meanwhile the keys do not drive. */
function help() {
  page.hand?.still();
  ui.keys.show();
}

function theme(chosen) {
  if (chosen) document.documentElement.dataset.theme = chosen;
  readColours();
}

/** Reconnect after 8 s of silence, because a lost network does not close the connection. */
function ping() {
  const { link } = page, sent = performance.now();
  if (page.recorded || document.hidden) return;
  if (link.socket.readyState < 2 && ++link.silent > 3) { on.down(); link.restart(link.language); }
  else if (link.up) page.ask("ping", {}, () => { page.link_ms = performance.now() - sent; });
}

function draw(now_ms) {
  requestAnimationFrame(draw);
  if (!page.screen) return;
  const began = performance.now(), { link, state } = page;
  page.screen.draw?.(now_ms);
  link.frame = link.number; // the last frame that is drawn
  page.hand.beat(now_ms);
  if (!page.recorded) meters();
  const age_ms = began - link.came_ms, waits = page.moves && !(state.paused && state.pace); // in a pause no rows arrive
  const old = !page.recorded && ((waits && age_ms > OLD_MS) || !link.up) && state.state !== "OVER" && link.came_ms > 0;
  show(ui.age, old);
  if (old) put(ui, { age: t("age", { s: num(age_ms / 1000) }) });
}

async function begin() {
  theme(new URLSearchParams(location.search).get("theme") ?? localStorage.getItem("theme"));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => theme());
  await speak();
  fixedTexts();
  sentence("info", t("link.opening"), "");
  lease();
  ui.stop.onpointerdown = stop;
  ui.stop.onclick = (e) => { if (e.detail === 0) stop(); }; // Enter, or a screen reader
  press(ui, {
    lease: () => page.hand?.toggle(), clear: () => page.send({ type: "clear" }), help, close: () => ui.keys.close(),
    theme() {
      const next = getComputedStyle(document.documentElement).colorScheme === "dark" ? "light" : "dark";
      localStorage.setItem("theme", next);
      theme(next);
    },
    async language() {
      await speak(otherLanguage());
      localStorage.setItem("lang", language);
      page.hand?.letGo();
      page.link.restart(language);
    },
  });
  addEventListener("keydown", (e) => key(e, true));
  addEventListener("keyup", (e) => key(e, false));
  page.link = new Link(language, on);
  setInterval(ping, 2000);
  requestAnimationFrame(draw);
}

globalThis.baqueano = { page }; // for the console and the tests
begin();
