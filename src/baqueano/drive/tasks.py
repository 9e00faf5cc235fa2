"""Drive a vehicle to experiment, to teach a route or to repeat one. Each function returns a run."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from baqueano.contracts.blocks import Guide, OwnBlock
from baqueano.contracts.calls import checked_call
from baqueano.contracts.result import Result
from baqueano.contracts.values import TableRow
from baqueano.controllers import ManualController, Schedule
from baqueano.controllers.schedule import script_commands
from baqueano.diagnostics import Severity
from baqueano.drive.closure import Closure, lap_closure
from baqueano.drive.manual.heading_gains import with_heading_hold
from baqueano.drive.safety.caution import Caution
from baqueano.drive.safety.command_notes import clipping_notes, lap_notes
from baqueano.drive.safety.patience import TimeLimit
from baqueano.drive.safety.precautions import Precautions
from baqueano.drive.safety.route_check import route_warnings
from baqueano.drive.session import Conditions, drive
from baqueano.errors import UsageError
from baqueano.guides import Idle, RepeatByProgress
from baqueano.guides.repeat import Repeat, with_laps
from baqueano.guides.route import Route
from baqueano.loop import Blocks
from baqueano.runs import Run
from baqueano.runs.run_path import run_route
from baqueano.runs.show import short_text
from baqueano.standstill import with_usual_rest
from baqueano.vehicle_file.file import VehicleFile

LESSON_LIMIT_S = 600.0  # of a lesson whose guide does not have a route
LESSON_PACE = 0.5  # a lesson lasts at most twice its planned time, and 2 END_WAIT_S
ENDS = {"duration_s", "tick_times_ns", "world", "path"}  # conditions of a drive without a last lap


@checked_call(
    'bq.experiment(robot, bq.excitation("random_steps", robot.command.limit, 60.0, robot.rate_hz))',
    checked=(drive, Conditions),
)
def experiment(
    vehicle_file: VehicleFile, u: np.ndarray, *, estimator: OwnBlock | None = None, **options: Any
) -> Run:
    """Play commands open loop, one per tick, with the supervisor and the recording of a normal drive.

    Parameters
    ----------
    vehicle_file : VehicleFile
        The vehicle; it is simulated unless a `world` is given.
    u : ndarray (N, n) [unit of the file's [command]]
        One command per tick, after a first tick without one. A command above its limit is clipped, with a warning.
    estimator : str, type or block, optional
        The estimator instead of the file's, as in `repeat`.
    **options : object
        `path`: write the run to this file; `seed`: of the noise; `truth`: a vehicle file that is simulated instead of
        this one; `eta`: pose in the map at the start (3,) [m, m, rad]; `duration_s`: longest time; `shake`: faults;
        `world`: a simulator of your own, or a vehicle; `backend`: "auto", "c", "python" or "numpy".

    Returns
    -------
    Run
        Commands, measurements, estimate, and the true motion if the vehicle is simulated.

    Raises
    ------
    UsageError
        If `u` has another shape, or a value that is not finite.

    Examples
    --------
    >>> run = experiment(bq.load("small"), np.tile([0.5, 0.0, 0.0], (100, 1)))  # both wheels at half duty for 1 s
    >>> print(run.applied_commands.shape, f"{run.truth.nu[-1, 0]:.2f} m/s")
    (101, 3) 0.13 m/s
    """
    u = np.atleast_2d(np.array(u, dtype=float))
    if u.shape[1] != vehicle_file.vehicle.commands or not len(u) or not np.all(np.isfinite(u)):
        commands, names = vehicle_file.vehicle.commands, vehicle_file.command.names
        raise UsageError.of("drive.signal-shape", value=str(u.shape), commands=commands, names=names)
    schedule, idle = Schedule.at_rate(u, vehicle_file.rate_hz), Idle(len(u) / vehicle_file.rate_hz)
    blocks = Blocks(vehicle_file.estimator(estimator), idle, schedule, vehicle_file.supervisor())
    return drive(blocks, vehicle_file, "experiment", notes=clipping_notes(vehicle_file, u), **options)


Driver: TypeAlias = Route | Guide | type | Sequence[tuple[float, Sequence[float]]] | Callable[[], np.ndarray]


class TeachResult(NamedTuple):
    """The result of `teach`.

    Attributes
    ----------
    run : Run
        The drive.
    route : Route
        The estimated path at ROUTE_RATE_HZ, in the map of the drive.

    Examples
    --------
    >>> teach(bq.load("small"), [(1.0, [0.6, 0.0, 0.0])]).route
    Route(21 poses, 1.0 s, 0.17 m, open)
    """

    run: Run
    route: Route

    def __repr__(self) -> str:
        return short_text(self.run, repr(self.route))

    def rows(self) -> list[TableRow]:
        """Return one flat row per topic of the run."""
        return self.run.rows()

    def table(self) -> str:
        """Return the route and the content of the run as text."""
        return f"{self.route!r}\n{self.run.table()}"

    def closure(self, vehicle_file: VehicleFile) -> Closure:
        """Return the gyro scale of a lap whose driver saw that it returned to its start; see `lap_closure`.

        A vehicle that follows a route closes it in its estimate only. The vehicle of the example has the scale 0.97.

        >>> from baqueano.guides.shapes import eight
        >>> noise = {"disturbance_std": [0.03, 0.8], "disturbance_fade_s": [1.0, 2.5], "velocity_walk_std": [0.01] * 3}
        >>> robot = bq.load("small").with_values({f"estimator.{key}": value for key, value in noise.items()})
        >>> lesson = teach(robot.with_values({"sensors.imu.gyro_scale": 0.97}), eight(0.4, 0.3), closed=True)
        >>> closure = lesson.closure(robot)
        >>> abs(closure.scale - 0.97) < 3.0 * closure.std < 0.02
        True
        """
        return lap_closure(self.run, vehicle_file)

    _repr_html_ = Result._repr_html_
    plot = Result.plot
    to_pandas = Result.to_pandas


def drive_with_driver(
    vehicle_file: VehicleFile, driver: Driver, *, hold: bool = False, kind: str = "teach",
    estimator: OwnBlock | None = None, controller: OwnBlock | None = None, **options: Any,
) -> Run:  # fmt: skip
    """Drive as `driver` directs, see `teach`, and return the run; its metadata contain `kind`."""
    n, rate_hz, hand = vehicle_file.vehicle.commands, vehicle_file.rate_hz, None
    if isinstance(driver, Route):
        # a closed lesson is one of many laps
        guide = RepeatByProgress.along(driver, 1, driver.closed, slowest=LESSON_PACE)
    elif isinstance(driver, type):
        guide = vehicle_file.guide(kind=driver)
    elif callable(driver):
        guide, hand = Idle(float("inf")), ManualController(driver)
        hand = with_heading_hold(hand, vehicle_file) if hold else hand
    elif isinstance(driver, list | tuple):
        u = script_commands(driver, n, rate_hz)
        guide, hand = Idle(len(u) / rate_hz), Schedule.at_rate(u, rate_hz)
    elif isinstance(driver, Guide):
        guide = driver
    else:
        raise UsageError.of("drive.driver-type", kind=type(driver).__name__)
    follower = vehicle_file.controller(controller) if hand is None else hand
    options = with_usual_rest(options, vehicle_file.sensors) if hand is None else options
    if hand is None and not isinstance(driver, Route):  # a guide of the user's own may never end
        limit = Caution(is_watching=False), TimeLimit(LESSON_LIMIT_S)
        options["observers"] = (*limit, *options.get("observers", ()))
    blocks = Blocks(vehicle_file.estimator(estimator), guide, follower, vehicle_file.supervisor())
    return drive(blocks, vehicle_file, kind, **options)


@checked_call("bq.teach(robot, path, closed=True)", checked=(drive_with_driver, drive, Conditions))
def teach(vehicle_file: VehicleFile, driver: Driver, *, closed: bool = False, **options: Any) -> TeachResult:
    """Drive as `driver` directs, and return the run with the estimated path as a route.

    Parameters
    ----------
    vehicle_file : VehicleFile
        The vehicle; it is simulated unless a `world` is given.
    driver : Route, guide, list or callable
        A route, a guide or the class of a guide, which the vehicle's controller follows for 600 s at most; a list of
        (seconds, command (n,)); or a function without arguments that returns the present command (n,).
    closed : bool
        True if the drive returns to its start. Then `TeachResult.closure` gives the scale of the gyro.
    **options : object
        `estimator`, `controller` and, with a route or a guide, `rest_s` as in `repeat`; `hold`: True to hold the
        heading by the gyro while a function commands straight motion; the options of `experiment`.

    Returns
    -------
    TeachResult
        The run and the route.

    Raises
    ------
    UsageError
        If `driver` has another type.
    AnswerNo
        If the vehicle did not move, or a closed drive ended farther from its start than 0.3 m or 0.6 rad.

    Examples
    --------
    >>> run, route = teach(bq.load("small"), [(1.0, [0.6, 0.0, 0.0]), (1.0, [0.6, 0.0, 0.1])])
    >>> run.duration_s, route.eta.shape, route.closed
    (2.0, (41, 3), False)
    """
    return TeachResult(
        run := drive_with_driver(vehicle_file, driver, **options), run_route(run, closed=closed)
    )


@checked_call("bq.repeat(robot, route)", checked=(Precautions, drive, Conditions))
def repeat(
    vehicle_file: VehicleFile, route: Route, laps: int = 1, *, estimator: OwnBlock | None = None,
    guide: OwnBlock | None = None, controller: OwnBlock | None = None, **options: Any,
) -> Run:  # fmt: skip
    """Repeat a route with the blocks of the file.

    The vehicle begins at the start of the route, or at the pose `eta`, from which it first drives to the route. The
    route is checked before (`routes.examine`). With a doubtful estimate the vehicle slows down and stops.

    Parameters
    ----------
    vehicle_file : VehicleFile
        The vehicle; it is simulated unless a `world` is given.
    route : Route
        The path and its times.
    laps : int
        Laps of a closed route. With 0 the drive ends after `duration_s`, or by Ctrl-C if it has a `path` or `world`.
    estimator, guide, controller : str, type or block, optional
        A block instead of the file's: a built-in kind, "file.py:Class", a class, which is built with the values of the
        file, or a finished block. The run records the text of each block that is not built in.
    **options : object
        `check`: False to skip the check of the route. `force`: drive even a route that is too fast or has gaps.
        `room`: width and height, such as "2x2.5" [m], or a Room; the drive stops before the vehicle might leave it.
        `lead_in`: False to begin with the route at any pose. `way_back`: drive back to the start afterwards.
        `caution`: False to continue with a doubtful estimate. `patience_s`: the time after which the drive of a stuck
        vehicle ends. `time_limit_s`: the time after which a drive ends if its guide does not end it; by default ten
        times the planned time plus 60 s. `rest_s`: the time at rest before the drive, which measures the bias of the
        gyro; by default 2 s for a vehicle with a gyro.
        Also the options of `experiment`: `path`, `seed`, `eta`, `truth`, `world`, …

    Returns
    -------
    Run
        Commands, measurements, estimate, reference, and the true motion if the vehicle is simulated.

    Raises
    ------
    AnswerNo
        If the route jumps, has a gap, leads into a wall, or is too fast for the vehicle.
    FileError
        If the file lacks gains or noise: `tune` and `identify` find them.
    UsageError
        If a block has another role, or if no condition ends the drive.

    Examples
    --------
    >>> run = bq.repeat(bq.load("small"), bq.guides.shapes.circle(0.3, 0.2))
    >>> print(f"{run.duration_s:.1f} s, {np.ptp(run.truth.eta[:, 0]):.1f} m wide")
    12.1 s, 0.6 m wide
    """
    if laps < 0 or (laps == 0 and not ENDS & options.keys()):
        raise UsageError.of("drive.laps", value=laps)
    precautions, options = Precautions.split_options(options, vehicle_file)
    options = {"backend": "auto", "notes": ()} | options
    if precautions.check:
        is_garage_vehicle = vehicle_file.path is None and options.get("world") is None
        conditions = {
            "measured": is_garage_vehicle or not vehicle_file.is_guess,
            "backend": options["backend"],
        }
        warnings = route_warnings(
            route, vehicle_file, precautions.room, force=precautions.force, **conditions
        )
        options["notes"] = [
            *(replace(warning, severity=Severity.WARNING) for warning in warnings),
            *options["notes"],
        ]
    options = with_usual_rest({"eta": route.eta[0]} | options, vehicle_file.sensors)
    guide_block, follower = (
        with_laps(vehicle_file.guide(route, guide), laps),
        vehicle_file.controller(controller),
    )
    options["notes"] = [*lap_notes(route, laps), *options["notes"]]
    blocks = Blocks(vehicle_file.estimator(estimator), guide_block, follower, vehicle_file.supervisor())
    start = Conditions(eta=options["eta"]).start
    full_guide = precautions.wrap_guide(blocks.guide, route, vehicle_file, start, blocks.estimator)
    planned_s = options["rest_s"] + Repeat.along(route, laps).duration_s
    options["observers"] = (
        *precautions.observers(vehicle_file, route, planned_s),
        *options.get("observers", ()),
    )
    return drive(blocks._replace(guide=full_guide), vehicle_file, "repeat", **options)
