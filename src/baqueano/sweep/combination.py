"""Do one drive with one combination of blocks: simulate the vehicle of the file, or replay a recorded run."""

from typing import NamedTuple

import numpy as np

from baqueano.contracts.blocks import OwnBlock
from baqueano.contracts.names import GAINS_CHOICES
from baqueano.diagnostics import Diagnostic
from baqueano.drive import drive_stop_reason, repeat, replay
from baqueano.errors import SafetyStop
from baqueano.geometry import compose
from baqueano.guides.route import Route
from baqueano.runs.run import Run
from baqueano.sweep.error_segments import ErrorSegments
from baqueano.sweep.figures import drive_figures
from baqueano.sweep.gains import ControllerGains, FileText, build_controller
from baqueano.sweep.result import SweepCombination, SweepDrive


class SweepBlocks(NamedTuple):
    """The blocks that replace the file's blocks; None keeps the file's block."""

    estimator: OwnBlock | None = None
    controller: OwnBlock | None = None
    guide: OwnBlock | None = None


class SweepSettings(NamedTuple):
    """The settings that all drives share."""

    laps: int = 1
    # initial pose of the vehicle, relative to the route's first pose
    start: tuple[float, float, float] = 0.0, 0.0, 0.0
    alignment: str = "none"
    interval_s: float = 1.0
    backend: str = "auto"
    gains: str = GAINS_CHOICES[0]


class SweepJob(NamedTuple):
    """A drive or replay to be done."""

    combination: SweepCombination
    drive: str  # its name: vehicle, route and seed, or the run
    file_text: FileText
    blocks: SweepBlocks
    settings: SweepSettings
    route: Route | None = None
    seed: int = 0
    run: Run | None = None  # the run to replay, or None for a simulation
    gains: ControllerGains = ControllerGains()
    vehicle: str = ""  # the names of vehicle and route
    route_name: str = ""


def drive_job(job: SweepJob) -> SweepDrive:
    """Do the drive or the replay of a job, and return its results."""
    try:
        run = _replay(job) if job.run is not None else _drive(job)
    except SafetyStop as error:  # before its first tick
        return _drive_result(job, {}, {}, error.diagnostic)
    s, reason = job.settings, drive_stop_reason(run)
    return _drive_result(job, *drive_figures(run, s.laps, s.alignment, s.interval_s), reason)


def _drive_result(
    job: SweepJob, figures: dict[str, float], pieces: dict[str, ErrorSegments], stop_reason: Diagnostic | None
) -> SweepDrive:
    code = "" if stop_reason is None else stop_reason.code
    return SweepDrive(
        job.combination, job.drive, figures, pieces, code, stop_reason,
        vehicle=job.vehicle, route=job.route_name, gains=job.gains.source,
    )  # fmt: skip


def _drive(job: SweepJob) -> Run:
    assert job.route is not None
    start = compose(job.route.eta[0], np.array(job.settings.start))
    # only the blocks are compared
    no_safeguards = {"check": False, "lead_in": False, "caution": False, "patience_s": np.inf, "rest_s": 0.0}
    vehicle_file, blocks = job.file_text.parse(), job.blocks
    if job.gains.file is not None:
        blocks = blocks._replace(controller=build_controller(vehicle_file, job.gains))
    return repeat(
        vehicle_file, job.route, job.settings.laps, **blocks._asdict(), eta=start, seed=job.seed,
        backend=job.settings.backend, **no_safeguards,
    )  # fmt: skip


def _replay(job: SweepJob) -> Run:
    assert job.run is not None
    return replay(
        job.run, job.file_text.parse(), estimator=job.blocks.estimator, backend=job.settings.backend
    )


def drive_row(drive: SweepDrive) -> dict[str, object]:
    """Return a drive as a dict for JSON, without rounding."""
    return {
        "figures": drive.figures,
        "stop_reason": None if drive.stop_reason is None else drive.stop_reason.to_json(),
        "pieces": {name: list(pieces) for name, pieces in drive.pieces.items()},
    }  # fmt: skip


def drive_from_row(job: SweepJob, row: dict) -> SweepDrive:
    """Return the drive of a job from its stored row."""
    pieces = {
        name: ErrorSegments(tuple(squares), tuple(samples), *durations)
        for name, (squares, samples, *durations) in row["pieces"].items()
    }
    stop_reason = None if (reason := row["stop_reason"]) is None else Diagnostic.from_json(reason)
    return _drive_result(job, row["figures"], pieces, stop_reason)
