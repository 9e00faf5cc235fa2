"""Words on a terminal: lines to type, and words of a robot or a file, in which codes show what does not print, \\x1b.

A control character moves the cursor, writes over lines that stand, renames the window, answers in the name of the
user (C0, C1, DEL); a mark of direction turns letters round (bidi); a line separator begins a line.
"""

import os
import re
import shlex
import unicodedata
from collections.abc import Iterable
from typing import Any


def typed(*words: object) -> str:
    """Return a command of baqueano as one types it.

    >>> typed("runs", "show", "my runs/0001.mcap")
    "baqueano runs show 'my runs/0001.mcap'"
    """
    return quoted("baqueano", *words)


def quoted(*words: object) -> str:
    """Return words as the shell of this machine takes them.

    >>> quoted("cd", "my lab")
    "cd 'my lab'"
    """
    line = list(map(str, words))
    return " ".join(map(_for_powershell, line)) if os.name == "nt" else shlex.join(line)


def _for_powershell(word: str) -> str:
    """Return a word as PowerShell takes it; one that needs quotes gets those that cmd.exe takes too, if it can."""
    if re.fullmatch(r"[\w./\\:=+-]+", word):
        return word
    if not re.search(r'["$`“”„]', word):
        return f'"{word}"'
    return "'" + re.sub(r"(['‘’‚‛])", r"\1\1", word) + "'"  # nothing in single quotes has a meaning


def printable(text: str) -> str:
    r"""Return a text of several lines with a code for each character that does not print, but for newline and tab.

    >>> printable("safe \x1b[2J \u202e gnp.exe")
    'safe \\x1b[2J \\u202e gnp.exe'
    """
    if text.isprintable():
        return text
    return "".join(c if c in "\n\t" or _letter(c) else c.encode("unicode_escape").decode() for c in text)


def one_line(text: str) -> str:
    r"""Return a printable text of one line: a space stands for a newline and for a tab.

    >>> one_line("READY\nbaqueano: all is well")
    'READY baqueano: all is well'
    """
    return printable(text).replace("\n", " ").replace("\t", " ")


def in_lines(rows: Iterable[str]) -> str:
    """Return the rows of a table, each in a line of its own and no more."""
    return "\n".join(map(one_line, rows))


def words(decoded: object) -> Any:
    """Return what was decoded from JSON with every text in it, and every key, as `one_line` has it."""
    if isinstance(decoded, str):
        return one_line(decoded)
    if isinstance(decoded, dict):
        return {one_line(key): words(value) for key, value in decoded.items()}
    return [words(value) for value in decoded] if isinstance(decoded, list) else decoded


def _letter(c: str) -> bool:
    return c.isprintable() or unicodedata.category(c) == "Zs"
