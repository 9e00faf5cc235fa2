"""Simulate blocks and a vehicle in one kernel, with the loop of loop.py itself.

  state, (record, truth) = advance(system, δ, state, (t, noise))          system.py                     (1)

This is the loop that `drive` runs tick by tick over a simulated world: the command of a tick acts during the
next tick. Here the loop is traced once and compiled. So a lap takes about a millisecond, and its gradient only a little
more.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from baqueano.contracts import optional
from baqueano.contracts.blocks import Controller, Guide, Supervision
from baqueano.contracts.values import Tree
from baqueano.errors import UsageError
from baqueano.estimators import PerfectState
from baqueano.guides.repeat import with_laps
from baqueano.guides.route import Route
from baqueano.messages import english_text
from baqueano.messages.printable import baqueano_command
from baqueano.runs.run import REST_KEY, EstimateLog, Event, ReferenceLog, Run, TruthLog
from baqueano.sensors.truth import truth_sensor
from baqueano.signals import NANOSECONDS, Estimate, Reference, seconds
from baqueano.simulate.open_loop import channels, draw_noise, envelope_events, metadata, tick_times
from baqueano.simulate.system import (
    Input,
    System,
    SystemState,
    advance,
    begin,
    parameter_vector,
    with_parameters,
)
from baqueano.standstill import with_rest
from baqueano.supervisor import REASONS, reason_diagnostic
from baqueano.symbolic import scan
from baqueano.symbolic.backends import resolve_backend
from baqueano.symbolic.function import KernelKey
from baqueano.symbolic.scan import Scan
from baqueano.vehicle_file import VehicleFile
from baqueano.worlds.simulated import no_noise, tick_row_count

MAX_DURATION_NS = 36_000 * NANOSECONDS  # a guide that is not done after this time is considered never done


def simulate_loop(vehicle_file: VehicleFile, route: Route | Guide, seed: int = 0, **options: Any) -> Run:
    """Simulate the file's vehicle with all its blocks on a route, in one kernel.

    Parameters
    ----------
    vehicle_file : VehicleFile
        The vehicle and its blocks.
    route : Route or guide
        Route or guide to follow.
    seed : int
        Seed of the noise.
    **options : object
        Other arguments of `simulate_loops`.

    Returns
    -------
    Run
        Commands, measurements, estimate, reference and the true motion.

    Examples
    --------
    >>> from baqueano.guides.shapes import circle
    >>> from baqueano.vehicle_file import load
    >>> run = simulate_loop(load("small"), circle(0.3, 0.2), noise=False)
    >>> print(f"{run.duration_s:.1f} s, {np.ptp(run.truth.eta[:, 0]):.1f} m wide")
    10.1 s, 0.6 m wide
    """
    return next(simulate_loops(vehicle_file, route, [seed], **options))


def simulate_loops(
    vehicle_file: VehicleFile,
    route: Route | Guide,
    seeds: Iterable[int],
    *,
    laps: int = 1,
    duration_s: float | None = None,
    perfect: bool = False,
    eta0: np.ndarray | None = None,
    controller: Controller | None = None,
    noise: bool = True,
    rest_s: float = 0.0,
    name: str = "closed loop",
    backend: str = "auto",
) -> Iterator[Run]:
    """Simulate the loop once per seed, all with the same kernel.

    Parameters
    ----------
    vehicle_file : VehicleFile
        The vehicle and its blocks.
    route : Route or guide
        Route or guide to follow.
    seeds : iterable of int
        Seeds of the noise, one per run.
    laps : int
        Laps of a closed route.
    duration_s : float, optional
        Duration of each run; by default until the guide is done.
    perfect : bool
        True: the loop uses the true pose instead of an estimator.
    eta0 : ndarray (3,), optional [m, m, rad]
        Pose at the start in the map; by default the start of the route. The estimator also starts at this pose.
    controller : block, optional
        Controller that replaces the controller of the file.
    noise : bool
        False: simulate without the noise of vehicle and sensors.
    rest_s : float [s]
        Time for which the vehicle is at rest before the drive.
    name : str
        Name of the runs.
    backend : str
        "auto", "c", "python" or "numpy".

    Yields
    ------
    Run
        One per seed.

    Raises
    ------
    UsageError
        If the guide is never done and `duration_s` is missing.

    Examples
    --------
    >>> from baqueano.guides.shapes import circle
    >>> runs = simulate_loops(bq.load("small"), circle(0.3, 0.2), seeds=[1, 2], duration_s=0.1, backend="numpy")
    >>> [len(run.t_ns) for run in runs]
    [10, 10]
    """
    system = loop_system(vehicle_file, route, laps, perfect, controller=controller)
    eta0 = start_pose(system) if eta0 is None else np.array(eta0, dtype=float)
    rate = vehicle_file.rate_hz
    rest_ticks = int(np.ceil(rest_s * rate - 1e-6))
    ticks = (
        max(1, round(duration_s * rate))
        if duration_s is not None
        else rest_ticks + drive_tick_count(system, rate)
    )
    check_compilable(backend, **system.blocks._asdict())
    blocks = with_rest(system.blocks, rest_s, system.model.commands)
    system = system._replace(guide=blocks.guide, controller=blocks.controller)
    t_ns = tick_times(ticks, rate)
    start = begin(system, eta0)
    kernel = closed_loop(system, rate, noise=noise, backend=backend)
    for seed in seeds:
        inputs = Input(
            t_ns, draw_noise(system.sensors, seed, len(t_ns), tick_row_count(1.0 / rate)) if noise else None
        )
        last_state, outputs = kernel.run(inputs, carry=start)
        run_metadata = metadata("simulate loop", seed, rate, kernel.backend, noise, eta0)
        run_metadata |= {REST_KEY: repr(rest_s)} if rest_s else {}
        run = as_run(name, t_ns, outputs, run_metadata)
        events = _stop_event(last_state.blocks.supervisor, int(t_ns[-1])) + envelope_events(vehicle_file, run)
        yield replace(run, vehicle_text=vehicle_file.text, events=events)


def loop_system(
    vehicle_file: VehicleFile,
    route: Route | Guide,
    laps: int = 1,
    perfect: bool = False,
    controller: Controller | None = None,
) -> System:
    """Return the system of all blocks of the file on `route`; `controller` replaces the file's controller."""
    guide = with_laps(route if isinstance(route, Guide) else vehicle_file.guide(route), laps)
    sensors = truth_sensor() if perfect else vehicle_file.sensors
    estimator = PerfectState() if perfect else vehicle_file.estimator()
    controller = vehicle_file.controller() if controller is None else controller
    return System(vehicle_file.vehicle, sensors, estimator, guide, controller, vehicle_file.supervisor())


def closed_loop(
    system: System,
    rate_hz: float,
    *,
    noise: bool = True,
    backend: str = "auto",
    output: Callable[[Tree], Tree] | None = None,
    paths: tuple[str, ...] = (),
    start: Callable[[Tree], SystemState] | None = None,
) -> Scan:
    """Return the compiled closed loop (1): a `scan` from Input and SystemState to LoopOutput, or output(LoopOutput).

    The values of the system at `paths` are the parameters θ of the scan. `start` is the state before the first tick as
    a function of θ; without it, or for another state, pass the state as `carry`. Raise UsageError for a block that
    cannot be compiled. Systems with equal parameters share one scan.
    """
    return _closed_loop(KernelKey(system), rate_hz, noise, backend, output, paths, start)


@lru_cache(maxsize=32)
def _closed_loop(
    key: KernelKey,
    rate_hz: float,
    noise: bool,
    backend: str,
    output: Callable[[Tree], Tree] | None,
    paths: tuple[str, ...],
    start: Callable[[Tree], SystemState] | None,
) -> Scan:
    (system,) = key.parts
    check_compilable(backend, **system.blocks._asdict())
    dt_s = 1.0 / rate_hz
    example = Input(1, no_noise(system.sensors, tick_row_count(dt_s)) if noise else None)

    def step_system(system: System, state: SystemState, x: Input) -> tuple[SystemState, Tree]:
        state, record = advance(system, dt_s, state, x)
        return state, record if output is None else output(record)

    if not paths:
        return scan(lambda state, x: step_system(system, state, x), begin(system), example, backend=backend)

    def step(theta: Tree, state: SystemState, x: Input) -> tuple[SystemState, Tree]:
        return step_system(with_parameters(system, paths, theta), state, x)

    return scan(step, start or begin(system), example, parameter_vector(system, paths), backend=backend)


def parameter_start(
    system: System, paths: tuple[str, ...], state: SystemState
) -> Callable[[Tree], SystemState]:
    """Return `state` as a function of the parameters θ at `paths`, from which the controller may start."""

    def start(theta: Tree) -> SystemState:
        controller = with_parameters(system, paths, theta).controller
        return state._replace(blocks=state.blocks._replace(controller=controller.init()))

    return start


def check_compilable(backend: str, **blocks: Tree) -> None:
    """Raise UsageError, with a command to use instead, if the step of a block must not be compiled for `backend`."""
    for role, block in blocks.items():
        if optional.attribute(block, "is_interpreted") and resolve_backend(backend) != "numpy":
            line = f"--{role}", f"file.py:{type(block).__name__}"
            command = baqueano_command("repeat", "lab", *line)
            raise UsageError.of("simulate.as-written", command, role=role, block=type(block).__name__)


def as_run(name: str, t_ns: np.ndarray, output: Tree, metadata: dict[str, str]) -> Run:
    """Return the run of N ticks from `output`, a LoopOutput whose leaves begin with the axis N."""
    record, truth = output.record, output.truth
    est, ref = record.estimate, record.reference
    return Run(
        name,
        None,
        t_ns,
        record.tick.u,
        requested_commands=record.requested_command.u,
        sent_commands=record.sent_command.u,
        sensors=channels(t_ns, record.tick.sensors),
        estimate=EstimateLog(t_ns, est.eta, est.nu, est.cov, est.innovation, est.innovation_cov),
        reference=ReferenceLog(t_ns, ref.eta, ref.nu, ref.at_end),
        truth=TruthLog(t_ns, truth.eta, truth.nu, truth.nu_dot),
        metadata=metadata,
    )


def start_pose(system: System) -> np.ndarray:
    """Return the first pose (3,) of the guide's reference."""
    return np.array(sample_references(system, [0])[0].eta, dtype=float)


def reference_duration(system: System) -> float:
    """Return the time from the first tick to the end of the reference [s], for a vehicle on its reference.

    Raise UsageError if the guide is not done within MAX_DURATION_NS.
    """
    low, high = -1, MAX_DURATION_NS
    if not _is_over(system, high):
        raise UsageError.of("simulate.never-done", limit_h=MAX_DURATION_NS / NANOSECONDS / 3600)
    while high - low > 1:
        middle_ns = (low + high) // 2
        low, high = (low, middle_ns) if _is_over(system, middle_ns) else (middle_ns, high)
    return seconds(high)


def drive_tick_count(system: System, rate_hz: float) -> int:
    """Return the number of ticks until the guide is done, including that tick."""
    return int(np.ceil(reference_duration(system) * rate_hz - 1e-6)) + 1


def _is_over(system: System, t_ns: int) -> bool:
    return bool(sample_references(system, [0, t_ns])[-1].at_end > 0.0)


def sample_references(system: System, times_ns: Sequence[int]) -> list[Reference]:
    """Return the guide's references at the times `times_ns` from its start, for a vehicle on its reference."""

    def step(state: Tree, t_ns: int, eta: np.ndarray) -> tuple[Tree, Reference]:
        return system.guide.step(state, Estimate(t_ns, eta, np.zeros(3), np.zeros((6, 6))))

    state, references = system.guide.init(), []
    eta = step(state, times_ns[0], np.zeros(3))[1].eta
    for t_ns in times_ns:
        state, reference = step(state, t_ns, eta)
        references.append(reference)
        eta = reference.eta
    return references


def _stop_event(supervisor: Supervision, t_ns: int) -> tuple[Event, ...]:
    """Return the event with the reason why the supervisor stopped the vehicle, in a tuple; empty without a stop."""
    code = round(float(getattr(supervisor, "reason", 0.0)))
    if not 0 < code < len(REASONS):
        return ()
    diagnostic = reason_diagnostic(code)
    return (Event(t_ns, "error", "supervisor", english_text(diagnostic), diagnostic),)
