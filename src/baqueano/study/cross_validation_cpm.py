"""Cross-validate the model on recordings of a real 1:18 car (CPM Lab µCar), driven twice under an overhead camera.

A model is fitted to one run (throttle, servo → speed, yaw rate) and evaluated on the other one, in both directions:
    speed, yaw rate   the model from the commands only, from the first tick to the last, against the
                      odometer and the gyro of the run
    pose              the EKF with this model, IMU and odometer, from the camera's first pose on, against the
                      camera; the sensors on board do not measure a position

The table also shows the run that the model was fitted to. The scales of odometer and gyro, the gyro's bias and the
delay are not held out: the garage took them from these recordings. The package does not contain the recordings: they
are read from the folder BAQUEANO_DATA, else from ../shared/data.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from baqueano.compare import compare
from baqueano.contracts.values import JsonObject, TableRow
from baqueano.diagnostics import Verdict
from baqueano.drive import drive_stop_reason, replay
from baqueano.identify import Fit, FitOptions, identify
from baqueano.identify.data.record import FitRecord, make_record
from baqueano.identify.noise.covariances import Noise, measure_noise
from baqueano.messages import verdict_line
from baqueano.messages.language import mark as N_, number, shown_unit, translate as _
from baqueano.messages.text_table import text_table
from baqueano.runs import Run
from baqueano.runs.importing import import_run
from baqueano.signals import Motion
from baqueano.study.recorded.simulated import simulate_outputs
from baqueano.study.recordings import CPM_MAPS, check_cpm_present
from baqueano.vehicle_file import VehicleFile, load

SHORT_NAMES = {"cpm_run_a": "a", "cpm_run_b": "b"}
SENSORS_USED = ("odometer", "imu[2]")
MIN_EXPLAINED = 0.9  # part of the variance of speed and yaw rate, on a run that was not used for the fit
MAX_EXTRAPOLATION = 0.1  # of the range of a command: beyond it the model extrapolates
# of the distance driven: an estimate with a larger rms error has diverged from the car
MAX_POSITION_ERROR = 0.05
CAVEATS = (
    N_("The model is simulated from the commands alone, from the first tick to the last."),
    N_(
        "The scales of odometer and gyro, the gyro's bias and the delay are those of the garage; they were "
        "read from both recordings."
    ),
)


class RunPrediction(NamedTuple):
    """Speed and yaw rate of a run, predicted by a model from the commands only."""

    t_s: np.ndarray  # (N,)
    measured_values: np.ndarray  # (N, 2) odometer [m/s] and gyro [rad/s]; NaN without a reading
    model: np.ndarray  # (N, 2)

    @property
    def rmse(self) -> np.ndarray:
        """Return the rms error (2,) of speed [m/s] and yaw rate [rad/s]."""
        return np.sqrt(np.nanmean((self.measured_values - self.model) ** 2, axis=0))

    @property
    def explained_variance(self) -> np.ndarray:
        """Return the share (2,) of the variance of speed and yaw rate that the model explains: at most 1."""
        return 1.0 - self.rmse**2 / np.nanvar(self.measured_values, axis=0)


@dataclass(frozen=True)
class RunFit:
    """A fit to a run, the noise measured in the run, and the vehicle file with both."""

    fit: Fit
    noise: Noise
    vehicle_file: VehicleFile


@dataclass(frozen=True)
class RunEvaluation:
    """The evaluation of a model on a run."""

    fit_run: str
    test_run: str
    prediction: RunPrediction
    replay_run: Run
    figures: JsonObject  # values of `compare`
    distance_m: float  # distance measured by the camera

    @property
    def is_held_out(self) -> bool:
        """Return True if the model was not fitted to this run."""
        return self.fit_run != self.test_run

    @property
    def is_lost(self) -> bool:
        """Return True if the position error is at least MAX_POSITION_ERROR times the driven distance, or if the
        replay stopped.
        """
        return not self.figures["ate_m"] < MAX_POSITION_ERROR * self.distance_m or bool(
            drive_stop_reason(self.replay_run)
        )

    def row(self) -> JsonObject:
        """Return a flat row in SI units."""
        rmse = self.prediction.rmse
        explained_variance = self.prediction.explained_variance
        figures = self.figures
        row = {"fit_run": self.fit_run, "test_run": self.test_run, "is_held_out": self.is_held_out}
        row |= {"speed_rmse_m_s": float(rmse[0]), "speed_explained": float(explained_variance[0])}
        row |= {"yaw_rate_rmse_rad_s": float(rmse[1]), "yaw_rate_explained": float(explained_variance[1])}
        row |= {key: figures[key] for key in ("ate_m", "ate_heading_rad", "end_error_m")}
        row |= {key: figures[key] for key in ("rpe_m", "rpe_heading_rad")}
        row |= {
            "distance_m": self.distance_m,
            "duration_s": self.replay_run.duration_s,
            "is_lost": self.is_lost,
        }
        return row | {key: figures[key] for key in ("nees_pose", "nees_pose_verdict", "nis", "nis_verdict")}


@dataclass(frozen=True)
class CrossValidation:
    """The fits to both runs, and the evaluations in both directions."""

    fits: dict[str, RunFit]  # by run
    evaluations: tuple[RunEvaluation, ...]

    def rows(self) -> list[TableRow]:
        """Return a row per model and run."""
        return [run_evaluation.row() for run_evaluation in self.evaluations]

    def parameters(self) -> list[TableRow]:
        """Return a row per parameter: estimate and standard error of each run."""
        fits = {run: {row["name"]: row for row in run_fit.fit.rows()} for run, run_fit in self.fits.items()}
        rows = []
        for name, first in next(iter(fits.values())).items():
            row = {"name": name, "unit": first["unit"]}
            for run, parameters in fits.items():
                row |= {run: parameters[name]["estimate"], f"{run}_std": parameters[name]["std"]}
            rows.append(row)
        return rows

    def figures(self) -> list[dict[str, str]]:
        """Return a row of text per result, with a column for each pair of model and run."""
        rows = {
            _evaluation_title(run_evaluation): run_evaluation.row() for run_evaluation in self.evaluations
        }
        return [{"figure": label} | {head: cell(row) for head, row in rows.items()} for label, cell in _LINES]

    @property
    def notes(self) -> tuple[str, ...]:
        """Return a sentence for each command of a run that is clearly beyond the range in the run of the fit."""
        sentences, applied_commands = (
            [],
            {evaluation.test_run: evaluation.replay_run.applied_commands for evaluation in self.evaluations},
        )
        for run_evaluation in self.evaluations if len(applied_commands) > 1 else ():
            names = self.fits[run_evaluation.fit_run].vehicle_file.command.names
            for name, fit_commands, commands in zip(
                names,
                applied_commands[run_evaluation.fit_run].T,
                applied_commands[run_evaluation.test_run].T,
                strict=True,
            ):
                low = np.min(fit_commands)
                high = np.max(fit_commands)
                min_command = np.min(commands)
                max_command = np.max(commands)
                margin = MAX_EXTRAPOLATION * (high - low)
                if min_command < low - margin or max_command > high + margin:
                    sentences.append(
                        _(
                            "{head}: {name} from {least:.2f} to {most:.2f} leaves the range of the fit, "
                            "{low:.2f} to {high:.2f}",
                            head=_evaluation_title(run_evaluation),
                            name=name,
                            least=min_command,
                            most=max_command,
                            low=low,
                            high=high,
                        )
                    )
        return tuple(sentences)

    @property
    def reasons(self) -> tuple[str, ...]:
        """Return a sentence for each fit or evaluation that prevents the verdict USABLE."""
        reasons = [_("the fit on {run} is {verdict}", run=run, verdict=_(run_fit.fit.verdict)) 
               for run, run_fit in self.fits.items() if run_fit.fit.verdict != Verdict.USABLE]  # fmt: skip
        for run_evaluation in self.evaluations:
            run_text = _(
                "fitted on {fit_run}, tested on {test_run}",
                fit_run=run_evaluation.fit_run,
                test_run=run_evaluation.test_run,
            )
            if run_evaluation.is_lost:
                reasons.append(_("{where}: the estimate diverged from the car", where=run_text))
            if (
                run_evaluation.is_held_out
                and np.min(run_evaluation.prediction.explained_variance) < MIN_EXPLAINED
            ):
                reasons.append(
                    _(
                        "{where}: less than {explains:.0f} % of speed or yaw rate is explained",
                        where=run_text,
                        explains=100 * MIN_EXPLAINED,
                    )
                )
        significant = [
            _evaluation_title(run_evaluation)
            for run_evaluation in self.evaluations
            if run_evaluation.is_held_out and run_evaluation.figures["nees_pose_verdict"] == "too sure"
        ]
        reasons += (
            [_("the filter is overconfident about its pose ({sure})", sure=", ".join(significant))]
            if significant
            else []
        )
        return tuple(reasons)

    @property
    def verdict(self) -> Verdict:
        """Return REFUSED if a fit is refused or an estimate diverged, WARN with other reasons, else USABLE."""
        is_refused = any(run_fit.fit.verdict == Verdict.REFUSED for run_fit in self.fits.values())
        if is_refused or any(run_evaluation.is_lost for run_evaluation in self.evaluations):
            return Verdict.REFUSED
        return Verdict.WARN if self.reasons else Verdict.USABLE

    def table(self) -> str:
        """Return the parameters, the results and the verdict as a text table."""
        runs = list(self.fits)
        lines = text_table(
            f"<{'>' * len(runs)}<",
            [_("parameter"), *(_("fit on {run}", run=run) for run in runs), _("unit")],
            *(
                [row["name"].removeprefix("model."), *(_with_error(row[run], row[f"{run}_std"]) for run in runs),
                 shown_unit(row["unit"])]
                for row in self.parameters()
            ),
        )  # fmt: skip
        heads = [_evaluation_title(run_evaluation) for run_evaluation in self.evaluations]
        rows = ([_(row["figure"]), *(str(row[head]) for head in heads)] for row in self.figures())
        lines += ["", *text_table(f"<{'>' * len(heads)}", ["", *heads], *rows), "", *map(_, CAVEATS)]
        lines += [f"- {note}" for note in self.notes]
        return "\n".join([*lines, verdict_line(self.verdict, self.reasons, _("in both directions"))])


_LINES: tuple[tuple[str, Callable[[JsonObject], str]], ...] = (
    (N_("model, speed [m/s rms]"), lambda r: f"{number(r['speed_rmse_m_s']):.3f}"),
    (N_("  of its variance [%]"), lambda r: f"{number(100 * r['speed_explained']):.1f}"),
    (N_("model, yaw rate [rad/s rms]"), lambda r: f"{number(r['yaw_rate_rmse_rad_s']):.3f}"),
    (N_("  of its variance [%]"), lambda r: f"{number(100 * r['yaw_rate_explained']):.1f}"),
    (N_("driven [m]"), lambda r: f"{number(r['distance_m']):.1f}"),
    (N_("EKF, position [m rms]"), lambda r: f"{number(r['ate_m']):.3f}"),
    (N_("EKF, position at the end [m]"), lambda r: f"{number(r['end_error_m']):.3f}"),
    (N_("EKF, heading [° rms]"), lambda r: f"{number(np.degrees(r['ate_heading_rad'])):.2f}"),
    (N_("EKF, drift over 1 s [m rms]"), lambda r: f"{number(r['rpe_m']):.3f}"),
    (N_("NEES of the pose, 1 is ideal"), lambda r: f"{number(r['nees_pose']):.2f}"),
    (N_("NIS, 1 is ideal"), lambda r: f"{number(r['nis']):.2f}"),
)


def cross_validate(
    backend: str = "auto", progress: Callable[[str], object] = lambda text: None
) -> CrossValidation:
    """Fit the car to each run, and return the evaluation on both runs.

    Raise FileError with the names of missing files.
    """
    check_cpm_present()
    runs = {SHORT_NAMES[name]: import_run(name).run for name in CPM_MAPS}
    fits = {}
    for name, run in runs.items():
        progress(_("fitting run {name}, {duration_s:.0f} s", name=name, duration_s=run.duration_s))
        fits[name] = fit_car(run, backend)
    run_evaluations = []
    for name, run_fit in fits.items():
        for test_name, run in runs.items():
            progress(_("the model of run {name} on run {other}", name=name, other=test_name))
            run_evaluations.append(evaluate_on_run(run_fit.vehicle_file, name, run, test_name, backend))
    return CrossValidation(
        fits, tuple(sorted(run_evaluations, key=lambda evaluation: not evaluation.is_held_out))
    )


def fit_car(run: Run, backend: str = "auto") -> RunFit:
    """Return the garage's car fitted to a run by odometer and gyro, with the noise measured in the run."""
    fit = identify(run, load("car"), use=SENSORS_USED, options=FitOptions(backend=backend))
    noise = measure_noise(fit, run, backend=backend)
    return RunFit(fit, noise, noise.updated_file(fit.vehicle_file, run.name))


def evaluate_on_run(
    vehicle_file: VehicleFile, fit_run: str, run: Run, test_run: str, backend: str = "auto"
) -> RunEvaluation:
    """Return the evaluation of a vehicle file on a run: its model from the commands, its filter from the camera's
    first pose.
    """
    replay_run = replay(run, vehicle_file, backend=backend)
    figures = compare(replay_run, names=[test_run]).rows()[0]
    assert run.truth is not None
    driven_m = float(np.nansum(np.hypot(*np.diff(run.truth.eta[:, :2], axis=0).T)))
    return RunEvaluation(
        fit_run, test_run, predict_run(vehicle_file, run, backend), replay_run, figures, driven_m
    )


def predict_run(vehicle_file: VehicleFile, run: Run, backend: str = "auto") -> RunPrediction:
    """Return speed and yaw rate of the model of `vehicle_file` under the commands of `run`, from the first measured
    velocity.
    """
    odometer, imu, vehicle = vehicle_file.sensors.odometer, vehicle_file.sensors.imu, vehicle_file.vehicle
    record = make_record(run, {"odometer": odometer, "imu": imu})
    v = _first_measurement(record, "odometer", 0) / odometer.scale
    r = (_first_measurement(record, "imu", 2) - imu.gyro_bias) / imu.gyro_scale
    start = vehicle.init(nu=np.array([v, vehicle.rear_axle_m * r, r]))
    # a moving car has had a command before
    past_u = np.tile(record.u[0], (len(start.drivetrain.past_commands), 1))
    start = start._replace(drivetrain=start.drivetrain._replace(past_commands=past_u))

    def speed_and_rate(motion: Motion) -> np.ndarray:
        return np.array([odometer.h(motion)[0], imu.h(motion)[2]])

    model = simulate_outputs(vehicle, start, record.dt_s, record.u, speed_and_rate, backend)
    readings = [(record.sensors[name], entry) for name, entry in (("odometer", 0), ("imu", 2))]
    measured_values = np.stack([np.where(s.mask[:, k] > 0.0, s.z[:, k], np.nan) for s, k in readings], axis=1)
    return RunPrediction(record.t_s, measured_values, model)


def _first_measurement(record: FitRecord, sensor: str, entry: int) -> float:
    """Return the first measurement of entry `entry` of a sensor."""
    readings = record.sensors[sensor]
    return float(readings.z[np.argmax(readings.mask[:, entry] > 0.0), entry])


def _evaluation_title(run_evaluation: RunEvaluation) -> str:
    if run_evaluation.is_held_out:
        return _("{fit_run} → {test_run}", fit_run=run_evaluation.fit_run, test_run=run_evaluation.test_run)
    return _("{fit_run} itself", fit_run=run_evaluation.fit_run)


def _with_error(estimate: float | None, std: float | None) -> str:
    return (
        _("not identifiable") if estimate is None else f"{number(estimate):.4g} ± {number(std or np.nan):.2g}"
    )
