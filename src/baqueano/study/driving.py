"""`baqueano study driving`: measure how evenly identified robots drive, simulated with independent physics.

Robots of truth/ with the tolerances of real parts are driven for 60 s and identified from commands and IMU only. The
fit starts from a rough guess, with centre of mass and delay free, and then follows its own advice. The robots follow
three shapes at three speeds with the recommended controller and its default gains. Those gains were chosen on robots 0
to 5; --seed 100 selects other robots. At 0.3 m/s these shapes require at most 1.5 rad/s. An eight of 0.6 m would
require 2.4 rad/s. Then the weakest robot needs 98.6 % of its duty without any feedback, and every controller exceeds
the limit. The cases:
    imu          the estimator uses commands and IMU, with the identified model
    pose         the estimator receives pose and velocity: the errors of the controller only
    breakaway    dry friction and dead zone are 1.3 times higher at rest; pose known
    late         100 ms more delay from command to motor; pose known
    dead_zone    10 % more dead zone than identified
    battery      7 % less voltage than at the identification
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from baqueano.compare.errors import cross_track, rms
from baqueano.compare.evenness import is_driving, read_limits, share_at_limit, sign_changes, speed_errors
from baqueano.contracts.values import TableRow
from baqueano.diagnostics import Verdict
from baqueano.guides.repeat import Repeat
from baqueano.guides.route import Route
from baqueano.guides.shapes import eight, rectangle, sinuous_circle
from baqueano.identify import Fit, FitOptions, excitation, identify
from baqueano.messages import verdict_line
from baqueano.messages.language import mark as N_, number, translate as _
from baqueano.messages.text_table import text_table
from baqueano.runs import Run
from baqueano.signals import seconds
from baqueano.simulate.closed_loop import check_compilable
from baqueano.simulate.open_loop import tick_times
from baqueano.study.counterpart import drive_group, logged_run
from baqueano.study.demo import GUESSED_VALUES
from baqueano.study.truth import Robots, draw_robots, merge
from baqueano.study.truth_drives import Loop, simulate_drives
from baqueano.sweep.workers import run_in_batches
from baqueano.vehicle_file import VehicleFile, load

EXPERIMENT_S = 60.0
# a fit without them reports that they are wrong
FREE = ["+model.centre_of_mass_x_m", "+model.drivetrain.delay_s"]
ROBOT_BATCH = 10  # robots that are simulated together
SHAPES: dict[str, Callable[[float], Route]] = {
    N_("sinuous"): lambda v: sinuous_circle(0.6, 0.06, 5, v),
    N_("eight"): lambda v: eight(1.0, v),
    N_("rectangle"): lambda v: rectangle(1.2, 0.8, 0.2, v),
}
SPEEDS = (0.1, 0.2, 0.3)
SINGLE_SPEED = (0.2,)  # of the cases with one speed


class DrivingCase(NamedTuple):
    """A difference between the driven robot and the identified robot."""

    change: Callable[[Robots], Robots]
    perfect: bool  # pose and velocity are known
    speeds: tuple[float, ...]


CASES = {
    N_("imu"): DrivingCase(lambda q: q, perfect=False, speeds=SPEEDS),
    N_("pose"): DrivingCase(lambda q: q, perfect=True, speeds=SPEEDS),
    N_("breakaway"): DrivingCase(
        lambda q: q.with_parameters(breakaway=1.3 * q.breakaway), perfect=True, speeds=SPEEDS
    ),
    N_("late"): DrivingCase(
        lambda q: q.with_parameters(delay_s=q.delay_s + 0.1), perfect=True, speeds=SINGLE_SPEED
    ),
    "dead_zone": DrivingCase(
        lambda q: q.with_parameters(forward=1.1 * q.forward, backward=1.1 * q.backward),
        perfect=False,
        speeds=SINGLE_SPEED,
    ),
    "battery": DrivingCase(
        lambda q: q.with_parameters(supply=0.93 * q.supply), perfect=False, speeds=SINGLE_SPEED
    ),
}


class LapErrors(NamedTuple):
    """The errors of a lap of a robot."""

    case: str
    shape: str
    requested_m_s: float
    seed: int
    speed_error: float  # of the reference speed, rms after the first second
    unevenness: float  # about the mean over 1 s
    at_limit: float  # fraction of the ticks
    sign_changes: float  # of the forward command, in the lap
    across_m: float  # rms
    stopped: float  # 1.0: the supervisor stopped the robot, or it drove less than half of its lap


class DrivingLimit(NamedTuple):
    """The largest allowed value of one of the errors."""

    figure: str
    max_value: float
    unit: str
    scale: float


LIMITS = {
    "imu": (DrivingLimit("speed_error", 0.05, "%", 100.0),),
    "pose": (DrivingLimit("speed_error", 0.05, "%", 100.0), DrivingLimit("across_m", 0.006, "mm", 1e3)),
    "breakaway": (),
    "late": (DrivingLimit("across_m", 0.012, "mm", 1e3),),
    "dead_zone": (DrivingLimit("unevenness", 0.15, "%", 100.0),),
    "battery": (DrivingLimit("unevenness", 0.15, "%", 100.0),),
}
MIN_LAP_SHARE = 0.95  # of the laps must be within a limit; the table also shows the worst lap


@dataclass(frozen=True, slots=True, eq=False)
class Driving:
    """The laps of all robots."""

    drives: tuple[LapErrors, ...]
    robot_count: int  # robots, fewer than requested if it was interrupted
    refused_robots: tuple[int, ...]  # robots whose fit was refused: they did not drive

    def select_laps(self, case: str, shape: str, speed: float) -> list[LapErrors]:
        """Return the laps of one case, shape and speed."""
        return [d for d in self.drives if d[:3] == (case, shape, speed)]

    def rows(self) -> list[TableRow]:
        """Return one flat row per case, shape and speed: median, 95 % quantile and worst value of each error."""
        rows = []
        for case, (_low, _high, speeds) in CASES.items():
            for shape in SHAPES:
                for speed in speeds:
                    if laps := self.select_laps(case, shape, speed):
                        row = {"case": case, "shape": shape, "requested_m_s": speed, "laps": len(laps)}
                        rows.append(row | _figures(laps))
        return rows

    @property
    def reasons(self) -> tuple[str, ...]:
        """Return a sentence for each limit that is exceeded."""
        robots, reasons = ", ".join(map(str, self.refused_robots)), []
        if self.refused_robots:
            reasons.append(_("the fits of robots {robots} were refused", robots=robots))
        for row in self.rows():
            case_text = _("{case}, {shape} at {requested_m_s:g} m/s", **row)
            for limit in LIMITS[row["case"]]:
                if row[f"{limit.figure}_p95"] > limit.max_value:
                    value, limit_value = (
                        limit.scale * x for x in (row[f"{limit.figure}_p95"], limit.max_value)
                    )
                    reasons.append(
                        _(
                            "{where}: {figure} {value:.1f} {unit}; expected at most {most:g} {unit}",
                            where=case_text,
                            figure=limit.figure,
                            value=value,
                            unit=limit.unit,
                            most=limit_value,
                        )
                    )
            for figure in ("at_limit", "sign_changes", "stopped"):
                if (worst_value := row[f"{figure}_worst"]) > 0.0:
                    figures = {"where": case_text, "figure": figure, "value": worst_value}
                    reasons.append(_("{where}: {figure} {value:.3g}, expected 0", **figures))
        return tuple(reasons)

    @property
    def verdict(self) -> Verdict:
        """Return WARN if a limit is exceeded, else USABLE."""
        return Verdict.WARN if self.reasons else Verdict.USABLE

    def table(self) -> str:
        """Return the rows as a text table."""
        rows = []
        for r in self.rows():
            speed, unevenness, distance = (
                " ".join(f"{number(scale * r[f'{figure}_{q}']):.1f}" for q in ("median", "p95", "worst"))
                for figure, scale in (("speed_error", 100.0), ("unevenness", 100.0), ("across_m", 1000.0))
            )
            limits = f"{number(100.0 * r['at_limit_worst']):.1f}%", f"{number(r['sign_changes_worst']):.0f}"
            labels = _(r["case"]), _(r["shape"]), f"{number(r['requested_m_s']):.1f}"
            rows.append([*labels, speed, unevenness, distance, *limits])
        head = [
            _("case"), _("shape"), "m/s", _("speed error %"), _("uneven %"), _("across mm"), _("limit"), _("sign"),
        ]  # fmt: skip
        lines = [
            _(
                "{robots} robots; of each figure the median, the 95 % quantile and the worst",
                robots=self.robot_count,
            ),
            *text_table("<<>>>>>>", head, *rows),
        ]
        return "\n".join([*lines, "", verdict_line(self.verdict, self.reasons, _("all limits are met"))])


FIGURES = ("speed_error", "unevenness", "at_limit", "sign_changes", "across_m", "stopped")


def _figures(laps: list[LapErrors]) -> dict[str, float]:
    figures = {}
    for figure in FIGURES:
        x = np.array([float(getattr(lap, figure)) for lap in laps])
        for name, value in (
            ("median", np.median(x)),
            ("p95", np.quantile(x, MIN_LAP_SHARE)),
            ("worst", np.max(x)),
        ):
            figures[f"{figure}_{name}"] = float(value)
    return figures


def driving(
    seeds: int = 100, first: int = 0, processes: int = 1, backend: str = "auto", cases: tuple[str, ...] = tuple(CASES),
    speeds: tuple[float, ...] = SPEEDS, controller: str | None = None, advance: Callable[[int], None] = lambda k: None,
) -> Driving:  # fmt: skip
    """Return the laps of robots `first` … `first + seeds − 1`. `advance` receives the number of robots just finished.
    `controller` (a kind of the package or "file.py:Class") replaces the file's controller, with default gains.
    """
    check_compilable(backend, controller=initial_file().controller(controller))  # before the first drive
    work = partial(drive_batch, backend=backend, cases=cases, speeds=speeds, controller=controller)
    results = run_in_batches(work, range(first, first + seeds), ROBOT_BATCH, processes, advance)
    drives = tuple(sorted(d for _, laps, _ in results for d in laps))
    refusals = tuple(sorted(k for _, _, seeds_refused in results for k in seeds_refused))
    return Driving(drives, sum(count for count, _, _ in results), refusals)


def drive_batch(
    seeds: range,
    backend: str,
    cases: tuple[str, ...],
    speeds: tuple[float, ...],
    controller: str | None = None,
) -> tuple[int, list[LapErrors], list[int]]:
    """Return the number of robots, their laps, and the seeds whose fit was refused."""
    robots = merge([draw_robots(1, seed) for seed in seeds])
    fits = [identify_by_advice(run, initial_file()) for run in simulate_experiments(robots, seeds)]
    usable = [k for k, fit in enumerate(fits) if fit.verdict != Verdict.REFUSED]
    files = [fits[k].vehicle_file for k in usable]
    robots, names = robots.subset(usable), [seeds[k] for k in usable]
    drives: list[LapErrors] = []
    loops = {
        perfect: [Loop(vehicle_file, perfect, backend, controller) for vehicle_file in files]
        for perfect in {CASES[c].perfect for c in cases}
    }
    for case in cases:
        change, perfect, overrides = CASES[case]
        for shape, make_route in SHAPES.items():
            for speed in [v for v in overrides if v in speeds]:
                laps = simulate_lap(loops[perfect], change(robots), make_route(speed), [s + 1 for s in names])
                drives += [
                    LapErrors(case, shape, speed, seed, *lap) for seed, lap in zip(names, laps, strict=True)
                ]
    return len(seeds), drives, [seed for seed in seeds if seed not in names]


def identify_by_advice(
    runs: Run | list[Run], start: VehicleFile, backend: str = "auto", use: tuple[str, ...] | None = None
) -> Fit:
    """Return the fit of `runs`. As long as its diagnostics advise to free further parameters, fit again with them.
    Advice on clocks is not followed. A refused fit is discarded, except the first."""
    free, fit = [*FREE], None
    while True:
        next_fit = identify(runs, start, free, use=use, options=FitOptions(backend=backend))
        if fit is not None and next_fit.verdict == Verdict.REFUSED:
            return fit
        fit, words = next_fit, [word for reason in next_fit.reasons for word in reason.fix.split()]
        advised_paths = [word for word in words if word.startswith("+") and word not in free]
        if not advised_paths:
            return fit
        free += dict.fromkeys(advised_paths)


def initial_file() -> VehicleFile:
    """Return the vehicle file from which each identification begins."""
    return load("small").with_values(
        {k: v for k, v in GUESSED_VALUES.items() if k.startswith(("model.", "sensors."))}
    )


def simulate_experiments(robots: Robots, seeds: range) -> list[Run]:
    """Return a run of random steps for each robot, with the same steps for all."""
    vehicle_file = initial_file()
    u = excitation(
        "random_steps", vehicle_file.command.limit, EXPERIMENT_S, vehicle_file.rate_hz, 0, rest_s=2.0
    )
    t_ns = tick_times(len(u), vehicle_file.rate_hz)
    readings = drive_group(robots, np.repeat(u[:, None], len(seeds), axis=1), seeds, t_ns).readings
    return [
        logged_run(f"robot {seed}", vehicle_file, t_ns, u, readings[:, i]) for i, seed in enumerate(seeds)
    ]


def simulate_lap(
    loops: list[Loop], robots: Robots, route: Route, seeds: list[int]
) -> list[tuple[float, ...]]:
    """Return the errors of one lap of each robot along a route, from rest at its start."""
    guide = Repeat.along(route, 0)  # the lap does not end in braking
    drives = simulate_drives(loops, robots, guide, float(route.t_s[-1]), seeds)
    nu, eta = (np.stack([getattr(r, name) for r in drives.references]) for name in ("nu", "eta"))
    limits = read_limits(loops[0].file.text)
    return [
        _lap_errors(drives.t_ns, drives.truth[:, i], drives.commands[:, i], eta, nu[:, 0], limits, supervisor)
        for i, supervisor in enumerate(drives.supervisors)
    ]


def _lap_errors(
    t_ns: np.ndarray, truth: np.ndarray, u: np.ndarray, eta: np.ndarray, speed_ref: np.ndarray,
    limits: Any, supervisor: Any,
) -> tuple[float, ...]:  # fmt: skip
    """Return the errors of a LapErrors from true poses and speeds (N, 4), commands (N, 3), reference poses (N, 3)
    and reference speeds (N,).
    """
    pace_figures = speed_errors(t_ns, truth[:, 3], speed_ref)
    drives = is_driving(t_ns, speed_ref, 0.0)
    changes = sign_changes(t_ns[drives], u[drives, 0]) * seconds(t_ns[drives][-1], t_ns[drives][0])
    is_stuck = np.sum(truth[:, 3]) < 0.5 * np.sum(speed_ref)
    cross_track_rms_m = rms(cross_track(t_ns, truth[:, :2], t_ns, eta[:, :2]))
    is_stopped = float(supervisor.stopped > 0.0 or is_stuck)
    limit_share = share_at_limit(u, limits)
    return pace_figures.error, pace_figures.unevenness, limit_share, changes, cross_track_rms_m, is_stopped
