"""Damage to bytes and texts, all of it from one random generator: the same number gives the same input."""

import random
import re
from collections.abc import Callable

_NUMBER, _WORD = re.compile(r"[\d.+-]+"), re.compile(r"[^\W\d]+")
EXTREME = (0, 1, 0x7F, 0x80, 0xFF, 0xFFFF, 2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1, 2**63, 2**64 - 1)
NUMBERS = (
    "nan", "inf", "-inf", "1e999", "-1e999", "1e-320", "-0.0", "0", "-1", "1", "9" * 30, "9" * 400, "0x1F", "1_000",
    "1,5", "0.1.2", "+", "", "true", "٣", "1e", "5e-324", "1.7976931348623157e308",
)  # fmt: skip
VALUES = (
    *NUMBERS, '""', '"x"', "[]", "{}", "[[]]", "[1.0]", "[1.0, 2.0, 3.0]", "[nan, nan, nan]", '["a", "b"]',
    "[[1.0, 2.0], [3.0]]", "{a = 1}", "2026-11-21", '"~/x.py:X"', '"/x.py:X"', '"x.py"', '"\\u0000"', "'''", '"""', 
    "null",
    "{}}", "[" * 50, '"' + "x" * 300 + '"',
)  # fmt: skip
LETTERS = (
    "\0",
    "\ufeff",
    "\u202e",
    "ñ",
    "😀",
    "\ud7ff",
    "\x1b",
    "\r",
    "\t",
    '"',
    "'",
    "#",
    "=",
    "[",
    "]",
    "{",
    "}",
    ",",
    ";",
    "\\",
)


def damaged_bytes(original: bytes, draw: random.Random, originals: tuple[bytes, ...] = ()) -> bytes:
    """Return the bytes after one to four damages."""
    data = bytearray(original)
    for _ in range(draw.choice((1, 1, 1, 2, 3, 4))):
        _BYTES[draw.randrange(len(_BYTES))](data, draw)
    if originals and draw.random() < 0.05:  # two files joined in the middle
        second, index = draw.choice(originals), draw.randrange(len(data) + 1)
        data[index:] = second[draw.randrange(len(second)) :]
    return bytes(data)


def damaged_text(original: str, draw: random.Random, separators: str = "\n") -> str:
    """Return the text after one to four damages of its lines, values and letters."""
    text = original
    for _ in range(draw.choice((1, 1, 2, 2, 3, 4))):
        text = _TEXTS[draw.randrange(len(_TEXTS))](text, draw, separators)
    return text


def _place(data: bytearray, draw: random.Random) -> tuple[int, int]:
    index = draw.randrange(len(data) + 1)
    return index, min(len(data), index + draw.choice((1, 1, 2, 4, 8, 30, 300)))


def _flip(data: bytearray, draw: random.Random) -> None:
    if data:
        data[draw.randrange(len(data))] ^= 1 << draw.randrange(8)


def _overwrite(data: bytearray, draw: random.Random) -> None:
    begin, end = _place(data, draw)
    data[begin:end] = draw.randbytes(end - begin)


def _zero(data: bytearray, draw: random.Random) -> None:
    begin, end = _place(data, draw)
    data[begin:end] = bytes(end - begin)


def _extreme(data: bytearray, draw: random.Random) -> None:
    size, index = draw.choice((1, 2, 4, 8)), draw.randrange(len(data) + 1)
    value = draw.choice(EXTREME) & (2 ** (8 * size) - 1)
    data[index : index + size] = value.to_bytes(size, "little")


def _remove(data: bytearray, draw: random.Random) -> None:
    begin, end = _place(data, draw)
    del data[begin:end]


def _repeat(data: bytearray, draw: random.Random) -> None:
    begin, end = _place(data, draw)
    data[begin:begin] = data[begin:end] * draw.choice((1, 2, 5))


def _insert(data: bytearray, draw: random.Random) -> None:
    begin, end = _place(data, draw)
    data[begin:begin] = draw.randbytes(end - begin)


def _cut(data: bytearray, draw: random.Random) -> None:
    del data[draw.randrange(len(data) + 1) :]


_BYTES: list[Callable[[bytearray, random.Random], None]] = [
    _flip, _flip, _overwrite, _zero, _extreme, _extreme, _remove, _repeat, _insert, _cut,
]  # fmt: skip


def _lines(text: str, draw: random.Random, end: str) -> str:
    lines = text.split(end)
    k = draw.randrange(len(lines))
    match draw.randrange(5):
        case 0:
            del lines[k]
        case 1:
            lines.insert(k, lines[draw.randrange(len(lines))])
        case 2:
            m = draw.randrange(len(lines))
            lines[k], lines[m] = lines[m], lines[k]
        case 3:
            lines = lines[:k]
        case _:
            lines[k] = lines[k][: draw.randrange(len(lines[k]) + 1)]
    return end.join(lines)


def _number(text: str, draw: random.Random, end: str) -> str:
    pieces = [*_NUMBER.finditer(text)]
    if not pieces:
        return text
    begin, stop = draw.choice(pieces).span()
    return text[:begin] + draw.choice(NUMBERS) + text[stop:]


def _word(text: str, draw: random.Random, end: str) -> str:
    pieces = [*_WORD.finditer(text)]
    if not pieces:
        return text
    begin, stop = draw.choice(pieces).span()
    piece = draw.choice(pieces)[0]
    word = piece if draw.random() < 0.5 else text[begin : stop - 1]
    return text[:begin] + word + text[stop:]


def _value(text: str, draw: random.Random, end: str) -> str:
    lines = [k for k, line in enumerate(text.split("\n")) if "=" in line or ":" in line]
    if not lines:
        return text
    rows, k = text.split("\n"), draw.choice(lines)
    key = rows[k].partition("=")[0] if "=" in rows[k] else rows[k].partition(":")[0]
    rows[k] = f"{key}{'=' if '=' in rows[k] else ':'} {draw.choice(VALUES)}"
    return "\n".join(rows)


def _letter(text: str, draw: random.Random, end: str) -> str:
    index = draw.randrange(len(text) + 1)
    return text[:index] + draw.choice(LETTERS) + text[index + draw.randrange(2) :]


def _drop(text: str, draw: random.Random, end: str) -> str:
    index = draw.randrange(len(text) + 1)
    return text[:index] + text[index + draw.choice((1, 1, 3, 20)) :]


def _swap(text: str, draw: random.Random, end: str) -> str:
    a, b = draw.choice(
        ((",", ";"), (".", ","), ("\n", "\r\n"), ("\n", "\r"), ('"', "'"), (" ", "\t"), ("=", "=="))
    )
    return text.replace(a, b, draw.choice((1, -1)))


_TEXTS: list[Callable[[str, random.Random, str], str]] = [
    _lines, _number, _number, _word, _value, _value, _letter, _drop, _swap,
]  # fmt: skip
