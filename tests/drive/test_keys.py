"""Driving by keys, without a terminal."""

import numpy as np
import pytest

from baqueano.drive.keys import HOLD_S, Keyboard, open_terminal, split_keys
from baqueano.errors import UsageError

LIMIT = np.array([1.0, 0.0, 0.8])


class Fingers:
    def __init__(self):
        self.keys, self.t_s = [], 0.0

    def read(self):
        keys, self.keys = self.keys, []
        return keys

    def now(self):
        return self.t_s


def keyboard():
    fingers = Fingers()
    return fingers, Keyboard(LIMIT, share=0.5, read=fingers.read, now=fingers.now)


def test_what_a_terminal_sends_is_split_into_keys():
    assert split_keys("wA\x1b[A\x1b[Dq ") == ["w", "a", "\x1b[A", "\x1b[D", "q", " "]


def test_a_key_counts_for_a_while_and_then_falls_back_to_zero():
    fingers, hand = keyboard()
    assert np.array_equal(hand(), np.zeros(3))
    fingers.keys = ["w", "\x1b[D"]
    np.testing.assert_allclose(hand(), [0.5, 0.0, 0.4])
    fingers.t_s = HOLD_S - 0.01
    np.testing.assert_allclose(hand(), [0.5, 0.0, 0.4])
    fingers.t_s = HOLD_S + 0.01
    assert np.array_equal(hand(), np.zeros(3))


def test_opposite_keys_cancel_and_space_stops_at_once():
    fingers, hand = keyboard()
    fingers.keys = ["w", "s", "d"]
    np.testing.assert_allclose(hand(), [0.0, 0.0, -0.4])
    fingers.keys = ["w", " "]
    assert np.array_equal(hand(), np.zeros(3))


def test_q_ends_the_drive():
    fingers, hand = keyboard()
    fingers.keys = ["q"]
    with pytest.raises(KeyboardInterrupt):
        hand()


def test_without_a_terminal_it_says_so(monkeypatch):
    with open(__file__, encoding="utf-8") as file:
        monkeypatch.setattr("sys.stdin", file)
        with pytest.raises(UsageError, match="needs a terminal"):
            open_terminal()


def test_without_termios_it_says_what_to_do(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "termios", None)
    with pytest.raises(UsageError, match="give the drive as a list of commands"):
        open_terminal()
