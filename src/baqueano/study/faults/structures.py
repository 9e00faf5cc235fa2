"""What is in the world and not in the model: a vehicle file, a signal and a generator → the file that is fitted,
the run of the vehicle as it is, and the file that tells the truth of its parameters.

What acts on the force of the motors is simulated as the command that would have that effect, u_eff; the log
holds the command that was given. What depends on the motion takes it from a first simulation without the
effect. Sizes are drawn anew for each run.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from baqueano.runs.run import Run
from baqueano.simulate import simulate
from baqueano.vehicle_file import VehicleFile

Made = tuple[VehicleFile, Run, VehicleFile]
Structure = Callable[[VehicleFile, np.ndarray, int, np.random.Generator], Made | None]


LEVELS = 4


def _level(rng: np.random.Generator, low: float, high: float) -> float:
    """One of `LEVELS` numbers between `low` and `high`."""
    return low + (high - low) * (int(rng.integers(LEVELS)) + 0.5) / LEVELS


def _changed(file: VehicleFile, values: dict[str, Any]) -> VehicleFile:
    """The same object for the same changes of a vehicle, so that its kernels are kept."""
    key = (file.text, repr(values))
    if key not in _files:
        _files[key] = file.with_values(values)
    return _files[key]


_files: dict[tuple[str, str], VehicleFile] = {}


def _driven(file: VehicleFile, u: np.ndarray, effective: np.ndarray, seed: int) -> Made:
    limit = np.asarray(file.command.limit)
    run = simulate(file, np.clip(effective, -limit, limit), seed)
    return file, replace(run, applied=u), file


def _velocity(run: Run) -> np.ndarray:
    """ν (N, 3) of a simulation."""
    return np.zeros((0, 3)) if run.truth is None else run.truth.nu


def _channels(file: VehicleFile, u: np.ndarray) -> np.ndarray:
    """(N, k) wheels of a vehicle with two, in parts of full; else the commands."""
    limit = np.asarray(file.command.limit)
    part = u / np.where(limit > 0.0, limit, 1.0)
    return np.column_stack([part[:, 0] - part[:, 2], part[:, 0] + part[:, 2]]) if len(limit) == 3 else part


def _command(file: VehicleFile, w: np.ndarray) -> np.ndarray:
    limit = np.asarray(file.command.limit)
    if len(limit) == 3:
        w = np.column_stack([0.5 * (w[:, 0] + w[:, 1]), np.zeros(len(w)), 0.5 * (w[:, 1] - w[:, 0])])
    return w * limit


def _throttle(
    file: VehicleFile, change: Callable[[np.ndarray], np.ndarray], u: np.ndarray, seed: int
) -> Made:
    """`change` of every wheel, or of a car's throttle."""
    w = _channels(file, u)
    for k in range(w.shape[1] if len(file.command.limit) == 3 else 1):
        w[:, k] = change(w[:, k])
    return _driven(file, u, _command(file, w), seed)


def dead_zone(file: VehicleFile, u: np.ndarray, seed: int, rng: np.random.Generator) -> Made:
    """A wheel does not move below 10 to 30 % of full, and loses as much above."""
    zone = rng.uniform(0.1, 0.3)
    return _throttle(file, lambda w: np.sign(w) * np.maximum(np.abs(w) - zone, 0.0), u, seed)


def saturation(file: VehicleFile, u: np.ndarray, seed: int, rng: np.random.Generator) -> Made:
    """Wheels slip: force ends at 40 to 70 % of full."""
    end = rng.uniform(0.4, 0.7)
    return _throttle(file, lambda w: end * np.tanh(w / end), u, seed)


def lag(file: VehicleFile, u: np.ndarray, seed: int, rng: np.random.Generator) -> Made:
    """Motors that follow with a time constant of 50 to 300 ms."""
    tau_s = rng.uniform(0.05, 0.3)
    return _throttle(file, lambda w: _lagged(w, tau_s * file.rate_hz), u, seed)


def _lagged(w: np.ndarray, ticks: float) -> np.ndarray:
    a, out, level = np.exp(-1.0 / ticks), np.zeros(len(w)), 0.0
    for k, x in enumerate(w):
        level = x + (level - x) * a
        out[k] = level
    return out


def delay(file: VehicleFile, u: np.ndarray, seed: int, rng: np.random.Generator) -> Made:
    """Commands arrive 20 to 150 ms late."""
    late = max(1, round(rng.uniform(0.02, 0.15) * file.rate_hz))
    return _driven(file, u, np.concatenate([np.zeros((late, u.shape[1])), u[:-late]]), seed)


def fading_battery(file: VehicleFile, u: np.ndarray, seed: int, rng: np.random.Generator) -> Made:
    """15 to 50 % of the force are lost evenly over the run."""
    lost = rng.uniform(0.15, 0.5)
    return _throttle(file, lambda w: w * (1.0 - lost * np.linspace(0.0, 1.0, len(w))), u, seed)


def sagging_battery(file: VehicleFile, u: np.ndarray, seed: int, rng: np.random.Generator) -> Made:
    """20 to 50 % of the force are lost at full command, in proportion below."""
    lost = rng.uniform(0.2, 0.5)
    return _throttle(file, lambda w: w * (1.0 - lost * np.abs(w)), u, seed)


def backlash(file: VehicleFile, u: np.ndarray, seed: int, rng: np.random.Generator) -> Made:
    """No force for 50 to 200 ms after a change of sign."""
    ticks = round(rng.uniform(0.05, 0.2) * file.rate_hz)

    def loose(w: np.ndarray) -> np.ndarray:
        sign = np.sign(w)
        out, since, before = w.copy(), ticks, 0.0
        for k in range(len(w)):
            if sign[k] != 0.0 and sign[k] != before:
                since, before = 0, sign[k]
            out[k] = 0.0 if since < ticks else w[k]
            since += 1
        return out

    return _throttle(file, loose, u, seed)


def caster(file: VehicleFile, u: np.ndarray, seed: int, rng: np.random.Generator) -> Made | None:
    """A kick about z of 0.2 to 0.5 s when the vehicle goes from forward to backward or back."""
    if len(file.command.limit) != 3:
        return None
    nu = _velocity(simulate(file, u, seed))
    size, tau = rng.uniform(0.2, 0.5), rng.uniform(0.2, 0.5) * file.rate_hz
    kick, level, before = np.zeros(len(u)), 0.0, 1.0
    for k, v in enumerate(nu[:, 0]):
        if v * before < 0.0:
            before, level = np.sign(v), size * np.sign(v) * rng.choice([-1.0, 1.0])
        level *= np.exp(-1.0 / tau)
        kick[k] = level
    effective = u.copy()
    effective[:, 2] += kick * file.command.limit[2]
    return _driven(file, u, effective, seed)


def cogging(file: VehicleFile, u: np.ndarray, seed: int, rng: np.random.Generator) -> Made:
    """Force that ripples with the way of the wheel."""
    nu = _velocity(simulate(file, u, seed))
    way = np.cumsum(nu[:, 0]) / file.rate_hz
    ripple = rng.uniform(0.1, 0.4) * np.sin(2.0 * np.pi * way / rng.uniform(0.02, 0.1))
    return _throttle(file, lambda w: w * (1.0 + ripple), u, seed)


def one_sided(file: VehicleFile, u: np.ndarray, seed: int, rng: np.random.Generator) -> Made:
    """Backward 50 to 80 % of the force of forward."""
    part = rng.uniform(0.5, 0.8)
    return _throttle(file, lambda w: np.where(w < 0.0, part * w, w), u, seed)


def dry_friction(file: VehicleFile, u: np.ndarray, seed: int, rng: np.random.Generator) -> Made:
    """Coulomb friction of 5 to 30 % of the full force along x and about z, and none in the file that is fitted."""
    part = _level(rng, 0.05, 0.3)
    if len(file.command.limit) != 3:
        true = _changed(file, {"model.coulomb_m_s2": part * file.vehicle.throttle_gain})
        return _changed(file, {"model.coulomb_m_s2": 0.0}), simulate(true, u, seed), true
    T, limit = file.vehicle.actuator_matrix, file.command.limit
    dry = [part * T[0, 0] * limit[0], 0.0, part * T[2, 2] * limit[2]]
    true = _changed(file, {"model.friction.coulomb": dry})
    return _changed(file, {"model.friction.coulomb": [0.0, 0.0, 0.0]}), simulate(true, u, seed), true


def centre_of_mass(file: VehicleFile, u: np.ndarray, seed: int, rng: np.random.Generator) -> Made | None:
    """The centre of mass moved along x by 10 to 30 % of the radius of gyration."""
    if len(file.command.limit) != 3:
        return None
    radius = np.sqrt(file.vehicle.inertia_kg_m2 / file.vehicle.mass_kg)
    off = float(file.vehicle.centre_of_mass_x_m + _level(rng, 0.1, 0.3) * radius)
    return file, simulate(_changed(file, {"model.centre_of_mass_x_m": off}), u, seed), file


def slope(file: VehicleFile, u: np.ndarray, seed: int, rng: np.random.Generator) -> Made | None:
    """A floor that rises by 2 to 6°."""
    if len(file.command.limit) != 3:
        return None
    rise, way = float(np.radians(_level(rng, 2.0, 6.0))), float(_level(rng, -np.pi, np.pi))
    sloping = _changed(file, {"model.slope_rad": rise, "model.slope_heading_rad": way})
    return file, simulate(sloping, u, seed), file


def second_vehicle(file: VehicleFile, u: np.ndarray, seed: int, rng: np.random.Generator) -> Made:
    """A part of the log is of a vehicle with other friction and other motors."""
    factor = float(rng.choice([-1.0, 1.0])) * _level(rng, 0.15, 0.6)
    if len(file.command.limit) == 3:
        other = _changed(
            file,
            {
                "model.friction.linear": (file.vehicle.friction.linear * (1.0 + factor)).tolist(),
                "model.actuator_matrix": (file.vehicle.actuator_matrix * (1.0 - 0.5 * factor)).tolist(),
            },
        )
    else:
        other = _changed(
            file,
            {
                "model.linear_drag": file.vehicle.linear_drag * (1.0 + factor),
                "model.throttle_gain": file.vehicle.throttle_gain * (1.0 - 0.5 * factor),
            },
        )
    cut = int(rng.uniform(0.25, 0.75) * len(u))
    first = simulate(file, u, seed)
    second = simulate(other, u[cut:], seed + 50_000, nu0=_velocity(first)[cut - 1])
    sensors = {}
    for name, c in first.sensors.items():
        there, z = c.t_ns < first.t_ns[cut], c.z.copy()
        z[~there] = second.sensors[name].z[: int(np.sum(~there))]
        sensors[name] = c._replace(z=z)
    return file, replace(first, sensors=sensors, truth=None), file


STRUCTURES: dict[str, Structure] = {
    "dead zone": dead_zone, "saturation or slip": saturation, "lag": lag, "delay of the command": delay,
    "battery fades": fading_battery, "battery sags": sagging_battery, "backlash": backlash, "caster flips": caster,
    "cogging": cogging, "weaker backward": one_sided, "dry friction": dry_friction,
    "centre of mass": centre_of_mass, "slope": slope, "second vehicle": second_vehicle,
}  # fmt: skip
