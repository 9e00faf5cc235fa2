"""A game pad, whose file is a pipe."""

import contextlib
import os

import pytest

from baqueano.drive.pad import AHEAD_AXIS, AT_START, AXIS, BUTTON, EVENT, HOLD_TO_RUN, REST, TURN_AXIS, Pad
from baqueano.errors import UsageError
from tests.drive.test_cockpit import Terminal, cockpit


@pytest.fixture
def plugged(tmp_path):
    """(pad, its end of the pipe)."""
    if not hasattr(os, "mkfifo"):
        pytest.skip("no pipes in files here, and no /dev/input either")
    path = tmp_path / "js0"
    os.mkfifo(path)
    pad = Pad(path)
    end = os.open(path, os.O_WRONLY)
    yield pad, end
    with contextlib.suppress(OSError):  # a cockpit closes its own
        pad.close()


def event(value, kind, number):
    return EVENT.pack(0, value, kind, number)


def test_it_drives_only_while_the_button_is_held(plugged):
    pad, end = plugged
    os.write(end, event(-32767, AXIS, AHEAD_AXIS) + event(32767, AXIS, TURN_AXIS))
    assert pad.read() == []
    assert pad.wanted() == (0.0, 0.0)
    os.write(end, event(1, BUTTON, HOLD_TO_RUN[0]))
    assert pad.read() == [HOLD_TO_RUN[0]]
    assert pad.wanted() == (1.0, -1.0)
    os.write(end, event(0, BUTTON, HOLD_TO_RUN[0]))
    pad.read()
    assert pad.wanted() == (0.0, 0.0)
    os.close(end)


def test_a_stick_near_its_middle_rests(plugged):
    pad, end = plugged
    os.write(end, event(1, BUTTON, HOLD_TO_RUN[1]) + event(round(32767 * REST * 0.9), AXIS, AHEAD_AXIS))
    pad.read()
    assert pad.wanted() == (0.0, 0.0)
    os.close(end)


def test_an_event_may_come_in_two_pieces_and_the_state_at_the_start_presses_nothing(plugged):
    pad, end = plugged
    data = event(1, BUTTON | AT_START, 0) + event(1, BUTTON, 1)
    os.write(end, data[:11])
    assert pad.read() == []
    os.write(end, data[11:])
    assert pad.read() == [1]
    os.close(end)


def test_a_pad_that_is_unplugged_is_gone_for_good(plugged):
    pad, end = plugged
    os.write(end, event(1, BUTTON, HOLD_TO_RUN[0]) + event(-32767, AXIS, AHEAD_AXIS))
    pad.read()
    assert not pad.gone
    os.close(end)
    pad.read()
    assert pad.gone
    assert pad.wanted() == (0.0, 0.0)


def test_no_pad_is_said_with_what_to_do(tmp_path):
    with pytest.raises(UsageError, match="no game pad"):
        Pad(tmp_path / "js0")


def test_in_a_cockpit_the_pad_drives_and_its_plug_stops_the_vehicle(plugged):
    pad, end = plugged
    terminal = Terminal()
    with cockpit(terminal, share=1.0, pad=pad) as hand:
        os.write(
            end, event(-32767, AXIS, AHEAD_AXIS) + event(1, BUTTON, HOLD_TO_RUN[0]) + event(1, BUTTON, 0)
        )
        assert hand().tolist() == [1.0, 0.0, 0.0]
        assert hand.marked() == 1
        os.close(end)
        assert hand().tolist() == [0.0, 0.0, 0.0]
        assert "unplugged" in hand.why(0)
