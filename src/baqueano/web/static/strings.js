// The page's own texts in the visitor's language, and numbers as that language writes them.

const LANGUAGES = ["en", "es"];
let texts = {};
export let language = "en";

function wanted() {
  const asked = new URLSearchParams(location.search).get("lang") ?? localStorage.getItem("lang");
  if (LANGUAGES.includes(asked)) return asked;
  return (navigator.languages ?? []).some((one) => one.startsWith("es")) ? "es" : "en";
}

export async function speak(chosen = wanted()) {
  language = chosen;
  texts = await (await fetch(`/static/${chosen}.json`)).json();
  document.documentElement.lang = chosen;
}

export const otherLanguage = () => LANGUAGES[1 - LANGUAGES.indexOf(language)];

/** Return the text of a key, its {names} filled in; the key itself where there is none, so that a test sees it. */
export function t(key, values = {}) {
  return (texts[key] ?? key).replace(/\{(\w+)\}/g, (_, name) => values[name] ?? "");
}

/** Return a number with so many decimals; an en dash for what is not known. */
export function num(value, decimals = 1) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const plain = value.toFixed(decimals);
  const sign = Number(plain) < 0 ? "−" : "";
  const digits = plain.replace("-", "");
  return sign + (language === "es" ? digits.replace(".", ",") : digits);
}

/** Return a number with three figures that count. */
export function three(value) {
  if (!Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  if (size !== 0 && size < 0.001) return num(value, 4);
  return num(value, size >= 99.95 ? 0 : size >= 9.995 ? 1 : size >= 0.9995 ? 2 : 3);
}

/** Return a length [m] as [number, unit]: centimetres below a metre. */
export function length(metres) {
  if (!Number.isFinite(metres)) return ["–", ""];
  return Math.abs(metres) < 0.995 ? [num(metres * 100, 1), "cm"] : [num(metres, 2), "m"];
}

/** Return a time with its unit. */
export const duration = (seconds) => `${clock(seconds)} ${seconds < 60 ? "s" : "min"}`;

/** Return seconds as m:ss,s where there is a minute, else as s,s. */
export function clock(seconds) {
  if (!Number.isFinite(seconds)) return "–";
  if (seconds < 60) return num(seconds, 1);
  const whole = Math.floor(seconds / 60);
  return `${whole}:${num(seconds - 60 * whole, 1).padStart(4, "0")}`;
}
