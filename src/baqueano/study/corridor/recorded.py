"""Windows of recordings: the pose is known at the start of each window, and the corridor is checked at its end.

    calibrated      the gyro scale by the camera in the run of the fit, known to 1 %
    raw             the gyro scale by the chip's data sheet, known to 3 %
    odometer        calibrated, and an odometer whose scale is by the same camera

A vehicle file is fitted to one recording and checked on another one, in both directions. The filter runs through the
whole recording. At the end of each window only its pose is reset: it keeps its estimates of speed and biases.
"""

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np

from baqueano.calibration.against_truth import calibrate
from baqueano.contracts.values import JsonObject, Tree
from baqueano.diagnostics import Verdict
from baqueano.geometry import wrap
from baqueano.messages.language import translate as _
from baqueano.runs import Run
from baqueano.runs.filter_ticks import example_filter_tick, make_ticks
from baqueano.runs.initial_pose import initial_pose
from baqueano.runs.interpolation import interpolate_poses
from baqueano.signals import Tick
from baqueano.study.corridor.result import Instant
from baqueano.study.estimation.errors import WINDOWS_S
from baqueano.study.estimation.evaluation import fit_subject
from baqueano.study.estimation.subjects import BOTH, IMU, SUBJECTS, Subject, missing_files
from baqueano.study.recordings import exclusion_sentence
from baqueano.symbolic import scan
from baqueano.vehicle_file import VehicleFile

GYRO_SCALE_PATH = "sensors.imu.gyro_scale"
SENSOR_SETS = {"calibrated": IMU, "raw": IMU, "odometer": BOTH}
CASES = ("cpm", "dart")
SCALE_STD = {"calibrated": 0.01, "raw": 0.03, "odometer": 0.01}  # deviation of the scale of the gyro
BIAS_STD_PATH, BIAS_STD = "sensors.imu.gyro_bias_std", 0.002  # rad/s
MAX_TICKS = 1_000_000


def recording_instants(
    backend: str = "auto", progress: Callable[[str], object] = lambda text: None
) -> tuple[list[tuple[str, Instant]], list[str]]:
    """Return (name, instant) at the end of each window, such as "10 s, raw", and a note on each skipped recording."""
    instants, notes = [], []
    for case in CASES:
        if files := missing_files(case):
            notes.append(exclusion_sentence(case, files))
            continue
        for subject in SUBJECTS[case][0]():
            for name, sensors in SENSOR_SETS.items():
                progress(f"{subject.name}, {name}")
                calibrated_subject = subject._replace(vehicle_file=calibrated_file(subject, name))
                fit, vehicle_file = fit_subject(calibrated_subject, sensors, backend)
                if fit.verdict == Verdict.REFUSED:
                    notes.append(_("{name}, {name2}: its fit is refused", name=subject.name, name2=name))
                    continue
                for window_s in WINDOWS_S:
                    ends = window_instants(vehicle_file, subject.test_run, window_s, backend)
                    instants += [(f"{window_s:g} s, {name}", instant) for instant in ends]
    return instants, notes


def window_instants(
    vehicle_file: VehicleFile, run: Run, window_s: float, backend: str = "auto"
) -> list[Instant]:
    """Return error and covariance of the filter of `vehicle_file` at the end of each window with known poses at both
    ends."""
    ekf, truth = vehicle_file.estimator(), run.truth
    assert truth is not None
    ticks = make_ticks(run, ekf, MAX_TICKS)
    start = initial_pose(run)
    carry = ekf.init(*(start[k : k + 3] for k in range(0, len(start), 3)))

    def step(belief: Tree, tick: Tick) -> tuple[Any, Any]:
        belief, estimate = ekf.row(belief, tick)
        return belief, (estimate.eta, estimate.cov[:3, :3])

    kernel = scan(step, carry, example_filter_tick(ekf), backend=backend)
    t_ns = np.asarray(ticks.t_ns)
    eta = interpolate_poses(t_ns, truth.t_ns, truth.eta)
    edges = np.searchsorted(t_ns, t_ns[0] + np.arange(0.0, (t_ns[-1] - t_ns[0]) * 1e-9, window_s) * 1e9)
    instants = []
    for a, b in pairwise(edges.tolist()):
        carry, (mean, cov) = kernel.run(_rows(ticks, a, b), carry=carry)
        error = mean[-1] - eta[b - 1]
        error[2] = wrap(error[2])
        if (a == 0 or np.isfinite(eta[a - 1]).all()) and np.isfinite(eta[b - 1]).all():
            instants.append(
                Instant(error, cov[-1])
            )  # with a covariance that is not finite, the vehicle is lost
        if np.isfinite(eta[b - 1]).all():
            carry = _belief_at(carry, eta[b - 1])
    return instants


def _belief_at(belief: Tree, eta: np.ndarray) -> Any:
    """Return the belief with its pose set to the known pose `eta` (3,)."""
    mean, cov = np.array(belief.mean), np.array(belief.cov)
    mean[:3], cov[:3, :], cov[:, :3] = eta, 0.0, 0.0
    cov[:3, :3] = 1e-8 * np.eye(3)
    return belief._replace(mean=mean, cov=cov)


def _rows(ticks: Any, a: int, b: int) -> Any:
    """Return ticks a … b − 1 of a tree whose leaves have N as first axis."""
    if isinstance(ticks, tuple):
        rows = [_rows(leaf, a, b) for leaf in ticks]
        return tuple(rows) if type(ticks) is tuple else type(ticks)(*rows)
    return ticks[a:b]


def calibrated_file(subject: Subject, name: str) -> VehicleFile:
    """Return the initial file of the fit, with the sensor scales of the set `name` ("raw": the scale 1).

    It states BIAS_STD: the runs of cpm contain no rest, and by the camera the bias of the file is correct to 0.001.
    """
    values: JsonObject = {
        GYRO_SCALE_PATH: 1.0,
        f"{GYRO_SCALE_PATH}_std": SCALE_STD[name],
        BIAS_STD_PATH: BIAS_STD,
    }
    if name != "raw":
        scales = {
            figure.name: figure.value for figure in calibrate(subject.fit_run, subject.vehicle_file).numbers
        }
        values |= {path: value for path, value in scales.items() if path.endswith("scale")}
    return subject.vehicle_file.with_values(values)
