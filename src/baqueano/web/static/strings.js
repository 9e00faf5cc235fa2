// The texts of the page, and its numbers, in the language of the visitor.

const LANGUAGES = ["en", "es"];
let texts = {};
export let language = "en";

function preference() {
  const lang = new URLSearchParams(location.search).get("lang") ?? localStorage.getItem("lang");
  return LANGUAGES.includes(lang) ? lang : navigator.languages.some((one) => one.startsWith("es")) ? "es" : "en";
}

export async function speak(chosen = preference()) {
  language = chosen;
  texts = await (await fetch(`/static/${chosen}.json`)).json();
  document.documentElement.lang = chosen;
}

export const otherLanguage = () => language === "en" ? "es" : "en";

/** Return a text with its {names} replaced; without a text return the key, so that a test detects it. */
export const t = (key, values = {}) => (texts[key] ?? key).replace(/\{(\w+)\}/g, (_, name) => values[name] ?? "");

/** Return the text of `key.name`, or the name itself. */
export const wordFor = (key, name) => texts[`${key}.${name}`] ?? name;

/** Return a number, or an en dash if it is not finite. */
export function num(value, decimals = 1) {
  if (!Number.isFinite(value)) return "–";
  const plain = value.toFixed(decimals), digits = plain.replace("-", "");
  return (plain < 0 ? "−" : "") + (language === "es" ? digits.replace(".", ",") : digits);
}

export function three(value) {
  const size = Math.abs(value);
  return num(value, size >= 99.95 ? 0 : size >= 9.995 ? 1 : size >= 0.9995 ? 2 : !size || size >= 0.001 ? 3 : 4);
}

export const percent = (part, decimals = 0) => `${num(100 * part, decimals)}\u00a0%`;

/** Return a length [m] as [number, unit]: centimetres below a metre. */
export function length(metres) {
  if (!Number.isFinite(metres)) return ["–", ""];
  return Math.abs(metres) < 0.995 ? [num(metres * 100), "cm"] : [num(metres, 2), "m"];
}

/** Return a time [s] with its unit, as m:ss,s from one minute. */
export function duration(seconds) {
  if (!(seconds >= 60)) return `${num(seconds)} s`;
  const minutes = Math.floor(seconds / 60);
  return `${minutes}:${num(seconds - 60 * minutes).padStart(4, "0")} min`;
}
