"""Convert the bytes of a vehicle file to text and tables, with a line number for every key.

A byte order mark, which some editors write, is removed. A file in UTF-16 or another encoding is refused, with a remedy
in the message. A file above the limits of 64 KiB or 16 levels is also refused.
"""

import re
import tomllib
from pathlib import Path
from typing import Any

from baqueano.contracts.values import JsonObject
from baqueano.diagnostics import Diagnostic, fault
from baqueano.errors import FileError

MAX_BYTES = 64 * 1024  # bytes
MAX_DEPTH = 16  # nested tables
FORMER_KEYS = {  # kind of a block → key in older files → its present name
    "beacon": {"above_m": "height_m", "farthest_m": "max_range_m"},
    "rangefinder": {"farthest_m": "max_range_m"},
    "stanley": {"soft_m_s": "softening_speed_m_s", "steepest_rad": "max_steering_rad"},
}
_DOTS = re.compile(r"""[\w"'.\- \t]+""")
_HEADER = re.compile(r"^\s*\[\[?\s*([^\[\]]+?)\s*\]\]?\s*(#.*)?$")
_KEY = re.compile(r"""^\s*((?:[\w-]+|"[^"]*"|'[^']*')(?:\s*\.\s*(?:[\w-]+|"[^"]*"|'[^']*'))*)\s*=""")
_PART = re.compile(r"""[\w-]+|"[^"]*"|'[^']*'""")


def read_text(path: Path) -> str:
    """Return the text of the file at `path`. Raise FileError if it cannot be read or is too large."""
    try:
        size = path.stat().st_size
        content = path.read_bytes() if size <= MAX_BYTES else b""
    except OSError as error:
        raise FileError.of("toml.not-read", path=path, error=error.strerror or error) from error
    if size > MAX_BYTES:
        raise FileError.of("toml.too-large", file=path.name, size=size, largest=MAX_BYTES)
    return decode(content, path.name)


def decode(content: bytes, name: str) -> str:
    """Return the text of UTF-8 bytes without a byte order mark. Raise FileError for other bytes or an empty file."""
    if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raise FileError.of("toml.utf-16", file=name)
    if b"\0" in content:
        raise FileError.of("toml.zero-bytes", file=name)
    content = content.removeprefix(b"\xef\xbb\xbf")
    try:
        text = content.decode("utf-8")
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise FileError.of("toml.not-utf-8", file=name, line=line, byte=content[error.start]) from error
    if not text.strip():
        raise FileError.of("toml.empty", "baqueano new mylab", file=name)
    return text


def tables(text: str, name: str) -> JsonObject:
    """Return the tables of the text. Raise FileError, with the line of the fault, if it is not TOML."""
    try:
        return parse_toml(text, name)
    except tomllib.TOMLDecodeError as error:
        raise FileError(_syntax_error(str(error), text, name)) from error


def with_present_keys(text: str, name: str) -> str:
    """Return the text with the present names of the keys that older files of our blocks contain.

    >>> with_present_keys('[controller]\\nkind = "stanley"\\nsteepest_rad = 0.5', "lab.toml")
    '[controller]\\nkind = "stanley"\\nmax_steering_rad = 0.5'
    """
    if not any(key in text for keys in FORMER_KEYS.values() for key in keys):
        return text
    data = tables(text, name)
    sensors = data.get("sensors", {})
    sources = ({"controller": data.get("controller")}, sensors if isinstance(sensors, dict) else {})
    for source in sources:
        for table_name, table in source.items():
            if not isinstance(table, dict):
                continue
            keys = FORMER_KEYS.get(str(table.get("kind", table_name)), {})
            for former_key in keys.keys() & table.keys():
                text = re.sub(rf"\b{former_key}\b", keys[former_key], text)
    return text


def parse_toml(text: str, name: str) -> JsonObject:
    """Return the tables of the text. Raise FileError for a text above the limits.
    Raise TOMLDecodeError if the text is not TOML.
    """
    _refuse_long_keys(text, name)
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        raise
    except (RecursionError, MemoryError) as error:
        raise FileError.of("toml.too-deep", file=name, maximum=MAX_DEPTH) from error
    except ValueError as error:  # a number of thousands of digits
        raise FileError.of("toml.number", file=name, error=error) from error
    if _depth(data) > MAX_DEPTH:
        raise FileError.of("toml.too-deep", file=name, maximum=MAX_DEPTH)
    return data


def key_line(text: str, path: tuple[str, ...]) -> int | None:
    """Return the line number, from 1, of the key or table `path`; None if it is not found."""
    table: tuple[str, ...] = ()
    for line_number, line in enumerate(text.splitlines(), 1):
        if header := _HEADER.match(line):
            table = _key_parts(header[1])
            if table == path:
                return line_number
        elif (key := _KEY.match(line)) and table + _key_parts(key[1]) == path:
            return line_number
    return None


def _key_parts(dotted_key: str) -> tuple[str, ...]:
    return tuple(part.strip("\"'") for part in _PART.findall(dotted_key))


def _refuse_long_keys(text: str, name: str) -> None:
    """Raise FileError for a key with many parts, because a key with thousands of parts takes seconds to read."""
    for line_number, line in enumerate(text.splitlines(), 1):
        runs = _DOTS.findall(line.split("#")[0]) if line.count(".") > 2 * MAX_DEPTH else []
        if any(run.count(".") > 2 * MAX_DEPTH for run in runs):
            raise FileError.of("toml.long-key", file=name, line=line_number, maximum=2 * MAX_DEPTH)


def _depth(value: object) -> int:
    """Return the number of levels of tables and lists, counted without recursion."""
    max_level, level = 0, [value]
    while level:
        max_level += 1
        children = [v.values() if isinstance(v, dict) else v for v in level if isinstance(v, dict | list)]
        level = [x for values in children for x in values if isinstance(x, dict | list)]
    return max_level


def _syntax_error(cause: str, text: str, name: str) -> Diagnostic:
    """Return the error of tomllib, with the line and the usual remedy."""
    match = re.search(r"\(at line (\d+), column \d+\)", cause)
    lines = text.splitlines()
    line_number = int(match[1]) if match else len(lines)
    line = lines[line_number - 1].strip() if 0 < line_number <= len(lines) else ""
    problem = re.sub(r"\s*\(at .*\)$", "", cause)
    figures: dict[str, Any] = {"file": name, "line": line_number, "value": repr(line[:80])}
    if re.search(r"=\s*[-+]?\d+,\d", line):
        corrected_line = re.sub(r"(\d),(\d)", r"\1.\2", line)
        return fault("toml.decimal-comma", decimal_reading=corrected_line, **figures)
    if re.search(r"=\s*\[.*\d,\d", line):
        return fault("toml.decimal-commas", error=problem[:1].lower() + problem[1:], **figures)
    if "overwrite" in problem or "twice" in problem or "mutate" in problem or "already" in problem:
        return fault("toml.twice", **figures)
    if re.search(r"=\s*[A-Za-z]", line):
        return fault("toml.no-quotes", **figures)
    return fault("toml.syntax", error=problem[:1].lower() + problem[1:], **figures)
