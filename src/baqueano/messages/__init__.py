"""The sentences of diagnostics: one folder for each language, in it one module for each room, a template by code.

A template is a format string over the figures of the diagnostic, and `{fix}`. What has no template, or other
figures, is shown by its code: another version said it.
"""

from functools import cache
from importlib import import_module

from baqueano.diagnostics import Diagnostic

LANGUAGES = ("english",)
ROOMS = ("blocks", "door", "robot")


@cache
def templates(language: str = "english") -> dict[str, str]:
    """Return the template of each code."""
    rooms = [import_module(f"{__name__}.{language}.{room}").TEMPLATES for room in ROOMS]
    return {str(code): template for room in rooms for code, template in room.items()}


def text(said: "Diagnostic | str | None", language: str = "english") -> str:
    """Return the sentence of a diagnostic, "" of none. What is text already is returned as it is.

    >>> from baqueano.diagnostics import StopReason, stop
    >>> text(stop(StopReason.UNO_SILENT, silent_ms=320.0))
    'the Uno has been silent for 320 ms'
    """
    if said is None or isinstance(said, str):
        return said or ""
    template = templates(language).get(str(said.code))
    try:
        if template is not None:
            sentence = template.format_map({**_told(said, language), "fix": said.fix})
            return sentence.replace("?.", "?")  # of a cause that asks
    except (KeyError, ValueError, TypeError, IndexError, AttributeError):  # figures of another version
        pass
    shown = ", ".join(f"{name} = {value}" for name, value in _told(said, language).items())
    return f"{said.code}{f' ({shown})' if shown else ''}{f'. Type: {said.fix}' if said.fix else ''}"


def _told(said: Diagnostic, language: str) -> dict[str, object]:
    """Return the figures, a cause among them as its sentence."""
    return {
        name: text(value, language).rstrip(".") if isinstance(value, Diagnostic) else value
        for name, value in said.figures.items()
    }
