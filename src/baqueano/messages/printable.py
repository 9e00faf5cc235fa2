"""Quote commands for a shell, and make texts of a robot or a file safe for a terminal with codes such as \\x1b.

A control character (C0, C1, DEL) can move the cursor, overwrite lines, rename the window, or type instead of the user.
A mark of direction reverses characters (bidi). A line separator begins a new line.
"""

import os
import re
import shlex
import unicodedata
from collections.abc import Iterable
from typing import Any


def baqueano_command(*words: object) -> str:
    """Return a baqueano command with these arguments, quoted for the shell of this machine.

    >>> baqueano_command("runs", "show", "my runs/0001.mcap")
    "baqueano runs show 'my runs/0001.mcap'"
    """
    return shell_command("baqueano", *words)


def shell_command(*words: object) -> str:
    """Return a command of these words, quoted for the shell of this machine.

    >>> shell_command("cd", "my lab")
    "cd 'my lab'"
    """
    line = list(map(str, words))
    return " ".join(map(_quote_powershell, line)) if os.name == "nt" else shlex.join(line)


def _quote_powershell(word: str) -> str:
    """Return a word quoted for PowerShell, with quotes that cmd.exe also accepts if possible."""
    if re.fullmatch(r"[\w./\\:=+-]+", word):
        return word
    if not re.search(r'["$`“”„]', word):
        return f'"{word}"'
    return "'" + re.sub(r"(['‘’‚‛])", r"\1\1", word) + "'"  # nothing in single quotes has a meaning


def printable(text: str) -> str:
    r"""Return a text in which codes replace all characters that do not print, except newline and tab.

    >>> printable("safe \x1b[2J \u202e gnp.exe")
    'safe \\x1b[2J \\u202e gnp.exe'
    """
    if text.isprintable():
        return text
    return "".join(
        c
        if c in "\n\t" or c.isprintable() or unicodedata.category(c) == "Zs"
        else c.encode("unicode_escape").decode()
        for c in text
    )


def one_line(text: str) -> str:
    r"""Return a printable text of one line, with spaces for newlines and tabs.

    >>> one_line("READY\nbaqueano: all is well")
    'READY baqueano: all is well'
    """
    return printable(text).replace("\n", " ").replace("\t", " ")


def join_rows(rows: Iterable[str]) -> str:
    """Return the rows of a table as text, each in exactly one line."""
    return "\n".join(map(one_line, rows))


def printable_json(content: object) -> Any:
    """Return a value decoded from JSON, with all its texts and keys converted by `one_line`."""
    if isinstance(content, str):
        return one_line(content)
    if isinstance(content, dict):
        return {one_line(key): printable_json(value) for key, value in content.items()}
    return [printable_json(value) for value in content] if isinstance(content, list) else content
