"""The duration for which a key press commands the vehicle."""

from itertools import pairwise

import numpy as np
import pytest

from baqueano.drive.manual.key_hold import (
    FIRST_S,
    GAP_S,
    LATCHED,
    NUDGE_SHARE,
    RELEASES,
    REPEATS,
    SPEED_STEP,
    KeyHold,
)
from baqueano.drive.manual.keys import LEFT_WINDOW, PRESS, RELEASE, KeyEvent


def press(keys, key, t_s):
    keys.on_key(KeyEvent(PRESS, key), t_s)


def hold(keys, key, from_s, to_s, delay_s=0.5, gap_s=0.033, jitter=lambda: 0.0):
    """Send the letters of a held key."""
    press(keys, key, from_s + jitter())
    t_s = from_s + delay_s
    while t_s < to_s:
        press(keys, key, t_s + jitter())
        t_s += gap_s


def test_a_key_with_release_events_counts_as_pressed_until_its_release():
    keys = KeyHold(RELEASES)
    press(keys, "w", 0.0)
    assert keys.direction(0.0) == (1.0, 0.0)
    assert keys.direction(60.0) == (1.0, 0.0)
    press(keys, "left", 60.0)
    assert keys.direction(60.0) == (1.0, 1.0)
    keys.on_key(KeyEvent(RELEASE, "w"), 61.0)
    assert keys.direction(61.0) == (0.0, 1.0)


def test_keys_are_released_when_the_window_loses_focus():
    keys = KeyHold(RELEASES)
    press(keys, "w", 0.0)
    keys.on_key(KeyEvent(LEFT_WINDOW), 1.0)
    assert keys.direction(1.0) == (0.0, 0.0)


def test_a_short_key_press_gives_a_short_command():
    keys = KeyHold(REPEATS)
    press(keys, "w", 0.0)
    assert keys.direction(0.1) == (NUDGE_SHARE, 0.0)
    assert keys.direction(FIRST_S + 0.001) == (0.0, 0.0)


def test_a_repeating_key_gives_the_full_command_until_its_last_repeat():
    keys = KeyHold(REPEATS)
    press(keys, "w", 0.0)
    press(keys, "w", 0.5)
    assert keys.direction(0.5) == (1.0, 0.0)
    assert keys.direction(0.5 + GAP_S - 0.001) == (1.0, 0.0)
    assert keys.direction(0.5 + GAP_S + 0.001) == (0.0, 0.0)


def test_delay_and_repeat_gap_of_the_keyboard_are_measured():
    keys = KeyHold(REPEATS)
    for k in range(4):
        hold(keys, "w", 3.0 * k, 3.0 * k + 1.5, delay_s=0.25, gap_s=0.05)
    assert keys.press_validity_s == pytest.approx(0.375)
    assert keys.repeat_validity_s == pytest.approx(0.15)
    slow = KeyHold(REPEATS)
    hold(slow, "w", 0.0, 3.0, gap_s=0.15)
    assert slow.repeat_validity_s == pytest.approx(0.35)


def test_two_quick_key_presses_are_not_a_repeat_delay():
    keys = KeyHold(REPEATS)
    for k in range(10):
        press(keys, "w", 2.0 * k)
        press(keys, "w", 2.0 * k + 0.2)
    assert keys.press_validity_s == FIRST_S


@pytest.mark.parametrize("delay_s", [0.25, 0.5, 0.66])
@pytest.mark.parametrize("rate_hz", [20.0, 33.0])
def test_a_pressed_key_over_wi_fi_is_not_interrupted(delay_s, rate_hz):
    dice = np.random.default_rng(7)
    breaks = 0
    for _ in range(100):
        keys = KeyHold(REPEATS)
        sends_s = [0.0, *np.arange(delay_s, 2.0, 1.0 / rate_hz)]
        arrivals = np.maximum.accumulate(np.array(sends_s) + dice.exponential(0.015, len(sends_s)))
        at_end = False
        for before, after in pairwise(arrivals):
            press(keys, "w", before)
            at_end = at_end or keys.direction(after - 1e-6) == (0.0, 0.0)
        breaks += at_end
    assert breaks <= 2


def test_two_pressed_keys_end_together_after_the_last_repeat():
    keys = KeyHold(REPEATS)
    hold(keys, "w", 0.0, 1.0)
    hold(keys, "a", 1.0, 2.0)
    assert keys.direction(2.0) == (1.0, 1.0)
    assert keys.direction(2.3) == (0.0, 0.0)


def test_the_opposite_key_replaces_the_pressed_key():
    keys = KeyHold(REPEATS)
    hold(keys, "w", 0.0, 1.0)
    press(keys, "s", 1.0)
    assert keys.direction(1.0) == (-NUDGE_SHARE, 0.0)


def test_in_latched_mode_key_presses_change_a_lasting_set_point():
    keys = KeyHold(LATCHED)
    for _ in range(3):
        press(keys, "up", 0.0)
    press(keys, "7", 0.0)
    assert keys.direction(100.0) == pytest.approx((4 * SPEED_STEP, SPEED_STEP))
    for _ in range(30):
        press(keys, "up", 0.0)
    assert keys.direction(0.0)[0] == 1.0
    press(keys, "x", 0.0)
    assert keys.direction(0.0) == (0.0, 0.0)
