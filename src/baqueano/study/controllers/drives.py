"""Identify each robot of `study controllers`, and drive it by each controller along each route."""

import itertools
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from baqueano.blocks import resolve
from baqueano.contracts.blocks import Controller, OwnBlock
from baqueano.contracts.optional import attribute
from baqueano.diagnostics import Verdict
from baqueano.drive import drive_stop_reason, repeat
from baqueano.estimators import TrueState
from baqueano.geometry import pose_error
from baqueano.guides.route import Route
from baqueano.guides.shapes import rectangle, sinuous_circle
from baqueano.identify import Fit
from baqueano.runs import Run
from baqueano.study.counterpart import LoopWorld
from baqueano.study.driving import identify_by_advice, initial_file, simulate_experiments
from baqueano.study.truth import draw_robots
from baqueano.sweep.figures import drive_figures
from baqueano.sweep.result import SweepCombination, SweepDrive
from baqueano.tune import tune
from baqueano.tune.objective import OFFSET_M
from baqueano.tune.search_space import with_gains
from baqueano.vehicle_file import VehicleFile

SPEED_M_S = 0.2
TUNING_SEED = 10_000  # of the robot on whose model all gains are tuned
DRAW_COUNT = 24  # vehicles from the covariance of its fit
SHAPES = {
    "sinuous": lambda: sinuous_circle(0.6, 0.06, 5, SPEED_M_S),
    "rectangle": lambda: rectangle(1.2, 0.8, 0.2, SPEED_M_S),
}


class ComparedController(NamedTuple):
    """A controller with its tuned gains."""

    label: str
    kind: OwnBlock
    gains: dict[str, float]  # the tuned ones; empty: the defaults
    bound_gains: tuple[str, ...]  # gains that ended at a bound of the search
    over_draws: bool = False  # tuned over draws of the errors of a fit

    def controller(self, vehicle_file: VehicleFile) -> Controller:
        """Return the controller with its gains, for the model of this vehicle."""
        entries = {name: gain for name, gain in self.gains.items() if "[" in name}
        fields = {name: gain for name, gain in self.gains.items() if name not in entries}
        return with_gains(vehicle_file.controller(self.kind, **fields), entries, entries.values())


class DrivenRobot(NamedTuple):
    """The drives of a robot for each evaluation; empty if its fit was refused."""

    seed: int
    drives: dict[str, list[SweepDrive]]


def compared_controllers(
    kinds: Sequence[OwnBlock], start_count: int, backend: str
) -> tuple[ComparedController, ...]:
    """Return each controller with its gains, and after the paper's PD the same PD tuned over draws of the fit.

    They are tuned on the identified model of a robot that does not drive in the study. A controller that is not a
    kind, or cannot be compiled, has its default gains.
    """
    for kind in kinds:
        if isinstance(kind, str):
            resolve("controller", kind)  # an unknown kind is refused before minutes of tuning
    fits = (_identified(seed) for seed in itertools.count(TUNING_SEED))
    vehicle_file = next(fit.vehicle_file for fit in fits if fit.verdict != Verdict.REFUSED)
    controllers = []
    for kind in kinds:
        controllers.append(_compared_controller(kind, vehicle_file, start_count, backend))
        if kind == "pd":
            controllers.append(_compared_controller(kind, vehicle_file, start_count, backend, DRAW_COUNT))
    return tuple(controllers)


def _compared_controller(
    kind: OwnBlock, vehicle_file: VehicleFile, start_count: int, backend: str, draws: int = 0
) -> ComparedController:
    label = kind if isinstance(kind, str) else getattr(kind, "__name__", type(kind).__name__)
    if not isinstance(kind, str):
        return ComparedController(label, kind, {}, ())
    vehicle_file = vehicle_file.with_values({"controller.kind": kind})
    if kind != "pd" and attribute(vehicle_file.controller(), "is_interpreted"):
        return ComparedController(label, kind, {}, ())
    route = SHAPES["sinuous"]()
    tune_result = tune(
        vehicle_file,
        route,
        starts=start_count,
        polish=False,
        duration_s=float(route.t_s[-1]) / 2.0,
        offset_m=0.0 if kind == "pd" else OFFSET_M,  # this law does not correct a cross-track error
        draws=draws,
        backend=backend,
    )
    bound_gains = tuple(gain.name for gain in tune_result.gains if gain.bound_side)
    label = f"{label}, draws" if draws else label
    return ComparedController(label, kind, tune_result.values, bound_gains, draws > 0)


def _identified(seed: int) -> Fit:
    run = simulate_experiments(draw_robots(1, seed), range(seed, seed + 1))[0]
    return identify_by_advice(run, initial_file())


def drive_robot(seed: int, controllers: tuple[ComparedController, ...], backend: str) -> DrivenRobot:
    """Return the drives of one robot by all controllers."""
    robot, fit = draw_robots(1, seed), _identified(seed)
    if fit.verdict == Verdict.REFUSED:
        return DrivenRobot(seed, {})
    vehicle_file, drives = fit.vehicle_file, DrivenRobot(seed, {"pose": [], "estimate": [], "truth": []})
    for controller in controllers:
        block = controller.controller(vehicle_file)
        combination = SweepCombination(controller.label, "", controller.label, "repeat")
        for name, make in SHAPES.items():
            route, label = start_at_origin(make()), f"robot {seed}, {name}"
            for is_pose_known in (True, False):
                world = LoopWorld(robot, seed + 1, vehicle_file.rate_hz)
                run = _drive(vehicle_file, route, block, world, is_pose_known, backend)
                views = (
                    {"pose": run} if is_pose_known else {"estimate": replace(run, truth=None), "truth": run}
                )
                for view_name, view in views.items():
                    drives.drives[view_name].append(_drive_figures(view, combination, label))
    return drives


def start_at_origin(route: Route) -> Route:
    """Return the route relative to its first pose, because a robot of the truth begins at the origin."""
    eta = np.array([pose_error(eta, route.eta[0]) for eta in route.eta])
    eta[:, 2] = route.eta[:, 2] - route.eta[0, 2]  # the heading is unwrapped
    return route._replace(eta=eta)


def _drive(
    vehicle_file: VehicleFile, route: Route, block: Controller, world: LoopWorld, is_pose_known: bool, backend: str
) -> Run:  # fmt: skip
    estimator = TrueState(lambda: world.motion) if is_pose_known else None
    return repeat(vehicle_file, route, controller=block, estimator=estimator, world=world, backend=backend)


def _drive_figures(run: Run, combination: SweepCombination, label: str) -> SweepDrive:
    figures, pieces = drive_figures(run)
    reason = drive_stop_reason(run)
    return SweepDrive(combination, label, figures, pieces, "" if reason is None else reason.code)
