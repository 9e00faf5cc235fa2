"""What to type after an error: a command that goes further, never the one that failed as it was.

A name that was not found is put right by the nearest that is there. Where a file is to be mended first, the same
command does after that. Else the options are shown.
"""

import difflib
import os
import re
import shlex
import subprocess
from pathlib import Path

USAGE, BAD_FILE = 2, 3
GROUPS = (["runs"], ["study"], ["blocks"], ["robot"])
LIKE = 0.5  # part of their letters that a word and what was meant have in common
NEAR = 0.75  # the same of the names of two files
SHOWN = 5  # files of a folder that are named
_MEANT = re.compile(r"Did you mean '?([^\s'?]+)'?\?")


def with_next(text: str, code: int, args: list[str]) -> str:
    """The text; what to type next, if it does not say so itself.  args: the command line, without `baqueano`."""
    if "Type:" in text or code not in (USAGE, BAD_FILE):
        return text
    text = sentence(text)
    named = [arg for arg in args if not arg.startswith("-") and _named(_name(arg), text)]
    missing = [arg for arg in named if (Path(arg).suffix or _quoted(arg, text)) and not Path(arg).exists()]
    if (meant := _MEANT.search(text)) is not None and (
        again := _put_right(meant[1], args, named)
    ) is not None:
        return f"{text} Type: {typed(again)}"
    if code == BAD_FILE and missing and (found := _nearest(missing[0])) is not None:
        again = [found if arg == missing[0] else arg for arg in args]
        return f"{text} Did you mean {found}? Type: {typed(again)}"
    if "baqueano " in text:
        return text
    if code == USAGE:
        return f"{text} All options: {typed([*args[: 2 if args[:1] in GROUPS else 1], '--help'])}"
    if not missing:
        return f"{text} When it is mended, again: {typed(args)}"
    if "is no run" in text:
        return f"{text} All that there are: {typed(['runs', 'ls'])}"
    return f"{text} {_in_place_of(Path(missing[0]))}" if Path(missing[0]).suffix else text


def _put_right(meant: str, args: list[str], named: list[str]) -> list[str] | None:
    """The command with what was meant in the place of what is nearest to it; None where nothing is near."""
    near = [(*_likest(_name(arg), meant), k) for k, arg in enumerate(args) if arg in named]
    likeness, old, k = max(near, default=(0.0, "", 0))
    if not LIKE < likeness < 1.0:
        return None
    return [*args[:k], args[k].replace(old, meant, 1), *args[k + 1 :]]


def _likest(name: str, meant: str) -> tuple[float, str]:
    """How like it is to what was meant, and what of it: of file.py:Class the one side or the other."""
    sides = [name] if ":" in meant else name.split(":")
    return max((difflib.SequenceMatcher(None, side, meant).ratio(), side) for side in sides)


def _name(arg: str) -> str:
    """The name in KEY=VALUE."""
    return arg.partition("=")[0]


def _named(name: str, text: str) -> bool:
    """Does the text speak of it, as a word of its own?"""
    return bool(re.search(rf"(?<![\w./-]){re.escape(name)}(?![\w/-])", text))


def _quoted(name: str, text: str) -> bool:
    return f"'{name}'" in text or f'"{name}"' in text


def _nearest(missing: str) -> str | None:
    """The file whose path is most like this one."""
    path = Path(missing)
    near = difflib.get_close_matches(path.name, _files(path.parent), n=1, cutoff=NEAR)
    return str(path.parent / near[0]) if near else None


def _in_place_of(path: Path) -> str:
    """What is there of the kind of a path that is not."""
    alike = [name for name in _files(path.parent) if Path(name).suffix == path.suffix]
    where = f"In {path.parent.resolve().name}"
    if not alike:
        return f"{where} is no file *{path.suffix}. Give the path of one in its place."
    more = f" and {len(alike) - SHOWN} more" if len(alike) > SHOWN else ""
    return f"{where} there are {', '.join(alike[:SHOWN])}{more}. Give the path of one in its place."


def _files(folder: Path) -> list[str]:
    return sorted(p.name for p in folder.glob("*") if p.is_file() and not p.name.startswith("."))


def sentence(text: str) -> str:
    """The text, with an end."""
    return text if text.endswith((".", "?", "!", ")")) else f"{text}."


def typed(args: list[str]) -> str:
    """A command as one types it in this system's shell."""
    return (
        subprocess.list2cmdline(["baqueano", *args]) if os.name == "nt" else shlex.join(["baqueano", *args])
    )
