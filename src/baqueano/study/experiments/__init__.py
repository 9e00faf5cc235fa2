"""`baqueano study experiments`: compare a designed experiment with four signals in the same room.

The drive is planned with a file of the garage. Robots and cars of truth/, with independent
physics, drive it. Their parameters in the file are uniform within ± SPREAD of the file's
values; all others have the tolerances of real parts. The criterion is the Cramér-Rao bound of
that physics (identification/bound.py), as a geometric mean over the parameters of

    standard error / value                                                                                (1)

IMU biases and all other free parameters of a fit are also estimated, with priors (drives.py). A body is outside if it
passes a wall in one of the DRIVES of a vehicle. Each of these drives is on another disturbing floor. All signals are
within the file's limits, and the same function `contain` keeps them in the room.
"""

from functools import partial
from typing import Any

from baqueano.messages.language import translate as _
from baqueano.routes.room import vehicle_room
from baqueano.study.experiments.drives import plan_signals, signal_outcome, vehicles_around
from baqueano.study.experiments.result import Experiments, SignalErrors, experiment_rows, merge
from baqueano.sweep.workers import run_in_processes
from baqueano.vehicle_file import load

ROOMS = (("small", "2x2", 7), ("small", "3x3", 6), ("car", "4x4", 7))  # file, room, vehicles


def experiments(
    seed: int = 0, duration_s: float = 60.0, processes: int = 1, backend: str = "auto",
    progress: Any = lambda text: None,
) -> Experiments:  # fmt: skip
    """Return the table over the vehicles of ROOMS, with a last row for all of them."""
    rows, all_figures = [], {}
    for name, size, count in ROOMS:
        progress(_("{name}: {count} vehicles in {size} m", name=name, count=count, size=size))
        draws = errors_around_file(name, size, count, seed, duration_s, processes, backend)
        rows += experiment_rows(name, size, draws)
        for signal, part in draws.items():
            all_figures.setdefault(signal, []).append(part)
    merged_figures = {signal: merge(parts) for signal, parts in all_figures.items()}
    return Experiments((*rows, *experiment_rows("all", "", merged_figures)), duration_s)


def errors_around_file(
    name: str, size: str, count: int, seed: int, duration_s: float, processes: int, backend: str
) -> dict[str, SignalErrors]:
    """Return signal → errors and margins on `count` vehicles around the file."""
    vehicle_file = load(name)
    room, vehicles = vehicle_room(vehicle_file, size), vehicles_around(vehicle_file, count, seed)
    signal_plans = plan_signals(vehicle_file, room, count, seed, duration_s, backend)
    work = partial(signal_outcome, vehicles=vehicles, name=name, room=room, seed=seed)
    draws = dict(run_in_processes(work, list(signal_plans.items()), processes))
    if len(draws) < len(signal_plans):
        raise KeyboardInterrupt
    return {signal: draws[signal] for signal in signal_plans}
