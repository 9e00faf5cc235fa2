// The page: the frame around the screens, the words that come and go, one drawing loop.

import { leave, readColours } from "./canvas.js";
import { Blocks } from "./blocks.js";
import { $, alone, el, show, write } from "./dom.js";
import { Drive } from "./drive.js";
import { Faults } from "./faults.js";
import { Hand } from "./hand.js";
import { Identify } from "./identify.js";
import { Link } from "./link.js";
import { Record } from "./record.js";
import { Opened, Replay } from "./replay.js";
import { Runs } from "./runs.js";
import { Tune } from "./tune.js";
import { Tuned } from "./tuned.js";
import { duration, language, num, otherLanguage, speak, t } from "./strings.js";

const KEPT_S = 60; // of a live drive
const OLD_MS = 200; // from where on the age of the picture is shown
const SCREENS = [Drive, Identify, Replay, Tune, Runs, Blocks, Faults];
const KEYS = ["Space", "L", "W A S D ↑ ↓ ← →", "T R B", "P M E", "1 2 3 4", "F 0 + −", "K ← → Home End", "[ ]", "N V", "Shift+↑ N G"];

const page = {
  hello: null, record: null, state: {}, route: null, runs: [], opened: null, ghost: null, screens: {}, screen: null, hand: null, link: null, driver: null,
  say, stop, open, openRun,
  get moves() { return ["MISSION", "MANUAL"].includes(this.state.state); },
};
const pending = {};
const NO_VEHICLE = { name: "", footprint: { kind: "round", length_m: 0.14, width_m: 0.14 }, command: [], rate_hz: 100, world: "recorded" }; // before a run is open

const on = {
  hello(word) {
    word.vehicle ??= NO_VEHICLE;
    if (!word.fields.length) word.fields = [{ name: "t", unit: "s", group: "t", label: "t" }];
    Object.assign(page, { hello: word, state: word.state ?? {}, route: word.route, runs: word.runs ?? [], opened: null, ghost: null, driver: word.driver, ledger: [] });
    page.record = new Record(word.fields, KEPT_S * word.vehicle.rate_hz, true);
    page.hand?.still();
    page.hand ??= new Hand(page);
    page.hand.lease({ you: false });
    frame();
    if (word.open) page.link.send(word.open.ghost ? { is: "open", ...word.open } : { is: "open", run: word.open.run });
  },
  rows(stream, values, count) {
    if (stream === 0) page.record.add(values, count);
    else pending[stream]?.record.add(values, count);
  },
  up(up) {
    document.body.classList.toggle("down", !up);
    if (up) return;
    page.hand?.lease({ you: false });
    show($("stop"), true);
    sentence("error", t("link.lost"), t("link.again"));
    lease({ who: null, you: false });
  },
  over() {
    page.hand?.lease({ you: false });
    document.body.classList.add("no-stop");
    for (const id of ["stop", "lease"]) show($(id), false);
  },
  state(word) {
    page.state = word;
    page.screens.drive?.state(word);
    page.screens.faults?.state();
    follow(word.scene);
    told();
    meters();
  },
  ledger({ rows }) { page.ledger = rows; page.screens.faults?.ledger(rows); },
  route(word) { page.route = word.x?.length ? word : null; },
  routes({ routes }) { page.screens.drive?.routes(routes.map((one) => one.name ?? one)); },
  blocks({ blocks, gains, swapped }) {
    page.hello.blocks = blocks;
    page.hello.vehicle.gains = gains;
    page.hello.swapped = swapped;
    for (const one of Object.values(page.screens)) one.blocks?.();
  },
  runs({ runs }) { page.runs = runs; for (const one of Object.values(page.screens)) one.runs?.(); },
  identify(word) { page.screens.identify?.take(word); },
  lease(word) { page.hand.lease(word); lease(word); page.screens.drive?.state(page.state); page.screens.faults?.state(); },
  event({ severity, text }) { if (["warning", "error", "fatal"].includes(severity)) say(text); },
  no({ why }) {
    if (page.hello && page.link.up) say(why);
    else sentence("error", t("link.refused"), why);
  },
  answer(word) {
    if (word.to !== "open") return;
    const { stream } = word;
    if (!word.done) {
      pending[stream] = { record: new Record(word.fields, word.rows ?? 4096, false), about: { events: [], route: null, ...word, vehicle: word.vehicle ?? page.hello.vehicle } };
      return;
    }
    if (!pending[stream]) return;
    const { record, about } = pending[stream];
    pending[stream] = null;
    if (stream === 1) Object.assign(page, { opened: new Opened(record, about), ghost: null });
    else page.ghost = new Opened(record, about);
    rebuilt();
  },
};

/** What was opened came: the screens show it. */
function rebuilt() {
  for (const one of Object.values(page.screens)) one.opened?.();
  if (page.hello.mode === "replay") write($("vehicle"), page.opened.about.vehicle.name);
  told();
}

function openRun(run, ghost, filter) {
  page.link.send({ is: "open", run, ...(ghost ? { ghost } : {}), ...(filter ? { filter } : {}) });
  open("replay");
}

/** Make the frame for this vehicle, this visitor and this language. */
function frame() {
  const { hello } = page, replay = hello.mode === "replay";
  document.title = [hello.vehicle.name, "baqueano"].filter(Boolean).join(" · ");
  document.body.dataset.mode = hello.mode;
  for (const node of document.querySelectorAll("canvas")) leave(node);
  write($("vehicle"), hello.vehicle.name);
  $("vehicle").style.borderColor = hello.robot ? `hsl(${70 + parseInt(hello.robot.slice(0, 4), 16) % 230} 60% 45%)` : "transparent"; // its own, and never red
  write($("world"), t(`world.${hello.vehicle.world}`));
  $("world").className = `chip world-${hello.vehicle.world}`;
  fixedTexts();
  write($("shared"), t("shared"));
  show($("shared"), Boolean(hello.shared));
  const shown = SCREENS.filter((one) => !(replay && one === Drive) && (one !== Faults || (!replay && hello.vehicle.world === "simulated")));
  const before = page.screen?.constructor.key ?? location.hash.slice(1);
  page.screens = Object.fromEntries(shown.map((one) => [one.key, new one(page)]));
  $("tabs").replaceChildren(...shown.map((one) => el("button", { role: "tab", id: `tab-${one.key}`, "aria-controls": "screen", onclick: () => open(one.key) }, t(`tab.${one.key}`))));
  const canStop = !replay && hello.role !== "view";
  show($("stop"), canStop);
  document.body.classList.toggle("no-stop", !canStop);
  $("meters").replaceChildren(...(replay ? [] : ["battery", "link", "loop"].map((key) => el(`span.meter.of-${key}`, el("span", t(`meter.${key}`)), el("b", { id: `meter-${key}` }, "–")))));
  show($("lease"), !replay && hello.role === "drive");
  lease({ who: hello.driver, you: false, watching: hello.watching });
  open(page.screens[before] ? before : replay ? "replay" : shown[0].key, false);
  follow(page.state.scene);
  page.ping();
  told();
}

function fixedTexts() {
  write($("stop-word"), t("stop"));
  write($("stop-key"), t("stop.key"));
  $("sentence").setAttribute("aria-label", t("sentence"));
  write($("language"), otherLanguage().toUpperCase());
  for (const id of ["language", "theme", "help"]) { $(id).title = t(`set.${id}`); $(id).setAttribute("aria-label", `${$(id).textContent} ${t(`set.${id}`)}`.trim()); }
  write($("clear"), t("clear"));
  $("tabs").setAttribute("aria-label", t("tabs"));
  $("keys").replaceChildren(el("h2", t("keys")), el("dl", ...KEYS.flatMap((key, k) => [el("dt", ...(k ? key : t("stop.key")).split(" ").map((one) => el("kbd", one))), el("dd", t(`keys.${k}`))])), el("button.primary", { onclick: () => $("keys").close() }, t("keys.close")));
}

/** Show the screen of the drives that are played, until somebody chooses one. */
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
  $("screen").replaceChildren(page.screen.node);
  document.body.dataset.screen = key;
  for (const one of $("tabs").children) one.setAttribute("aria-selected", String(one.id === `tab-${key}`));
  $(`tab-${key}`)?.scrollIntoView({ inline: "center", block: "nearest" });
  page.hand.still();
  page.screen.shown?.();
  told();
}

/** The one sentence: of the drive, or of the run that is open. */
function told() {
  const { state, hello, opened } = page;
  if (!hello || !page.link.up) return;
  if (page.screen?.told) { sentence("info", ...page.screen.told); return; }
  const recorded = hello.mode === "replay" || (page.screen?.constructor === Replay && opened);
  if (recorded) {
    const about = opened?.about;
    sentence("info", opened ? opened.label : t(hello.open || hello.mode === "live" ? "replay.loading" : "replay.none"), about?.sentence ?? (opened ? t("replay.about", { s: duration(opened.record.end), n: opened.record.length }) : ""));
  } else sentence(state.severity, state.title ?? t(`state.${state.state}`), [state.sentence, ...(state.odd ?? [])].filter(Boolean).join(" "));
  show($("clear"), state.state === "STOPPED" && hello.mode !== "replay" && hello.role === "drive");
  $("clear").disabled = !page.hand.mine;
}

function sentence(severity, title, text) {
  write($("title"), title);
  write($("text"), text);
  $("sentence").dataset.severity = severity ?? "info";
}

function lease({ who, you, watching }) {
  const replay = page.hello?.mode === "replay";
  write($("driver"), replay ? t("driver.recorded") : you ? t("driver.you") : who ? t("driver.other", { who }) : t("driver.nobody"));
  $("driver").classList.toggle("you", Boolean(you));
  write($("watching"), replay || !watching ? "" : watching === 1 ? t("driver.one-watches") : t("driver.watch", { n: watching }));
  write($("lease"), t(you ? "lease.give" : "lease.take"));
  $("lease").setAttribute("aria-pressed", String(Boolean(you)));
  if (page.hello) $("clear").disabled = !you;
}

function meters() {
  if (!$("meter-battery")) return;
  const { record } = page;
  const battery = record.value("battery"), late = record.value("late_ms");
  show($("meter-battery").parentElement, Number.isFinite(battery));
  write($("meter-battery"), `${num(battery, 2)} V`);
  write($("meter-link"), page.link_ms === undefined ? "–" : `${num(page.link_ms, 0)} ms`);
  write($("meter-loop"), `${num(late, 1)} ms`);
}

let quiet = 0;
function say(text) {
  write($("toast"), text);
  $("toast").classList.add("shown");
  clearTimeout(quiet);
  quiet = setTimeout(() => $("toast").classList.remove("shown"), 5000);
}

/** Stop: no lease, no confirmation, from wherever. */
function stop() {
  if (page.hello?.mode === "replay") return;
  page.hand?.still();
  page.link.send({ is: "stop" });
  $("stop").classList.add("pressed");
  setTimeout(() => $("stop").classList.remove("pressed"), 400);
}

function key(event, down) {
  if (!page.hello) return;
  const recorded = page.hello.mode === "replay", typing = event.target.tagName === "INPUT" && event.target.type !== "range";
  if (event.code === "Space" && !recorded) {
    event.preventDefault();
    if (down && !event.repeat) stop();
    return;
  }
  if (typing || $("keys").open) return;
  const choosing = event.target.tagName === "SELECT" || event.target.type === "range";
  if (choosing && /^(Arrow|Home|End|Page)/.test(event.code)) return;
  if (event.target.getAttribute?.("role") === "tab" && !event.shiftKey && /^Arrow(Left|Right)$/.test(event.code)) {
    if (down) neighbour(event.code === "ArrowRight" ? 1 : -1);
    event.preventDefault();
    return;
  }
  if (page.screen instanceof Drive && page.hand.key(event, down)) { event.preventDefault(); return; }
  if (page.screen.key?.(event, down)) { event.preventDefault(); return; }
  if (!down || !alone(event) || event.repeat) return;
  const number = /^Digit([1-9])$/.exec(event.code)?.[1];
  const names = Object.keys(page.screens);
  if (number && names[number - 1]) open(names[number - 1]);
  else if (event.code === "KeyL" && page.hello.role === "drive" && !recorded) page.hand.toggle();
  else if (event.key === "?") $("keys").showModal();
}

function neighbour(way) {
  const names = Object.keys(page.screens), k = names.indexOf(page.screen.constructor.key);
  const next = names[(k + way + names.length) % names.length];
  open(next);
  $(`tab-${next}`)?.focus();
}

function theme(chosen) {
  if (chosen) document.documentElement.dataset.theme = chosen;
  readColours();
}

function darkNow() {
  const forced = document.documentElement.dataset.theme;
  return forced ? forced === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
}

const costs = []; // ms of the last drawings
function draw(now_ms) {
  requestAnimationFrame(draw);
  if (!page.hello || !page.screen) return;
  const began = performance.now();
  page.screen.draw?.(now_ms);
  page.link.drawn();
  page.hand.beat(now_ms);
  const live = page.hello.mode === "live", age = page.link.age_ms, moves = page.moves && !page.state.paused; // who stands sends no rows
  const old = live && ((moves && age > OLD_MS) || !page.link.up) && page.state.state !== "OVER" && page.link.came_ms > 0;
  show($("age"), old);
  if (old) write($("age"), t("age", { s: num(age / 1000, 1) }));
  if (live) meters();
  costs.push(performance.now() - began);
  if (costs.length > 240) costs.shift();
}

async function begin() {
  theme(new URLSearchParams(location.search).get("theme") ?? localStorage.getItem("theme"));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => theme());
  await speak();
  fixedTexts();
  sentence("info", t("link.opening"), "");
  lease({ who: null, you: false });
  $("stop").addEventListener("pointerdown", stop);
  $("stop").addEventListener("click", (e) => { if (e.detail === 0) stop(); }); // Enter, or a screen reader
  $("lease").addEventListener("click", () => page.hand?.toggle());
  $("clear").addEventListener("click", () => page.link.send({ is: "clear" }));
  $("help").addEventListener("click", () => $("keys").showModal());
  $("theme").addEventListener("click", () => { const next = darkNow() ? "light" : "dark"; localStorage.setItem("theme", next); theme(next); });
  $("language").addEventListener("click", async () => {
    const next = otherLanguage();
    localStorage.setItem("lang", next);
    await speak(next);
    page.hand = null;
    page.link.restart(language);
  });
  addEventListener("keydown", (e) => key(e, true));
  addEventListener("keyup", (e) => key(e, false));
  page.link = new Link(language, on);
  const ping = () => {
    if (!page.link.up || page.hello?.mode !== "live" || document.hidden) return;
    const sent = performance.now();
    page.link.ask("ping", {}, () => { page.link_ms = performance.now() - sent; });
  };
  page.ping = ping;
  setInterval(ping, 2000);
  requestAnimationFrame(draw);
}

globalThis.baqueano = { page, costs }; // to look at from the browser's console
begin();
