"""Make the sentences of diagnostics: a template for each code, one module for each subject, translated by language.py.

A template is a format string with the values (`figures`) of the diagnostic, `{subject}` and `{fix}`. A value named
`unit` includes the space before it, so that `{x:.3g}{unit}` is also correct without a unit. The value `of_run` names
one run of several, and is written before the sentence. In the reader's notation (notation.py), `{arg[use]}` is an
argument, `{arg[use]:{sensor}}` this argument with a value, and `{type[--report fit.html]}` a command. `{what:word}` is
a value whose words are also translated. A message of another version can lack its template or have other values: then
its code is shown.
"""

import re
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from importlib import import_module
from typing import Any

from baqueano.diagnostics import Diagnostic, Verdict
from baqueano.messages import language
from baqueano.messages.notation import current_notation

ROOMS = (
    "cli", "fit", "fit_errors", "front", "live", "names", "noise", "page", "vehicle_file", "blocks.block_checks",
    "blocks.block_fields", "blocks.loop", "blocks.symbolic", "driving.compare", "driving.drive", "driving.monitor",
    "driving.routes", "driving.shake", "driving.simulate", "driving.study", "driving.sweep", "driving.tune",
    "recordings.damage", "recordings.data", "recordings.imports", "recordings.runs", "vehicle.door",
    "vehicle.hardware", "vehicle.robot",
)  # fmt: skip
_QUANTITY_SPACE = re.compile(r"(?<=±) | (?=%)|(?<=\d) (?=[^\W\d_]{1,3}\b)")
MAX_LISTED_NAMES = 5  # further subjects that a combined message names


@cache
def templates() -> dict[str, str]:
    """Return the English template of each code."""
    rooms = [import_module(f"{__name__}.english.{room}").TEMPLATES for room in ROOMS]
    return {str(code): template for room in rooms for code, template in room.items()}


class _Arguments:
    """All arguments by name, for `{arg[use]}`, or all commands by their words, for `{type[--cost innovations]}`."""

    __slots__ = ("_written",)

    def __init__(self, write: Callable[[str], object]) -> None:
        self._written = write

    def __getitem__(self, name: str) -> object:
        return self._written(name)


class _TranslatedText(str):
    """A figure that is a text; the format `word` translates it, and `block` its first word, the role of a block."""

    __slots__ = ()

    def __format__(self, spec: str) -> str:
        if spec == "block":
            role, space, rest = self.partition(" ")
            return language.translate(role) + space + rest
        return language.translate(str(self)) if spec == "word" else format(str(self), spec)


def text(message: "Diagnostic | str | None") -> str:
    """Return the sentence of a diagnostic in the current language; "" for None. A text is returned unchanged.

    >>> from baqueano.diagnostics import StopReason, stop
    >>> text(stop(StopReason.UNO_SILENT, silent_ms=320.0))
    'the Uno has been silent for 320 ms'
    """
    if message is None or isinstance(message, str):
        return message or ""
    figures, argument = _figure_texts(message), current_notation().argument
    run = figures.pop("of_run", "")
    prefix = f"{run}: " if run else ""
    template = templates().get(str(message.code))
    try:
        if template is not None:
            template = language.translate(template, str(message.code))
            subject = message.subject.removeprefix("model.")
            sentence = template.format_map(
                {"subject": subject, "fix": _shown_command(message.fix), "arg": _Arguments(argument)}
                | {"type": _Arguments(_shown_command)}
                | figures
            )
            return prefix + sentence.replace("?.", "?")  # if the cause is a question
    except (KeyError, ValueError, TypeError, IndexError, AttributeError):  # figures from another version
        pass
    detail = ", ".join(f"{name} = {value}" for name, value in figures.items())
    advice = f". Type: {_shown_command(message.fix)}" if message.fix else ""
    return f"{prefix}{message.code}{f' ({detail})' if detail else ''}{advice}"


def _shown_command(line: str) -> str:
    """Return a command to type in the reader's notation and language."""
    return language.shown_command(current_notation().command(line))


def english_text(message: "Diagnostic | str | None") -> str:
    """Return the English sentence of a diagnostic, for files."""
    with language.use_language("en"):
        return text(message)


def texts(messages: "Iterable[Diagnostic | str]") -> list[str]:
    """Return the sentence of each message, in the current language."""
    return [text(message) for message in messages]


def with_full_stop(sentence: str) -> str:
    """Return a sentence with a full stop at its end; unchanged if it already ends with ".", "?" or "!".

    >>> with_full_stop("was it touched?"), with_full_stop("the run is short")
    ('was it touched?', 'the run is short.')
    """
    return sentence if sentence.endswith((".", "?", "!")) else f"{sentence}."


def unbroken(sentence: str) -> str:
    """Return a sentence in which a line does not end between a number and its unit, or after ±.

    >>> unbroken("the errors of the fit are ± 33 cm (95 %)").split(" ")
    ['the', 'errors', 'of', 'the', 'fit', 'are', '±\xa033\xa0cm', '(95\xa0%)']
    """
    return _QUANTITY_SPACE.sub("\u00a0", sentence)


def list_item(sentence: str) -> str:
    """Return a sentence for a list of a report: with a capital letter and a full stop. A name keeps its letters.

    >>> list_item("the run is short"), list_item("imu[2] is silent"), list_item("small (a.toml): planar")
    ('The run is short.', 'imu[2] is silent.', 'small (a.toml): planar.')
    """
    first_word, _, rest = sentence.partition(" ")
    is_word = first_word.rstrip(",").isalpha() and not rest.startswith("(")
    return with_full_stop(sentence[:1].upper() + sentence[1:] if is_word else sentence)


def json_row(message: Diagnostic) -> dict[str, Any]:
    """Return a diagnostic for JSON: code, figures, and the sentence as `text`."""
    return message.to_json() | {"text": text(message)}


def verdict_line(verdict: Verdict, reasons: "Iterable[Diagnostic | str]", default: str = "") -> str:
    """Return a verdict and its reasons in one line; without reasons, the verdict and `default`.

    >>> verdict_line(Verdict.WARN, ["the run is short", "the floor is soft"])
    'WARN: the run is short; the floor is soft'
    """
    sentences = "; ".join(texts(reasons)) or default
    word = language.translate(str(verdict))
    return f"{word}: {sentences}" if sentences else word


def group_sentences(messages: Sequence[Diagnostic]) -> list[str]:
    """Return a sentence for each kind of message; one kind differs only in subject, run and numbers."""
    groups: dict[Any, list[Diagnostic]] = {}
    for message in messages:
        groups.setdefault((message.severity, _kind(message)), []).append(message)
    return [text(_merge(group)) for group in groups.values()]


def _kind(message: Diagnostic) -> tuple[Any, ...]:
    """Return a key for `group_sentences`: the code, and the figures that are texts or diagnostics."""
    words = {k: v for k, v in message.figures.items() if isinstance(v, str | Diagnostic) and k != "of_run"}
    return message.code, *((k, _kind(v) if isinstance(v, Diagnostic) else v) for k, v in words.items())


def _merge(group: Sequence[Diagnostic]) -> Diagnostic:
    first, subjects = group[0], [*dict.fromkeys(message.subject for message in group)][1:]
    if subjects:
        rest = ", …" if len(subjects) > MAX_LISTED_NAMES else ""
        names = ", ".join(subjects[:MAX_LISTED_NAMES]).replace("model.", "") + rest
        return Diagnostic("messages.others", first.severity, figures={"first": first, "others": names})
    if len(group) == 1:
        return first
    return Diagnostic("messages.times", first.severity, figures={"first": first, "count": len(group)})


def _figure_texts(message: Diagnostic) -> dict[str, Any]:
    """Return the figures in the notation of the current language; a diagnostic as its sentence."""
    return {
        name: text(value).rstrip(".")
        if isinstance(value, Diagnostic)
        else f" {language.shown_unit(value)}"
        if name == "unit" and value
        # of the operating system
        else _TranslatedText(language.translate(value) if name == "error" else value)
        if isinstance(value, str)
        else language.number(value)
        for name, value in message.figures.items()
    }
