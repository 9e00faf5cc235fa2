"""`baqueano study corridor`: check that the corridor of the filter contains the vehicle.

Vehicles of the independent truth are identified from commands and IMU only.
They follow a sinuous circle, an eight or a rectangle at 0.2 m/s for a minute, with the recommended filter.
The module vehicles.py lists their differences from the files.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

from baqueano.messages.language import translate as _
from baqueano.study.corridor.drives import CorridorDrive, drive_batch
from baqueano.study.corridor.recorded import recording_instants
from baqueano.study.corridor.result import INSTANTS_S, Corridors, Instant, drive_corridors
from baqueano.sweep.workers import run_in_batches

VEHICLE_BATCH = 10  # vehicles that are simulated together


def corridor(
    vehicles: int = 100,
    first: int = 0,
    processes: int = 1,
    backend: str = "auto",
    advance: Callable[[int], None] = lambda k: None,
) -> Corridors:
    """Return the corridors of vehicles `first` … `first + vehicles − 1`. `advance` is called with the number of
    vehicles that have just finished.
    """
    work, seeds = partial(drive_batch, backend=backend), range(first, first + vehicles)
    results = run_in_batches(work, seeds, VEHICLE_BATCH, processes, advance)
    drives = sorted((d for batch_drives, _ in results for d in batch_drives), key=lambda d: d.seed)
    return evaluate_corridors(drives, sorted(seed for _, refusals in results for seed in refusals))


def with_recordings(
    corridors: Corridors, backend: str = "auto", progress: Callable[[str], object] = lambda text: None
) -> Corridors:
    """Return the corridors of the vehicles with the corridors of windows of recordings added."""
    ends, notes = recording_instants(backend, progress)
    windows = drive_corridors(ends, 0, ())
    lost_cases = corridors.lost | windows.lost
    return replace(corridors, windows=windows.instants, lost=lost_cases, notes=(*corridors.notes, *notes))


def evaluate_corridors(drives: list[CorridorDrive], refused_seeds: list[int]) -> Corridors:
    """Return the corridors of drives, at the times INSTANTS_S and at the end of each lap."""
    labelled_instants = [(f"{t:g} s", _instant(d, t)) for t in INSTANTS_S for d in drives if d.t_s[-1] >= t]
    laps = max((int(d.t_s[-1] / d.lap_s) for d in drives), default=0)
    labelled_instants += [
        (_("lap {k}", k=k), _instant(d, k * d.lap_s))
        for k in range(1, laps + 1)
        for d in drives
        if d.t_s[-1] >= k * d.lap_s
    ]
    return drive_corridors(labelled_instants, len(drives), refused_seeds)


def _instant(drive: CorridorDrive, t_s: float) -> Instant:
    k = int(abs(drive.t_s - t_s).argmin())
    return Instant(drive.error[k], drive.cov[k])
