"""A STOP among five guests that flood the onboard service, until the motors of the emulated Uno are off.

Quiet and flooded rounds alternate, in the time of the Uno: a stall of the machine slows both.
"""

import sys
from contextlib import contextmanager
from statistics import median

import numpy as np
import pytest

from baqueano.door import VERSION
from baqueano.door.remote import connect
from baqueano.drive.mission import Mission, pack
from benchmarks.door import FLOODING, MOST_STOP_MS, flood
from benchmarks.processes import before_others
from tests.emulated.onboard import running
from tests.emulated.test_processes import PATIENCE_S, ready, wait

MOST_STALLED_MS = 500.0  # guaranteed even on a machine that stalls, by the firmware
pytestmark = [pytest.mark.skipif(sys.platform != "linux", reason="a pty, /proc"), pytest.mark.alone]
ROUNDS, SECONDS = 5, 20.0


@contextmanager
def moving(service):
    """A guest at the door of a moving vehicle; the drive is repeated if the machine stalls before."""
    experiment = Mission("experiment", u=np.tile([0.0, 0.0, 0.6], (round(SECONDS * service.file.rate_hz), 1)))
    mission, under_way = pack(experiment, service.file).to_json(), False
    for _ in range(5):
        with connect(str(service.door)) as remote:
            ready(remote)
            remote.send(type="mission", door=VERSION, mission=mission, attended=False)
            under_way = wait(service.live.moving, PATIENCE_S / 4.0)
            if under_way:
                yield remote
                return
            remote.send(type="stop", reason="it does not move")
    assert under_way


def off_ms(remote, live):
    """Return how long the motors turn on after a STOP, in the time of the Uno."""
    sent_s = live.now_s()
    remote.send(type="stop", reason="it nears the stairs")
    assert wait(lambda: not live.moving(), PATIENCE_S)
    with live.lock:
        return 1e3 * (live.uno.off_since() - sent_s)


def test_rt15_a_stop_turns_motors_off_within_50_ms_under_flooding(firmware, tmp_path):
    idle_times, loud = [], []
    with before_others(), running(firmware, tmp_path, environment={"BAQUEANO_BACKEND": "python"}) as service:
        for _ in range(ROUNDS):
            with moving(service) as remote:
                idle_times.append(off_ms(remote, service.live))
            with moving(service) as remote, flood(service.door, FLOODING):
                assert service.live.moving()
                loud.append(off_ms(remote, service.live))
    print(
        f"motors off after {median(idle_times):.0f} ms, {median(loud):.0f} ms flooded (at most {max(loud):.0f})"
    )
    increase = median(b - a for a, b in zip(idle_times, loud, strict=True))
    assert median(idle_times) + increase <= MOST_STOP_MS, (idle_times, loud)
    assert min(loud) <= MOST_STOP_MS, (idle_times, loud)
    assert max(loud) <= MOST_STALLED_MS, (idle_times, loud)
