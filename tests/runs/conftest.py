"""A small run with everything in it, and small files to import."""

import numpy as np
import pytest

from baqueano.runs import Channel, EstimateLog, Event, ReferenceLog, Run, TruthLog

VEHICLE = 'format = 1\nname = "pequeño"\n\n[sensors.imu]\nkind = "imu"\n'


def _make_run(N=200, n=3, seed=0, start_ns=1_700_000_000_123_456_789):
    random = np.random.default_rng(seed)
    draw = random.normal
    t_ns = start_ns + 10_000_000 * np.arange(N) + random.integers(0, 999, N)
    slow = t_ns[::5]
    innovation = draw(size=(N, 3))
    innovation[::7] = np.nan
    events = (Event(int(t_ns[3]), "warning", "supervisor", "1.2 m/s > 1.0 m/s, ñandú"),) if N > 3 else ()
    return Run(
        name="0001-test",
        path=None,
        t_ns=t_ns,
        applied=draw(size=(N, n)),
        requested=draw(size=(N, n)) * 1e300,
        sensors={
            "imu": Channel(t_ns - 1234, t_ns, draw(size=(N, 3))),
            "odometer": Channel(slow - 7_000_000, slow, draw(size=(len(slow), 1)) * 5e-324),
        },
        estimate=EstimateLog(
            t_ns,
            draw(size=(N, 3)),
            draw(size=(N, 3)),
            draw(size=(N, 6, 6)),
            innovation,
            draw(size=(N, 3, 3)),
        ),
        reference=ReferenceLog(t_ns, draw(size=(N, 3)), draw(size=(N, 3)), np.zeros(N)),
        truth=TruthLog(t_ns, draw(size=(N, 3)), draw(size=(N, 3)), np.full((N, 3), np.nan)),
        events=events,
        vehicle_text=VEHICLE,
        metadata={"seed": "7", "kind": "experiment", "ñandú": "sí"},
        sent=-draw(size=(N, n)),
    )


@pytest.fixture
def make_run():
    return _make_run


@pytest.fixture
def run():
    return _make_run()
