"""Fit, replay on another run, and compare with the truth: one subject, one set of sensors, several estimators."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from baqueano.compare.consistency import Band, band
from baqueano.compare.filter_consistency import FilterConsistency, filter_consistency
from baqueano.drive import drive_stop_reason, replay
from baqueano.identify import Fit, FitOptions, identify
from baqueano.identify.noise.covariances import measure_noise
from baqueano.messages import text
from baqueano.runs.initial_pose import initial_pose
from baqueano.runs.interpolation import true_speed
from baqueano.study.estimation.errors import BlockSums, EstimatedPath, block_errors
from baqueano.study.estimation.references import dead_reckoning, open_loop
from baqueano.study.estimation.subjects import SENSOR_SETS, Subject, with_sensors
from baqueano.vehicle_file import VehicleFile
from baqueano.vehicle_file.build import DEFAULT_KINDS


class EstimateEvaluation(NamedTuple):
    """The evaluation of an estimator on a run."""

    recording: str
    sensors: str
    estimator: str
    errors: dict[str, BlockSums]
    consistency: FilterConsistency
    nees_speed: Band
    fit: str  # the verdict of its fit
    stop_reason: str  # of the replay, "" if it did not stop


def evaluate(
    subject: Subject, sensors: str, kinds: Sequence[str] = (), backend: str = "auto"
) -> list[EstimateEvaluation]:
    """Return the evaluation of each estimator of `kinds` on the run of the subject. Without `kinds`, evaluate the
    estimator of its file.
    """
    fit, vehicle_file = fit_subject(subject, sensors, backend)
    run = subject.test_run
    assert run.truth is not None
    start = initial_pose(run)
    nu = open_loop(vehicle_file, run, start, backend)
    reference = EstimatedPath(dead_reckoning(vehicle_file, run, nu, start), nu[:, 0])
    run_evaluations = []
    for kind in kinds or (vehicle_file.data["estimator"].get("kind", DEFAULT_KINDS["estimator"]),):
        replay_run = replay(run, vehicle_file, estimator=kind, backend=backend)
        log = replay_run.estimate
        assert log is not None
        rows = np.searchsorted(log.t_ns, run.t_ns)
        estimate = EstimatedPath(log.eta[rows], log.nu[rows, 0])
        errors = block_errors(run.t_ns, estimate, reference, run.truth)
        speed = (estimate.speed - true_speed(run.t_ns, run.truth)) / np.sqrt(log.cov[rows, 3, 3])
        consistency = filter_consistency(replay_run), band(speed[:, None])
        names = f"{subject.name}, {sensors}", sensors, kind
        stop_reason = text(drive_stop_reason(replay_run))
        run_evaluations.append(EstimateEvaluation(*names, errors, *consistency, fit.verdict, stop_reason))
    return run_evaluations


def fit_subject(subject: Subject, sensors: str, backend: str = "auto") -> tuple[Fit, VehicleFile]:
    """Return the fit, and the file that `baqueano identify RUN --update` writes unless the fit is refused."""
    fit = identify(
        subject.fit_run,
        with_sensors(subject.vehicle_file, SENSOR_SETS[sensors]),
        subject.free,
        options=FitOptions(backend=backend),
    )
    noise = measure_noise(fit, subject.fit_run, backend=backend)
    return fit, noise.updated_file(fit.vehicle_file, subject.fit_run.name)
