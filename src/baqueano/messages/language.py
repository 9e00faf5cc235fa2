"""Choose the language of messages, help and tables: by `--lang`, BAQUEANO_LANG or the locale, in this order.

The texts in the code are English. Each other language has a gettext catalogue,
locale/<language>/LC_MESSAGES/baqueano.mo, which `make catalogues` writes.
"""

import gettext
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from math import isnan
from pathlib import Path
from typing import TypeVar, cast

LANGUAGES = {"en": "English", "es": "español"}
LANGUAGE_VARIABLE = "BAQUEANO_LANG"
DOMAIN = "baqueano"
CATALOGUES = Path(__file__).parents[1] / "locale"
Shown = TypeVar("Shown")
_COMMA = str.maketrans({".": ",", ",": "\N{NO-BREAK SPACE}"})  # 1 234,5
_language = ""
_reader: ContextVar[str] = ContextVar("reader", default="")  # the language of the reader of a text


def choose_language(language: str) -> None:
    """Choose one of LANGUAGES for this process and for the help of its command line; "" cancels the choice."""
    global _language
    _language = language
    os.environ["LANGUAGE"] = current_language()
    gettext.bindtextdomain(DOMAIN, str(CATALOGUES))
    gettext.textdomain(DOMAIN)  # click uses it


@contextmanager
def use_language(language: str) -> Iterator[None]:
    """Use this language within the context, for a page with readers of several languages.

    >>> with use_language("es"):
    ...     print(current_language(), f"{number(0.25):.2f}")
    es 0,25
    """
    token = _reader.set(language)
    try:
        yield
    finally:
        _reader.reset(token)


def current_language() -> str:
    """Return the present language, a key of LANGUAGES.

    >>> current_language()
    'en'
    """
    return _parse_language(_reader.get() or chosen_language() or _system_locale()) or "en"


def chosen_language() -> str:
    """Return the language of `--lang` or BAQUEANO_LANG, a key of LANGUAGES; "" without this choice."""
    return _parse_language(_language or os.environ.get(LANGUAGE_VARIABLE, ""))


def process_environment() -> dict[str, str]:
    """Return the environment of a child process, so that it has the chosen language."""
    return os.environ | {LANGUAGE_VARIABLE: chosen_language()}


def _parse_language(tag: str) -> str:
    language = tag.partition("_")[0].partition(".")[0].lower()
    return language if language in LANGUAGES else ""


def translate(words: str, context: str = "", /, **figures: object) -> str:
    """Return the text `words` in the current language, with `figures` in its fields.

    A text without a translation stays English.

    >>> translate("{laps} laps in {t_s:.1f} s", laps=3, t_s=12.0)
    '3 laps in 12.0 s'
    """
    language = current_language()
    if language != "en" and words:
        catalogue = _catalogue(language)
        words = catalogue.pgettext(context, words) if context else catalogue.gettext(words)
    return words.format_map({name: number(value) for name, value in figures.items()}) if figures else words


def mark(words: str) -> str:
    """Return a text unchanged, marked for the catalogue; `translate` translates it before it is shown."""
    return words


def number(value: Shown) -> Shown:
    """Return a number that formats itself as the current language does; return any other value unchanged.

    >>> f"{number(0.25):.1f}"
    '0.2'
    >>> with use_language("es"):
    ...     print(f"{number(12345.5):,.1f}")
    12 345,5
    """
    if current_language() == "en":
        return value
    shown_value: object = value
    if isinstance(value, list | tuple):
        shown_value = type(value)(map(number, value))
    elif isinstance(value, float):
        shown_value = _Float(value)
    elif isinstance(value, int) and not isinstance(value, bool):
        shown_value = _Int(value)
    return cast("Shown", shown_value)


N_ = mark
PLACEHOLDERS = (  # names of values in the help: of options and of arguments
    N_("ADDRESS"), N_("ANGLE"), N_("BLOCK"), N_("BLOCKS"), N_("CLASS"), N_("DEG"), N_("DEVICE"), N_("FACTOR"),
    N_("FILE"), N_("FILES"), N_("FOLDER"), N_("HEIGHT"), N_("HIGH"), N_("KEY"), N_("KIND"), N_("LENGTH"),
    N_("LOW"), N_("MAP"), N_("NAME"), N_("OTHER"), N_("FRACTION"), N_("RATIO"), N_("ROUTE"), N_("RUN"),
    N_("RUNS"), N_("SECONDS"), N_("SHAPE"), N_("SOURCE"), N_("TIME"), N_("VALUE"), N_("DIRECTION"),
    N_("WHAT"), N_("WHEN"), N_("WIDTH"), N_("WORDS"),
)  # fmt: skip
_PLACEHOLDER = re.compile(rf"(?<![A-Z_])(?:{'|'.join(PLACEHOLDERS)})(?![A-Z_])")
_MISSING_VALUE = re.compile(r"(?<=[ =])(?:FILE|FOLDER|KEY|NAME|ROUTE|RUN|VALUE)(?![\w.])")
_UNIT_WORDS = (N_("unit of u"), N_(" per "))


def shown_unit(words: str) -> str:
    """Return a unit in the current language.

    >>> with use_language("es"):
    ...     print(shown_unit("N per unit of u"))
    N por unidad de u
    """
    for unit_word in _UNIT_WORDS:
        words = words.replace(unit_word, translate(unit_word))
    return words


def percent_text(part: float) -> str:
    """Return a share of a variance as text: "-" for NaN, and "below -100 %" instead of a smaller value.

    >>> percent_text(0.987), percent_text(-3.0)
    ('98.7 %', 'below -100 %')
    """
    if isnan(part):
        return "-"
    return f"{number(100.0 * part):.1f} %" if part > -1.0 else translate(N_("below -100 %"))


def ratio_text(ratio: float) -> str:
    """Return a ratio as text, such as "2.10×"; "-" for NaN.

    >>> ratio_text(2.1), ratio_text(1e4)
    ('2.10×', 'over 1000×')
    """
    if isnan(ratio):
        return "-"
    return f"{number(ratio):.2f}×" if ratio < 1e3 else translate(N_("over 1000×"))


def shown_placeholders(words: str) -> str:
    """Return the name of an option's value in the current language.

    >>> with use_language("es"):
    ...     print(shown_placeholders("KEY=VALUE"))
    CLAVE=VALOR
    """
    return _PLACEHOLDER.sub(lambda match: translate(match[0]), words)


def shown_command(words: str) -> str:
    """Return a command to type, with the placeholder of a missing value in the current language.

    >>> with use_language("es"):
    ...     print(shown_command("--vehicle FILE"), shown_command("runs import FILE.csv"))
    --vehicle ARCHIVO runs import FILE.csv
    """
    return _MISSING_VALUE.sub(lambda match: translate(match[0]), words)


class _Float(float):
    def __format__(self, spec: str) -> str:
        return format(float(self), spec).translate(_COMMA)

    def __repr__(self) -> str:
        return repr(float(self)).translate(_COMMA)


class _Int(int):
    def __format__(self, spec: str) -> str:
        return format(int(self), spec).translate(_COMMA)


@cache
def _catalogue(language: str) -> gettext.NullTranslations:
    return gettext.translation(DOMAIN, CATALOGUES, [language], fallback=True)


def _system_locale() -> str:
    locale_name = next(
        (os.environ[name] for name in ("LC_ALL", "LC_MESSAGES", "LANG") if os.environ.get(name)), ""
    )
    if locale_name or os.name != "nt":
        return locale_name
    import ctypes
    import locale

    return locale.windows_locale.get(ctypes.windll.kernel32.GetUserDefaultUILanguage(), "")
