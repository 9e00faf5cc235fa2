"""Run the whole method on the simulated small vehicle; only the last table uses the truth.

    experiment → identify → noise → tune → teach → repeat 3 laps → report

The initial vehicle file is a rough guess: its friction is wrong, and its biases are unknown.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from baqueano.compare import Comparison, compare
from baqueano.contracts.values import TableRow
from baqueano.diagnostics import Diagnostic, Verdict, merge_diagnostics, note
from baqueano.drive import drive_stop_reason, experiment, repeat, teach
from baqueano.errors import AnswerNo
from baqueano.guides.shapes import sinuous_circle
from baqueano.identify import Fit, FitOptions, excitation, identify
from baqueano.identify.noise.covariances import Noise, measure_noise
from baqueano.messages import verdict_line
from baqueano.messages.language import mark as N_, number, translate as _
from baqueano.messages.text_table import text_table
from baqueano.report import Headline, Page, Section, Table
from baqueano.report.animation.partial_fits import partial_fits
from baqueano.report.animation.picture import animation
from baqueano.report.animation.scene import scene
from baqueano.report.estimate_report import errors, paths
from baqueano.report.fit_report import fit_sections
from baqueano.report.run_report import driving_sections, headlines
from baqueano.runs import Run, read_run
from baqueano.runs.route_file import write_route
from baqueano.symbolic.backends import resolve_backend
from baqueano.tune import TuneResult, tune
from baqueano.vehicle_file import VehicleFile, load

LAPS, EXPERIMENT_FILE = 3, "1-experiment.mcap"
GUESSED_VALUES = {  # the guess of a user with a scale and a tape measure, without a data sheet
    "model.actuator_matrix": [[2.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.12]],
    "model.friction.linear": [5.0, 30.0, 0.02],
    "model.friction.quadratic": [0.3, 0.0, 0.0001],
    "model.friction.coulomb": [0.1, 0.0, 0.005],
    "model.drivetrain.dead_zone_forward": [0.2, 0.2],
    "model.drivetrain.dead_zone_backward": [0.2, 0.2],
    "model.drivetrain.gain": [1.0, 1.0],
    "model.drivetrain.lag_s": 0.04,
    "sensors.imu.tilt_rad": [0.0, 0.0],
    "sensors.imu.accel_bias": [0.0, 0.0],
    "sensors.imu.gyro_bias": 0.0,
}
GAIN_HEADINGS = {
    "name": "name", "value": "value", "unit": "unit", "file_value": "before",
    "low": "low", "high": "high", "bound": "bound",
}  # fmt: skip
STAGES_S = 15.0, 30.0  # durations of the experiment for the fits of the animation before the complete fit
# true value of the gyro: the sensors on board do not show it, and the data sheet allows twice that deviation
TRUE_GYRO_SCALE = 1.015


@dataclass(frozen=True)
class Demo:
    """The results of the demo: truth, fit, noise, tuned gains, repeated drive and comparison."""

    truth: VehicleFile
    fit: Fit
    noise: Noise
    tuning: TuneResult
    repeat_run: Run
    comparison: Comparison
    folder: Path

    @property
    def true_values(self) -> np.ndarray:
        """Return the true values (p,) of the fitted parameters; T includes the unequal gains of the wheels."""
        wheels = self.truth.vehicle.drivetrain
        gain_matrix = np.stack([wheels.unmix(wheels.gain * wheels.mix(u)) for u in np.eye(3)], axis=1)
        T = self.truth.vehicle.actuator_matrix @ gain_matrix
        matrix_entries = {f"model.actuator_matrix[{i},{j}]": T[i, j] for i in range(3) for j in range(3)}
        return np.array(
            [matrix_entries[n] if n in matrix_entries else float(self.truth.value(n)) for n in self.fit.names]
        )

    def rows(self) -> list[TableRow]:
        """Return a row per parameter: estimate, std, truth, their difference in std, and a verdict."""
        rows = []
        for row, truth in zip(self.fit.rows(), self.true_values, strict=True):
            z = None if row["estimate"] is None or not row["std"] else (row["estimate"] - truth) / row["std"]
            verdict = N_("not identifiable") if z is None else "ok" if abs(z) < 3 else N_("inconsistent")
            rows.append({**row, "truth": float(truth), "z": z, "verdict": verdict})
        return rows

    @property
    def verdict(self) -> Verdict:
        """Return STOPPED if the vehicle was stopped, else the verdict of the fit."""
        return Verdict.STOPPED if drive_stop_reason(self.repeat_run) else self.fit.verdict

    def table(self) -> str:
        """Return the parameters and a summary as a text table."""
        rows = []
        for row in self.rows():
            identifiable = row["estimate"] is not None
            std = f"{number(row['std'] or np.nan):.2g}" if identifiable else ""
            value = f"{number(row['estimate']):.4g}" if identifiable else "–"
            name = row["name"].removeprefix("model.")
            rows.append([name, value, std, f"{number(row['truth']):.4g}", _(row["verdict"])])
        head = [_("parameter"), _("fit"), _("std. error"), _("true"), _("verdict")]
        lines = text_table("<>>><", head, *rows)
        lines += ["", *self._summary()]
        if any(row["verdict"] == "inconsistent" for row in self.rows()):
            lines.append(
                _(
                    "inconsistent: the gyro reads {percent:.1f} % too much. No sensor on board shows this, "
                    "and the yaw parameters have the same relative error. Two turns on a mark show it.",
                    percent=100.0 * (TRUE_GYRO_SCALE - 1.0),
                )
            )
        return "\n".join(lines)

    def _summary(self) -> list[str]:
        """Return one line each for gains, laps, speed, filter, corridor and verdict."""
        figures, corridor = self.comparison.rows()[0], self.comparison.runs[0].corridor
        gains = ", ".join(f"{name} {number(value):.3g}" for name, value in self.tuning.values.items())
        lines = {
            _("gains"): _(
                "{gains}: a lap that begins beside its route costs {cost:.2g} m²; before, it cost "
                "{file_cost:.2g} m²",
                gains=gains, cost=self.tuning.cost, file_cost=self.tuning.cost_before,
            ),
            _("repeat, {laps} laps", laps=LAPS): _(
                "cross-track error: {estimate_cm:.1f} cm rms according to the estimate; the true value is "
                "{true_cm:.1f} cm",
                estimate_cm=100 * figures["across_estimate_rms_m"], true_cm=100 * figures["across_true_rms_m"],
            ),
            _("speed"): _(
                "{percent:.1f} % rms from the requested speed, at a limit in {at_limit:.0f} % of "
                "the ticks, {changes:.1f} changes of sign per s",
                percent=100 * figures["pace_true_error"], at_limit=100 * figures["saturated_fraction"],
                changes=figures["sign_changes_per_s"],
            ),
            _("filter"): _(
                "velocity {velocity}, pose {pose}",
                velocity=_(figures["nees_velocity_verdict"]), pose=_(figures["nees_pose_verdict"]),
            ),
            _("corridor"): _(
                "{corridor}; the true error at the end is {error_cm:.0f} cm",
                corridor=corridor.sentence if corridor else _("not known"), error_cm=100 * figures["end_error_m"],
            ),
            _("verdict"): verdict_line(self.verdict, self.fit.reasons[:1]),
        }  # fmt: skip
        return text_table("<<", *lines.items())

    def animation(self, backend: str = "auto") -> str:
        """Return the animation: the intervals narrow as data arrive, and the taught path is driven again."""
        labels = {
            "model.actuator_matrix[0,0]": _("motor force"),
            "model.friction.linear[0]": _("viscous friction"),
            "model.friction.linear[1]": _("tyres, sideways"),
            "model.friction.coulomb[0]": _("dry friction"),
            "model.actuator_matrix[0,2]": _("unequal motors"),
        }
        run = read_run(self.folder / EXPERIMENT_FILE)
        guess, options = load("small").with_values(GUESSED_VALUES), FitOptions(backend=backend)
        fits = [(s, identify(run.cut(0.0, s), guess, options=options)) for s in STAGES_S]
        truth = dict(zip(self.fit.names, self.true_values, strict=True))
        stages = partial_fits(
            [*fits, (run.duration_s, self.fit)], list(labels), [truth[name] for name in labels]
        )
        return animation(scene(self.repeat_run), stages, list(labels.values()))

    def page(self) -> Page:
        """Return the report page of the demo."""
        figures = self.comparison.rows()[0]
        text = _(
            "The taught path, driven again {laps} times with IMU and model only. No sensor on board "
            "measures a position, so the true path drifts away from the estimated path. The corridor shows "
            "how far.",
            laps=LAPS,
        )
        identifiable = [r for r in self.rows() if r["z"] is not None]
        covered_count = sum(abs(r["z"]) <= 1.96 for r in identifiable)
        count = _("{inside} of {all}", inside=covered_count, all=len(identifiable))
        headline = Headline(_("parameters in their 95 % interval"), count, _("against the truth"))
        return Page(
            title=_("A vehicle without a data sheet"),
            subtitle=_("the simulated small vehicle: experiment, identify, noise, tune, teach, repeat"),
            verdict=self.verdict,
            headlines=[headline, *headlines(figures)],
            sections=[
                Section(_("Teach and repeat"), text, paths(self.repeat_run)),
                *driving_sections(self.repeat_run, figures),
                *fit_sections(self.fit, self.true_values),
                Section(_("Noise"), _("Measured in the same run."), [Table(self.noise.rows())]),
                Section(
                    _("Gains"),
                    _(
                        "The gains were tuned on the identified model, from a start beside the route. The "
                        "paper's cost, with a weight on changes of the command, is {cost:.2g} m²; before, "
                        "it was {file_cost:.2g} m².",
                        cost=self.tuning.cost,
                        file_cost=self.tuning.cost_before,
                    ),
                    [
                        Table(
                            self.tuning.rows(),
                            "",
                            {key: _(heading) for key, heading in GAIN_HEADINGS.items()},
                        )
                    ],
                ),
                *errors(self.repeat_run),
            ],
            reproduce="baqueano demo",
        )


def demo(
    folder: Path,
    seed: int = 0,
    backend: str = "auto",
    progress: Callable[[Diagnostic], object] = lambda step: None,
    show: Callable[[Path], object] = lambda run: None,
    show_gains: Callable[[TuneResult], object] = lambda result: None,
) -> Demo:
    """Run the demo and write its runs, route.csv and vehicle.toml into `folder`.

    `progress` is called with each step, `show` with the file of each run, and `show_gains` with the tuned gains. Raise
    AnswerNo if the fit is refused.
    """
    folder.mkdir(parents=True, exist_ok=True)
    garage_file = load("small")
    truth = garage_file.with_values({"sensors.imu.gyro_scale": TRUE_GYRO_SCALE})
    vehicle_file = garage_file.with_values(GUESSED_VALUES)
    options = {"truth": truth, "backend": backend}

    progress(note("demo.experiment"))
    u = excitation("random_steps", vehicle_file.command.limit, 60.0, vehicle_file.rate_hz, seed, rest_s=2.0)
    # one run with this model does not repay compiling C
    single_run_backend = "python" if resolve_backend(backend) == "c" else backend
    run = experiment(
        vehicle_file, u, seed=seed, path=folder / EXPERIMENT_FILE, truth=truth, backend=single_run_backend
    )
    show(folder / EXPERIMENT_FILE)
    progress(note("demo.identify"))
    fit = identify(run, vehicle_file, options=FitOptions(backend=backend))
    if fit.verdict == Verdict.REFUSED:
        raise AnswerNo.of("demo.refused", cause=merge_diagnostics(fit.reasons))
    vehicle_file = fit.vehicle_file
    progress(note("demo.noise"))
    noise = measure_noise(fit, run, backend=backend)
    vehicle_file = noise.updated_file(vehicle_file, run.name)
    progress(note("demo.tune"))
    shape = sinuous_circle(0.6, 0.08, 5, 0.2)
    is_compiled = (
        resolve_backend(backend) == "c"
    )  # without a compiler an evaluation takes fifty times as long
    tune_options = {} if is_compiled else {"starts": 1, "polish": False, "duration_s": 10.0}
    tune_result = tune(vehicle_file, shape, backend=backend, **tune_options)
    show_gains(tune_result)
    vehicle_file = tune_result.updated_file()
    vehicle_file.save(folder / "vehicle.toml")
    progress(note("demo.teach"))
    lesson = teach(
        vehicle_file,
        shape,
        closed=True,
        eta=shape.eta[0],
        seed=seed + 1,
        path=folder / "2-teach.mcap",
        **options,
    )
    show(folder / "2-teach.mcap")
    write_route(lesson.route, folder / "route.csv")
    progress(note("demo.repeat", laps=LAPS))
    repeat_run = repeat(
        vehicle_file, lesson.route, LAPS, seed=seed + 2, path=folder / "3-repeat.mcap", **options
    )
    show(folder / "3-repeat.mcap")
    return Demo(truth, fit, noise, tune_result, repeat_run, compare(repeat_run), folder)
