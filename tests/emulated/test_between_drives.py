"""What a drive leaves behind is taken away before the next one, and what is said between two drives is not lost.

On the real firmware and the real drivers in lock-step.
"""

import pytest

from baqueano.robot.states import State
from baqueano.runs import RunWriter
from tests.emulated.drives import drive, looked, spin


@pytest.fixture
def closing(monkeypatch):
    """`closing(act)`: calls `act` before a run is closed."""

    def begin(act):
        close = RunWriter.close
        monkeypatch.setattr(RunWriter, "close", lambda writer: (act(), close(writer))[1])

    return begin


def test_a_run_that_is_closed_for_longer_than_the_dead_man_waits_leaves_no_trouble(service, robot, closing):
    troubles = []
    closing(lambda: (robot.wait(0.5), troubles.append(robot.uno.trouble)))
    done, run = drive(service, spin())
    assert (done["why"], troubles) == ("", [""])
    assert not [e.text for e in run.events if "heard no command" in e.text]
    looked(service, robot, 5)
    assert (service.machine.state, service.machine.why) == (State.READY, "")
