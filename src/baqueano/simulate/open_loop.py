"""Simulate a vehicle file under a signal: the vehicle, its process noise and its sensors in one kernel.

  x_{k+1}, truth, slots = world_step(x_k, u_k, δ, noise_k)        worlds/simulated.py                  (1)

Tick k ends at (k + 1) δ and is driven by u_k. With the same seed, tick k has the noise of tick k of the simulated
world. An additional sensor does not change the noise of the others, because each name has a separate stream
(worlds/noise.py). A kernel is built once for a vehicle and a rate, and then cached.
"""

from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from baqueano.contracts.blocks import SensorBlocks
from baqueano.contracts.calls import checked_call
from baqueano.errors import UsageError
from baqueano.messages import english_text
from baqueano.runs.container.writer import versions
from baqueano.runs.run import Channel, Event, Run, TruthLog
from baqueano.signals import NANOSECONDS, ByName, Motion, Slot
from baqueano.simulate.system import System
from baqueano.symbolic import scan
from baqueano.symbolic.function import KernelKey
from baqueano.symbolic.scan import Scan
from baqueano.vehicle_file import VehicleFile
from baqueano.vehicles.state import Vehicle
from baqueano.worlds import world_init, world_step
from baqueano.worlds.noise import PROCESS_STREAM, sensor_stream, unit_normals
from baqueano.worlds.simulated import DrawnNoise, WorldState, no_noise, tick_row_count


class OpenLoopInput(NamedTuple):
    """The inputs of one tick of an open loop: command and noise."""

    u: np.ndarray  # (n,) the command
    noise: DrawnNoise | None  # standard normals; None: without noise


class Readings(NamedTuple):
    """The outputs of one tick of an open loop: true motion and readings."""

    truth: Motion
    slots: ByName[Slot]


@checked_call('bq.simulate(robot, bq.excitation("random_steps", robot.command.limit, 60.0, robot.rate_hz))')
def simulate(
    vehicle_file: VehicleFile,
    u: ArrayLike,
    seed: int = 0,
    *,
    rate_hz: float | None = None,
    eta0: np.ndarray | None = None,
    nu0: np.ndarray | None = None,
    noise: bool = True,
    name: str = "simulation",
    backend: str = "auto",
) -> Run:
    """Simulate a vehicle that is driven with given commands, one per tick.

    Parameters
    ----------
    vehicle_file : VehicleFile
        The vehicle and its sensors.
    u : array_like (N, n) [unit of the file's [command]]
        The commands.
    seed : int
        Seed of the noise; the same seed yields the same run.
    rate_hz : float, optional
        Ticks per second; by default the rate of the file.
    eta0 : ndarray (3,), optional [m, m, rad]
        Pose at the start in the map; by default the origin.
    nu0 : ndarray (3,), optional [m/s, m/s, rad/s]
        Velocity at the start in the body frame; by default zero.
    noise : bool
        False: vehicle and sensors are perfect, except for biases and delays.
    name : str
        Name of the run.
    backend : str
        "auto", "c", "python" or "numpy".

    Returns
    -------
    Run
        Commands, measurements and the true motion.

    Raises
    ------
    UsageError
        For a wrong shape, a value that is not finite, or a command above the limit of the file.

    Notes
    -----
    Equation (1) of the module.

    Examples
    --------
    >>> from baqueano.vehicle_file import load
    >>> run = simulate(load("small"), np.tile([0.5, 0.0, 0.0], (100, 1)), seed=1)
    >>> print(run.sensors["imu"].z.shape, f"{run.truth.nu[-1, 0]:.2f} m/s")
    (100, 3) 0.13 m/s
    """
    rate = vehicle_file.rate_hz if rate_hz is None else rate_hz
    system = System(vehicle_file.vehicle, vehicle_file.sensors)
    u = command_signal(vehicle_file, u)
    draws = draw_noise(system.sensors, seed, len(u), tick_row_count(1.0 / rate)) if noise else None
    kernel = open_loop(system.model, system.sensors, rate, noise, backend)
    world = world_init(system.model, system.sensors)
    start = system.model.init(_checked_pose(eta0, "eta0"), _checked_pose(nu0, "nu0"))
    world = world._replace(vehicle=start)
    _, outputs = kernel.run(OpenLoopInput(u, draws), carry=world)
    t_ns = tick_times(len(u), rate)
    run = Run(
        name,
        None,
        t_ns,
        u,
        sensors=channels(t_ns, outputs.slots),
        truth=TruthLog(t_ns, outputs.truth.eta, outputs.truth.nu, outputs.truth.nu_dot),
        vehicle_text=vehicle_file.text,
        metadata=metadata(
            "simulate", seed, rate, kernel.backend, noise, np.concatenate([start.eta, start.nu])
        ),
    )
    return replace(run, events=envelope_events(vehicle_file, run))


def envelope_events(vehicle_file: VehicleFile, run: Run) -> tuple[Event, ...]:
    """Return an event for each warning of the envelope: a command or measurement outside the data of the fit."""
    flags = vehicle_file.envelope.range_warnings(run) if vehicle_file.envelope else ()
    return tuple(Event(int(run.t_ns[-1]), "warning", "model", english_text(flag), flag) for flag in flags)


def open_loop(
    model: Vehicle, sensors: SensorBlocks, rate_hz: float, noise: bool = True, backend: str = "auto"
) -> Scan:
    """Return the compiled open loop (1): a `scan` from OpenLoopInput and WorldState to Readings.

    Vehicles with equal parameters share one scan.
    """
    return _open_loop(KernelKey(model, sensors), rate_hz, noise, backend)


@lru_cache(maxsize=32)
def _open_loop(key: KernelKey, rate_hz: float, noise: bool, backend: str) -> Scan:
    (model, sensors), dt_s = key.parts, 1.0 / rate_hz
    silence = no_noise(sensors, tick_row_count(dt_s))

    def step(state: WorldState, x: OpenLoopInput) -> tuple[WorldState, Readings]:
        unit = silence if x.noise is None else x.noise
        state, truth, slots = world_step(model, sensors, state, x.u, dt_s, unit)
        return state, Readings(truth, slots)

    example = OpenLoopInput(np.zeros(model.commands), silence if noise else None)
    return scan(step, world_init(model, sensors), example, backend=backend)


def draw_noise(sensors: SensorBlocks, seed: int, tick_count: int, row_count: int = 1) -> DrawnNoise:
    """Return standard normals for `tick_count` ticks; the leading axes are (ticks,), or (ticks, rows) with `row_count`.

    The vehicle and each sensor have separate random streams.
    """
    leading_shape = (tick_count,) if row_count == 1 else (tick_count, row_count)

    def draw_normals(name: str, size: int) -> np.ndarray:
        return unit_normals(seed, name, tick_count * row_count, size).reshape((*leading_shape, size))

    sensors_by_name = zip(sensors._fields, sensors, strict=True)
    sensor_normals = tuple(
        draw_normals(sensor_stream(name), sensor.noise_size) for name, sensor in sensors_by_name
    )
    return DrawnNoise(draw_normals(PROCESS_STREAM, 3), sensor_normals)


def tick_times(tick_count: int, rate_hz: float) -> np.ndarray:
    """Return the ends of the ticks (N,) [ns]: whole multiples of the period, each rounded separately."""
    return np.round(np.arange(1, tick_count + 1) * NANOSECONDS / rate_hz).astype(np.int64)


def channels(t_ns: np.ndarray, slots: ByName[Slot]) -> dict[str, Channel]:
    """Return a channel per sensor: the measurements in the slots of N ticks, with the times of motion and arrival."""
    channels_by_name = {}
    for name, slot in zip(slots._fields, slots, strict=True):
        has_reading = slot.is_new > 0.5
        age_ns = np.round(np.broadcast_to(slot.age_s, t_ns.shape)[has_reading] * NANOSECONDS).astype(np.int64)
        channels_by_name[name] = Channel(t_ns[has_reading] - age_ns, t_ns[has_reading], slot.z[has_reading])
    return channels_by_name


def metadata(
    kind: str, seed: int, rate_hz: float, backend: str, noise: bool, initial_state: np.ndarray
) -> dict[str, str]:
    """Return the metadata of a simulated run; `initial_state` is η (3,), or η and ν (6,), before its first tick."""
    return versions() | {
        "kind": kind,
        "seed": str(seed),
        "rate_hz": f"{rate_hz:g}",
        "backend": backend,
        "noise": "yes" if noise else "no",
        "start": " ".join(map(repr, initial_state.tolist())),
    }


def command_signal(vehicle_file: VehicleFile, u: ArrayLike) -> np.ndarray:
    """Return `u` as floats (N, n). Raise UsageError for a wrong shape, a value not finite, or one above the limit."""
    names, limit = vehicle_file.command.names, vehicle_file.command.limit
    u = np.array(u, dtype=float)
    if u.ndim != 2 or u.shape[1] != len(names) or not len(u):
        raise UsageError.of("simulate.signal-shape", value=str(u.shape), commands=len(names), names=names)
    if not np.all(np.isfinite(u)):
        k, i = np.argwhere(~np.isfinite(u))[0]
        raise UsageError.of("simulate.not-finite", name=names[i], value=u[k, i], tick=k)
    is_beyond_limit = np.abs(u) > np.asarray(limit) * (1.0 + 1e-12)
    if np.any(is_beyond_limit):
        k, i = np.argwhere(is_beyond_limit)[0]
        raise UsageError.of("simulate.beyond-limit", name=names[i], value=u[k, i], tick=k, limit=limit[i])
    return u


def _checked_pose(x: np.ndarray | None, name: str) -> np.ndarray | None:
    if x is None:
        return None
    x = np.array(x, dtype=float)
    if x.shape != (3,) or not np.all(np.isfinite(x)):
        raise UsageError.of("simulate.pose", name=name, value=str(x.tolist()))
    return x
