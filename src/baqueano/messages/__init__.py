"""The sentences of diagnostics: one folder for each language, in it one module for each room, a template by code.

A template is a format string over the figures of the diagnostic, and `{fix}`. `{arg[use]}` names an argument, as
whoever reads it writes it (`Arguments`); `{arg[use]:{sensor}}` gives it that value. What has no template, or other
figures, is shown by its code: another version said it.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib import import_module

from baqueano.diagnostics import Diagnostic

LANGUAGES = ("english",)
ROOMS = ("blocks", "cli", "door", "names", "robot", "runs", "vehicle_file")


@dataclass(frozen=True, slots=True)
class Argument:
    """An argument of a function as Python writes it: `use`, and with a value `use = "gps"`."""

    name: str

    def __format__(self, value: str) -> str:
        return f'{self.name} = "{value}"' if value else self.name


@dataclass(frozen=True, slots=True)
class _Arguments:
    """All of them by name, for `{arg[use]}`."""

    written: Callable[[str], object]

    def __getitem__(self, name: str) -> object:
        return self.written(name)


@cache
def templates(language: str = "english") -> dict[str, str]:
    """Return the template of each code."""
    rooms = [import_module(f"{__name__}.{language}.{room}").TEMPLATES for room in ROOMS]
    return {str(code): template for room in rooms for code, template in room.items()}


def text(
    said: "Diagnostic | str | None", language: str = "english", argument: Callable[[str], object] = Argument
) -> str:
    """Return the sentence of a diagnostic, "" of none. What is text already is returned as it is.

    `argument` writes the name of an argument for the reader, and its value behind the colon of a format.

    >>> from baqueano.diagnostics import StopReason, stop
    >>> text(stop(StopReason.UNO_SILENT, silent_ms=320.0))
    'the Uno has been silent for 320 ms'
    """
    if said is None or isinstance(said, str):
        return said or ""
    template = templates(language).get(str(said.code))
    figures: dict[str, object] = {  # a cause among them as its sentence
        name: text(value, language, argument).rstrip(".") if isinstance(value, Diagnostic) else value
        for name, value in said.figures.items()
    }
    try:
        if template is not None:
            sentence = template.format_map(figures | {"fix": said.fix, "arg": _Arguments(argument)})
            return sentence.replace("?.", "?")  # of a cause that asks
    except (KeyError, ValueError, TypeError, IndexError, AttributeError):  # figures of another version
        pass
    shown = ", ".join(f"{name} = {value}" for name, value in figures.items())
    return f"{said.code}{f' ({shown})' if shown else ''}{f'. Type: {said.fix}' if said.fix else ''}"
