"""Decode the bytes of a terminal into pressed, repeated and released keys, and into its answers.

  w, ESC [ A, ESC O A                     a key; a plain terminal does not mark repeats and releases         (1)
  ESC [ code ; modifiers : kind u         a key, if its kinds were requested (kitty's protocol)              (2)
  ESC [ 1 ; modifiers : kind A            an arrow in that protocol; kind 1 press, 2 repeat, 3 release       (3)
  ESC [ 0 n                               "ready", the answer to the query ESC [ 5 n                         (4)
  ESC [ ? flags u                         the terminal supports (2)                                          (5)
  ESC [ O                                 the window lost the keyboard focus, if that report was requested   (6)

Source: ECMA-48 for the form of a sequence and (4); the description of kitty's keyboard protocol for (2), (3), (5);
that of xterm for (6). The key of (2) is only the first code point, in lower case.
"""

import re
from typing import NamedTuple

PRESS, REPEAT, RELEASE = "press", "repeat", "release"
QUERY_ANSWER, KITTY, LEFT_WINDOW = "alive", "kitty", "left window"
EVENT_KINDS = {"": PRESS, "1": PRESS, "2": REPEAT, "3": RELEASE}
ARROW_KEYS = {"A": "up", "B": "down", "C": "right", "D": "left"}
KEYPAD = {57399 + digit: str(digit) for digit in range(10)} | {  # codes of (2) for the keys of a numeric keypad
    57412: "-", 57413: "+", 57415: "=", 57417: "left", 57418: "right", 57419: "up", 57420: "down",
}  # fmt: skip
CTRL_BIT = 4  # bit of the modifiers, which are sent plus one
INTERRUPT_KEY = "ctrl-c"
MAX_SEQUENCE_BYTES = 64  # maximum number of bytes of a sequence

_SEQUENCE = re.compile(r"\x1b(?:\[([<-?]?)([0-9;:]*)[ -/]*([@-~])|O([A-D]))")
_PREFIX = re.compile(r"\x1b(?:\[[0-?]*[ -/]*|O)?\Z")


class KeyEvent(NamedTuple):
    """An event: a key, an answer of the terminal, or the loss of the keyboard focus."""

    kind: str  # PRESS, REPEAT, RELEASE of a key; QUERY_ANSWER, KITTY, LEFT_WINDOW
    key: str = ""  # "w", "up", " ", "ctrl-c"


class KeyDecoder:
    """A decoder of bytes to events; a sequence can be divided between two calls."""

    def __init__(self) -> None:
        self._partial_text = ""

    def feed(self, data: bytes) -> list[KeyEvent]:
        """Return the events that these bytes complete. Unknown sequences are ignored."""
        text, self._partial_text = self._partial_text + data.decode("utf-8", errors="ignore"), ""
        events, position = [], 0
        while position < len(text):
            if match := _SEQUENCE.match(text, position):
                events += _sequence_events(*(part or "" for part in match.groups()))
                position = match.end()
            elif (partial_match := _PREFIX.match(text, position)) and len(
                partial_match[0]
            ) < MAX_SEQUENCE_BYTES:
                self._partial_text = partial_match[0]
                break
            else:
                events += _key_events(text[position])
                position += 1
        return events


def _sequence_events(
    private_letter: str, numbers: str, final_letter: str, application: str
) -> list[KeyEvent]:
    if application:
        return [KeyEvent(PRESS, ARROW_KEYS[application])]
    if private_letter == "?":
        return [KeyEvent(KITTY)] if final_letter == "u" else []
    if final_letter == "n":
        return [KeyEvent(QUERY_ANSWER)] if numbers == "0" else []
    if final_letter == "O" and not numbers:
        return [KeyEvent(LEFT_WINDOW)]
    code, _, modifier_field = numbers.partition(";")
    modifiers, _, kind = modifier_field.partition(";")[0].partition(":")
    if private_letter or kind not in EVENT_KINDS:
        return []
    if final_letter in ARROW_KEYS:
        return [KeyEvent(EVENT_KINDS[kind], ARROW_KEYS[final_letter])]
    letter = code.partition(":")[0]
    if final_letter != "u" or not letter or int(letter) > 0x10FFFF:
        return []
    key = KEYPAD.get(int(letter)) or chr(int(letter)).lower()
    modifier_bits = int(modifiers or 1) - 1
    return [KeyEvent(EVENT_KINDS[kind], INTERRUPT_KEY if modifier_bits & CTRL_BIT and key == "c" else key)]


def _key_events(letter: str) -> list[KeyEvent]:
    if letter == "\x03":
        return [KeyEvent(PRESS, INTERRUPT_KEY)]
    return [KeyEvent(PRESS, letter.lower())] if letter.isprintable() else []
