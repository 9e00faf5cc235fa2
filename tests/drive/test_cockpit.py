"""A driver at a simulated terminal that is made of lists, with a simulated clock."""

import math
from contextlib import contextmanager

import numpy as np
import pytest

from baqueano.diagnostics import StopReason, stop
from baqueano.drive.manual.cockpit import RELEASES_OFF, RELEASES_ON, Cockpit
from baqueano.drive.manual.keys import KITTY, PRESS, QUERY_ANSWER, RELEASE, KeyEvent
from baqueano.drive.manual.terminal_heartbeat import MAX_SILENCE_S, QUERY
from baqueano.vehicles import Drivetrain

LIMIT = np.array([1.0, 0.0, 0.8])


class Terminal:
    """A terminal that answers after `trip_s` while it is `there`."""

    def __init__(self, *, kitty=False, answers=True, trip_s=0.02):
        self.kitty, self.can_answer, self.trip_s = kitty, answers, trip_s
        self.t_s, self.there, self.ended, self.closed = 0.0, True, False, False
        self.coming, self.sent, self.changes = [], b"", []

    def now(self):
        return self.t_s

    def sleep(self, seconds):
        self.t_s += seconds

    def type(self, *keys, kind=PRESS):
        self.coming += [(self.t_s, KeyEvent(kind, key)) for key in keys]

    def read(self):
        if self.ended:
            return None
        ready = [event for due, event in self.coming if due <= self.t_s]
        self.coming = [(due, event) for due, event in self.coming if due > self.t_s]
        return ready

    def write(self, data):
        self.sent += data
        if self.there and self.can_answer:
            due = self.t_s + self.trip_s
            self.coming += [(due, KeyEvent(KITTY))] * (self.kitty and b"\x1b[?u" in data)
            self.coming += [(due, KeyEvent(QUERY_ANSWER))] * data.count(QUERY)

    def set_mode(self, on, hidden):
        self.changes.append((on, hidden))

    def size(self):
        return 80, 24

    def close(self):
        self.closed = True


@contextmanager
def cockpit(terminal, **options):
    """Yield the terminal and the cockpit at it."""
    with Cockpit(LIMIT, terminal, now=terminal.now, sleep=terminal.sleep, **options) as hand:
        yield terminal, hand


def wait(hand, terminal, seconds):
    """Return the last command after this duration of driving."""
    u = hand()
    for _ in range(round(100 * seconds)):
        terminal.t_s += 0.01
        u = hand()
    return u


def test_keys_command_only_a_share_of_the_limit():
    with cockpit(Terminal(kitty=True), command_share=0.5) as (terminal, hand):
        assert (RELEASES_ON, RELEASES_OFF) in terminal.changes
        terminal.type("w", "a")
        np.testing.assert_allclose(wait(hand, terminal, 3.0), [0.5, 0.0, 0.4])
        terminal.type("+")
        terminal.type("a", kind=RELEASE)
        np.testing.assert_allclose(hand(), [0.6, 0.0, 0.0])
        terminal.type("x")
        assert np.array_equal(hand(), np.zeros(3))
    assert terminal.closed


def test_a_terminal_that_stops_answering_stops_the_vehicle_within_its_time():
    with cockpit(Terminal(kitty=True)) as (terminal, hand):
        terminal.type("w")
        assert wait(hand, terminal, 2.0)[0] > 0.0
        terminal.there = False
        gone_s = terminal.t_s
        while hand()[0] > 0.0:
            terminal.t_s += 0.01
        assert MAX_SILENCE_S - 0.1 < terminal.t_s - gone_s < MAX_SILENCE_S + terminal.trip_s + 0.02
        assert hand.stop_reason(0).code == StopReason.TERMINAL_SILENT
        assert [word["type"] for word in hand.pop_messages()] == ["stop"]
        assert hand.pop_messages() == []
        terminal.there = True
        terminal.type("w")
        assert np.array_equal(wait(hand, terminal, 1.0), np.zeros(3))


def test_a_pause_of_the_program_is_not_mistaken_for_a_dead_terminal():
    with cockpit(Terminal(kitty=True)) as (terminal, hand):
        wait(hand, terminal, 1.0)
        terminal.t_s += 5.0
        wait(hand, terminal, 1.0)
        assert hand.stop_reason(0) is None
        assert hand.status.terminal_ms < 40.0


def test_a_dead_terminal_ends_a_latched_set_point_too():
    with cockpit(Terminal(), latched=True) as (terminal, hand):
        terminal.type("w", "w")
        assert wait(hand, terminal, 5.0)[0] == pytest.approx(0.1)
        terminal.there = False
        assert np.array_equal(wait(hand, terminal, 0.5), np.zeros(3))


def test_a_silent_terminal_drives_only_during_each_key_press():
    terminal = Terminal()
    terminal.there = False
    with cockpit(terminal, latched=True) as (_, hand):
        assert "does not confirm that it is active" in hand.status.message
        assert (RELEASES_ON, RELEASES_OFF) not in terminal.changes
        terminal.type("w")
        assert wait(hand, terminal, 0.2)[0] > 0.0
        assert np.array_equal(wait(hand, terminal, 0.6), np.zeros(3))
        terminal.type("l", "w")
        assert np.array_equal(wait(hand, terminal, 2.0), np.zeros(3))
        assert hand.stop_reason(0) is None


def test_a_terminal_behind_another_program_receives_no_query():
    with cockpit(Terminal(kitty=True), has_heartbeat=False, latched=True) as (terminal, hand):
        wait(hand, terminal, 1.0)
        assert QUERY not in terminal.sent
        assert hand.status.key_mode.startswith("hold to drive, press briefly")


def test_a_closed_terminal_stops_the_vehicle_at_once():
    with cockpit(Terminal(kitty=True)) as (terminal, hand):
        terminal.type("w")
        assert hand()[0] > 0.0
        terminal.ended = True
        assert np.array_equal(hand(), np.zeros(3))
        assert hand.stop_reason(0).code == StopReason.TERMINAL_CLOSED


def test_the_space_bar_latches_a_stop_and_q_ends_the_drive():
    with cockpit(Terminal(kitty=True)) as (terminal, hand):
        terminal.type("w", " ")
        assert np.array_equal(hand(), np.zeros(3))
        assert hand.pop_messages() == [{"type": "stop", "reason": stop(StopReason.DRIVER)}]
        terminal.type("w", "q")
        assert np.array_equal(hand(), np.zeros(3))
        with pytest.raises(KeyboardInterrupt):
            hand()


def test_a_slow_connection_limits_the_speed():
    with cockpit(Terminal(kitty=True, trip_s=0.1), command_share=1.0) as (terminal, hand):
        hand.show({"link_ms": 60.0})
        terminal.type("w")
        assert wait(hand, terminal, 1.0)[0] == pytest.approx(80.0 / 160.0, rel=0.15)
        assert b"slowed to 5" in terminal.sent


def test_marks_are_counted_for_real_and_simulated_vehicles():
    with cockpit(Terminal()) as (terminal, hand):
        terminal.type("m", "m")
        hand()
        assert hand.pop_messages() == [{"type": "mark"}] * 2
        assert hand.pop_messages() == []
        assert hand.pop_mark_count() == 2
        assert hand.pop_mark_count() == 0


def test_the_state_of_a_vehicle_is_shown():
    with cockpit(Terminal()) as (terminal, hand):
        hand.show(
            {"state": "MANUAL", "battery_v": 7.4, "u": [0.1, 0.0, 0.2], "link_ms": 12.0, "speed_m_s": None}
        )
        wait(hand, terminal, 0.2)
        assert b"MANUAL" in terminal.sent
        assert b"7.40 V" in terminal.sent
        assert b"vehicle 12 ms" in terminal.sent
        assert math.isnan(hand.status.speed_m_s)


def test_a_sensor_that_is_degraded_is_shown_until_it_agrees_again():
    with cockpit(Terminal()) as (terminal, hand):
        hand.show({"degraded": "DEGRADED: imu[2] is stuck at 0.1"})
        wait(hand, terminal, 0.2)
        assert b"DEGRADED: imu[2] is stuck at 0.1" in terminal.sent
        terminal.sent = b""
        hand.show({"degraded": ""})
        wait(hand, terminal, 0.2)
        assert b"DEGRADED" not in terminal.sent


def test_the_heading_controller_output_is_displayed():
    with cockpit(Terminal(kitty=True), hold=True) as (terminal, hand):
        terminal.type("w")
        wait(hand, terminal, 0.2)
        hand.show({"u": [0.5, 0.0, 0.03], "requested": [0.5, 0.0, 0.04]})
        wait(hand, terminal, 0.2)
        assert b"heading hold +0.04" in terminal.sent
        terminal.type("a")
        wait(hand, terminal, 0.1)
        hand.show({"u": [0.5, 0.0, 0.4], "requested": [0.5, 0.0, 0.4]})
        terminal.sent = b""
        wait(hand, terminal, 0.2)
        assert b"heading free" in terminal.sent
        assert b"heading hold" not in terminal.sent


def test_a_missing_heading_controller_is_displayed():
    with cockpit(Terminal(kitty=True)) as (terminal, hand):
        terminal.type("w")
        wait(hand, terminal, 0.2)
        hand.show({"u": [0.5, 0.0, 0.03]})
        wait(hand, terminal, 0.2)
        assert b"heading not corrected" in terminal.sent


MOTORS = Drivetrain(
    "two_wheels", dead_zone_forward=np.array([0.14, 0.2]), dead_zone_backward=np.array([0.3, 0.3])
)


def test_a_set_point_below_the_dead_zone_is_reported_until_motion_begins():
    with cockpit(Terminal(), latched=True, command_share=0.4, drivetrain=MOTORS) as (terminal, hand):
        hand()
        assert hand.status.standstill_reason == "", "no motion is commanded"
        terminal.type("w", "w")
        assert wait(hand, terminal, 1.0)[0] == pytest.approx(0.08)
        message = "0.08 is below the dead zone of 0.14: nothing moves; that key again, or +"
        assert hand.status.standstill_reason == message
        assert message.encode() in terminal.sent, "the warning must fit its line"
        terminal.type("w", "w")
        assert wait(hand, terminal, 1.0)[0] == pytest.approx(0.16)
        assert hand.status.standstill_reason == "", "the left wheel turns"
        terminal.type("s", "s", "s", "s", "s", "s")
        wait(hand, terminal, 1.0)
        assert hand.status.standstill_reason.startswith("0.08 is below the dead zone of 0.30"), "backwards"
        terminal.type("x")
        terminal.sent = b""
        wait(hand, terminal, 1.0)
        assert b"dead zone" not in terminal.sent


def test_the_dead_zone_warning_in_a_turn_depends_on_the_wheel_commands():
    with cockpit(Terminal(kitty=True), command_share=0.2, drivetrain=MOTORS) as (terminal, hand):
        terminal.type("a")
        assert wait(hand, terminal, 1.0)[2] == pytest.approx(0.16)
        assert hand.status.standstill_reason == "0.16 is below the dead zone of 0.20: nothing moves; press +"
        terminal.type("d", kind=PRESS)
        terminal.type("a", kind=RELEASE)
        wait(hand, terminal, 1.0)
        assert hand.status.standstill_reason == "", "in a right turn the left wheel moves forward"


def test_a_short_key_press_gives_no_dead_zone_warning():
    with cockpit(Terminal(), command_share=0.4, drivetrain=MOTORS) as (terminal, hand):
        terminal.type("w")
        assert wait(hand, terminal, 0.1)[0] == pytest.approx(0.12)
        assert hand.status.standstill_reason == ""
        terminal.type("l", "w")
        wait(hand, terminal, 0.2)
        assert "dead zone" in hand.status.standstill_reason
        terminal.type(" ")
        terminal.sent = b""
        wait(hand, terminal, 0.2)
        assert b"stopped by the driver" in terminal.sent
        assert b"dead zone" not in terminal.sent


@pytest.mark.parametrize("drivetrain", [None, Drivetrain()])
def test_a_vehicle_without_a_dead_zone_gives_no_warning(drivetrain):
    with cockpit(Terminal(), latched=True, drivetrain=drivetrain) as (terminal, hand):
        terminal.type("w")
        assert wait(hand, terminal, 1.0)[0] == pytest.approx(0.05)
        assert hand.status.standstill_reason == ""


def test_the_terminal_is_restored_after_an_exception():
    terminal = Terminal()
    with pytest.raises(ZeroDivisionError), cockpit(terminal):
        raise ZeroDivisionError
    assert terminal.closed
