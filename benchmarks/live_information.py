"""Measure the cost to update the information of a drive: window by window, against the batch over the whole drive.

A page that shows how errors decrease requests F ten times a second. Each time, the batch costs as much as the whole
drive so far; a window always costs the same.
"""

import numpy as np

from baqueano.design.information import DriveInformation
from baqueano.design.live import WINDOW_TICKS, RecursiveInformation
from baqueano.identify import excitation
from baqueano.vehicle_file import load
from benchmarks.harness import Bench, Case, measured

SECONDS, SMALLEST_S = 60.0, 2.0
TIMES = 5.0  # a window must cost less than the batch over a minute by at least this


def benches(smallest: bool) -> list[Bench]:
    """Return the bench of a window against the batch, on the vehicle `small`."""
    file = load("small")
    u = excitation(
        "random_steps", file.command.limit, SMALLEST_S if smallest else SECONDS, file.rate_hz, seed=0
    )
    drive_information = DriveInformation(file)
    live = RecursiveInformation(drive_information)
    state = live.add(live.begin(), u[: 10 * WINDOW_TICKS])
    window = np.ascontiguousarray(u[:WINDOW_TICKS])
    return [
        measured(
            f"information after {len(u) / file.rate_hz:.0f} s of driving, brought up to date",
            [
                Case("one window of 10 ticks", lambda: live.add(state, window)),
                Case("the batch over all of it", lambda: drive_information.information(u)),
            ],
            targets={} if smallest else {"the batch over all of it": TIMES},
        )
    ]
