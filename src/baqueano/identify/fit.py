"""`identify`: runs and a vehicle file → the parameters that explain what was measured.

    C(p) = Σ_t ‖s(t) − h_p(t)‖_Huber          Grotz et al., `equ:cost_function`                           (1)

over all channels of all sensors, each in units of its own noise σ, k = 1.345 σ; minimised by damped
Gauss-Newton with exact sensitivities (least_squares.py, search.py) over the free parameters and, run by run,
the sensors' biases and the velocity at the start. What the data do not show is held where it was, and the
rest is fitted again (solve/seen.py).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from baqueano.diagnostics import Severity, fault, note
from baqueano.errors import UsageError
from baqueano.identify import without_encoders
from baqueano.identify.answer.result import Fit
from baqueano.identify.answer.summary import Finished
from baqueano.identify.answer.systematic import covariance_by_zeros
from baqueano.identify.blocks import Blocks
from baqueano.identify.by_innovations import checked, fit_by_innovations, fit_by_simulation
from baqueano.identify.doubts import mended
from baqueano.identify.rows.record import beginning
from baqueano.identify.rows.resting import with_gyro_at_rest
from baqueano.identify.rows.tape import with_tape
from baqueano.identify.solve.delay import best_search_of_all, bounds_of
from baqueano.identify.solve.duty import PATH, duty_step
from baqueano.identify.solve.huber import believed
from baqueano.identify.solve.parameters import acts_alone, chosen
from baqueano.identify.solve.posed import (
    Asked,
    first_theta,
    given_sigma,
    posed,
    same_commands,
    sensible,
    sensors_of,
)
from baqueano.identify.solve.problem import Problem
from baqueano.identify.solve.search import Task, search
from baqueano.identify.solve.unseen import without_the_unseen
from baqueano.runs.run import Run

if TYPE_CHECKING:
    from baqueano.vehicle_file import VehicleFile

PART, ENOUGH = 4, 1000  # of the rows of a run, and at least, for a first search without a compiler


def identify(
    runs: Run | Sequence[Run],
    vehicle_file: "VehicleFile",
    free: Sequence[str] | None = None,
    *,
    fixed: Sequence[str] = (),
    bounds: Mapping[str, tuple[float, float]] | None = None,
    start: Mapping[str, Any] | None = None,
    use: Sequence[str] | None = None,
    biases: bool = True,
    at_rest: bool = False,
    sigma: Mapping[str, Any] | None = None,
    per_run: Sequence[str] = (),
    clocks: Sequence[str] = (),
    segment_s: float | None = None,
    measured: Sequence[str] = (),
    speed_noise: bool = False,
    cost: str = "simulation",
    doubts: bool = True,
    led: bool | None = None,
    say: Callable[[str], object] | None = None,
    backend: str = "auto",
) -> Fit:
    """The parameters of `vehicle_file` that explain `runs`.

    What is asked for
        `free`: dotted paths of the file ("model.friction.linear", "model.actuator_matrix[0,2]"), else what the model
        needs; "+PATH" beside that; `fixed` are taken out again; `bounds` {path: (low, high)} narrow those of the
        fields; `start` {path: value} is where the search begins, else the file's values. `per_run`: paths that each run
        has for itself. `biases`: estimate those of the IMU, per run; of a car the gyro's is that at rest (resting.py).
    What is believed
        `use`: the sensors, else all that the runs have, or single channels, "imu[2]"; "truth" takes the velocity of a
        simulation, or the pose that a camera saw, for a measurement. `sigma` {sensor: (m,)} fixes the noise;
        `speed_noise` lets it grow with speed (by_speed.py). `measured`: what a tape told, "end: 2.31 m, 95 deg"
        (tape.py). `at_rest`: the runs begin at rest. `clocks`: sensors whose stamps may be off by ± 0.25 s, run by
        run (clocks.py).
    How
        `segment_s` cuts the runs into pieces with a start of their own (pieces.py); poses are cut into 5 s if it is
        not given. `cost` "innovations" goes on with the likelihood of a filter's innovations, the floor's noise
        among what is fitted (prediction.py), and tells which to believe. `led`: by the gyro (without_encoders.py);
        None: a car whose IMU is all that is believed. `doubts` asks at the end what is not in the model
        (structure.py), which takes about as long as the fit; without it the verdict knows less. `say` is told
        how far it is; True from it ends the search. `backend`: "auto", "c", "python" or "numpy".

    UsageError for what does not exist, cannot be had together, or would do nothing, and where no command moved. Data
    that are wrong raise nothing: the verdict of the Fit is then WARN or REFUSED, with reasons.

    >>> from baqueano.simulate import simulate
    >>> from baqueano.vehicle_file import load
    >>> small, u = load("small"), np.repeat(np.random.default_rng(0).uniform(-1, 1, (10, 3)) * [1, 0, 1], 100, axis=0)
    >>> fit = identify(simulate(small, u), small, ["model.mass_kg"])
    >>> print(f"{fit.value('model.mass_kg'):.2f} kg, {fit.verdict}")
    0.61 kg, USABLE
    """
    asked_for: Any = dict(locals())
    runs, cost = [runs] if isinstance(runs, Run) else list(runs), checked(cost, clocks)
    same_commands(vehicle_file, runs)
    beside = {"biases": not biases, "doubts": not doubts, "cost": cost != "simulation", "sigma": sigma,
              "per_run": per_run, "clocks": clocks, "measured": measured, "segment_s": segment_s,
              "at_rest": at_rest, "speed_noise": speed_noise}  # fmt: skip
    others = [name for name, asked in beside.items() if asked]
    if led and others:
        raise UsageError(fault("led.others", others=others))
    if led or (led is None and not others and without_encoders.imu_is_all(vehicle_file, runs, use, free)):
        return without_encoders.without_encoders(
            runs, vehicle_file, free, fixed=fixed, bounds=bounds, start=start, imu=_led_by(use), say=say,
            backend=backend,
        )  # fmt: skip
    file, said = vehicle_file, None
    if biases and acts_alone(file.vehicle):
        file, said = with_gyro_at_rest(file, runs)
    blocks, runs, only = sensors_of(file, runs, use)
    runs, blocks = with_tape(runs, blocks, measured)
    runs, found_before = mended(runs, file, blocks.sensors._asdict())
    asked = Asked(tuple(per_run), tuple(clocks), segment_s, biases, at_rest).checked(blocks)
    _whole_where_a_tape_told(measured, asked)
    wanted = chosen(blocks, free, (*fixed, *per_run), bounds or {})
    sensible(bounds or {}, [*(one.path for one in wanted), *per_run])
    what = posed(blocks, wanted, runs, only, asked, file.rate_hz, Problem, backend)
    given = None if sigma is None else given_sigma(sigma, what.blocks.sensors)
    first = first_theta(what.blocks, what.told, what.problem, start or {}, bounds or {})
    few = believed(what.blocks.sensors, what.problem.has)
    usable = not any(one.severity == Severity.ERROR for one in found_before)
    task = Task(what.problem, *first, what.floor, given, speed_noise, say, few, usable)
    within, found = best_search_of_all(task, _begin(task, what.blocks, backend))
    steps = None if found.stopped else duty_step(what.blocks, task.problem, found.solution.theta)
    if steps is not None:
        fit = identify(**asked_for | {"vehicle_file": vehicle_file.with_values({PATH: 1.0 / steps})})
        return replace(fit, notes=(*fit.notes, note("fit.duty-step", steps=steps)))
    found, sight, info = without_the_unseen(within, found, what.told)
    found = bounds_of(task, found)
    end = Finished(
        file, what.blocks, task, what.wanted, what.frozen, found, sight, info, said, found_before, doubts
    )
    if biases and acts_alone(file.vehicle):
        by_zero = covariance_by_zeros(what.problem, found.solution.theta, sight.kept, info.bread, file)
        end = end._replace(systematic=by_zero)
    return fit_by_innovations(end) if cost == "innovations" else fit_by_simulation(end)


def _whole_where_a_tape_told(measured: Sequence[str], asked: Asked) -> None:
    """UsageError where runs with a tape are cut."""
    if measured and asked.segment_s is not None:
        raise UsageError(fault("tape.cut"))


def _led_by(use: Sequence[str] | None) -> str | None:
    """The IMU that is named, None if none is."""
    if use is not None and len(use) != 1:
        raise UsageError(fault("led.one-imu", found=list(use)))
    return use[0] if use else None


def _begin(task: Task, blocks: Blocks, backend: str) -> np.ndarray:
    """θ (p,) where the search begins. Without a compiler every row counts: where a rough search over the first part
    of each run ends."""
    if task.problem.scan.backend == "c":
        return task.first
    records = task.problem.records
    rows = [max(ENOUGH, len(record.dt_s) // PART) for record in records]
    if all(len(record.dt_s) <= n for record, n in zip(records, rows, strict=True)):
        return task.first
    first = [beginning(record, n) for record, n in zip(records, rows, strict=True)]
    part = Problem(blocks, task.problem.shape, first, backend)
    return search(task._replace(problem=part), task.first, rough=True).solution.theta
