"""The bytes of a terminal are decoded to key events."""

import random

import pytest

from baqueano.drive.manual.keys import (
    KITTY,
    LEFT_WINDOW,
    PRESS,
    QUERY_ANSWER,
    RELEASE,
    REPEAT,
    KeyDecoder,
    KeyEvent,
)


def events(data):
    return KeyDecoder().feed(data)


def press_events(*keys):
    return [KeyEvent(PRESS, key) for key in keys]


def test_letters_and_arrows_of_a_plain_terminal_are_read_as_key_presses():
    assert events(b"wA\x1b[A\x1bOD q") == press_events("w", "a", "up", "left", " ", "q")


@pytest.mark.parametrize(
    ("data", "event"),
    [
        (b"\x1b[119u", KeyEvent(PRESS, "w")),
        (b"\x1b[119;1:1u", KeyEvent(PRESS, "w")),
        (b"\x1b[119;1:2u", KeyEvent(REPEAT, "w")),
        (b"\x1b[119;1:3u", KeyEvent(RELEASE, "w")),
        (b"\x1b[119:87;2:3u", KeyEvent(RELEASE, "w")),
        (b"\x1b[87;2u", KeyEvent(PRESS, "w")),
        (b"\x1b[1;1:3A", KeyEvent(RELEASE, "up")),
        (b"\x1b[1;129:2D", KeyEvent(REPEAT, "left")),
        (b"\x1b[32u", KeyEvent(PRESS, " ")),
        (b"\x1b[57407;129:3u", KeyEvent(RELEASE, "8")),
        (b"\x1b[57419;1:2u", KeyEvent(REPEAT, "up")),
        (b"\x1b[57413u", KeyEvent(PRESS, "+")),
        (b"\x1b[99;5u", KeyEvent(PRESS, "ctrl-c")),
        (b"\x1b[99;5:3u", KeyEvent(RELEASE, "ctrl-c")),
        (b"\x03", KeyEvent(PRESS, "ctrl-c")),
        (b"\x1b[0n", KeyEvent(QUERY_ANSWER)),
        (b"\x1b[?11u", KeyEvent(KITTY)),
        (b"\x1b[O", KeyEvent(LEFT_WINDOW)),
    ],
)
def test_each_key_sequence_gives_its_event(data, event):
    assert events(data) == [event]


@pytest.mark.parametrize(
    "data",
    [b"\x1b[I", b"\x1b[3n", b"\x1b[?62;4c", b"\x1b[99999999999u", b"\x1b[;u", b"\x1b[5~", b"\x1b[119;1:9u", b"\0\x7f"],
)  # fmt: skip
def test_a_sequence_that_is_not_a_key_gives_no_event(data):
    assert events(data) == []


def test_a_key_sequence_split_at_any_byte_gives_the_same_events():
    data = b"w\x1b[119;1:3u\x1b[0n\x1bOA\x1b[B "
    expected = events(data)
    for cut in range(len(data)):
        decoder = KeyDecoder()
        assert decoder.feed(data[:cut]) + decoder.feed(data[cut:]) == expected


def test_a_stop_key_after_a_single_escape_is_received():
    decoder = KeyDecoder()
    assert decoder.feed(b"\x1b") == []
    assert decoder.feed(b" ") == press_events(" ")


def test_a_key_after_random_bytes_is_received():
    dice = random.Random(0)
    decoder = KeyDecoder()
    for _ in range(3000):
        decoder.feed(
            bytes(dice.choice(b"\x1b[O0123456789;:?u nA~\xff\xc3w") for _ in range(dice.randrange(9)))
        )
    decoder.feed(b"~~")
    assert decoder.feed(b"q") == press_events("q")


def test_an_endless_sequence_is_discarded():
    decoder = KeyDecoder()
    decoder.feed(b"\x1b[" + b"1" * 100)
    assert decoder.feed(b" ")[-1:] == press_events(" ")
