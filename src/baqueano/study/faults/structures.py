"""Plan simulations with an effect of the real world that the fitted model does not include.

Each function takes a subject, its command, its undamaged run and a random generator. An effect on the motor force is
simulated as an equivalent command, `effective_commands`; the log contains the command that was sent. If an effect
depends on the motion, the motion is taken from the undamaged run. The size of the effect is drawn for each run. Some
effects do not apply to a car; detection.py excludes them.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from baqueano.messages.language import mark as N_
from baqueano.runs.run import Run
from baqueano.study.faults.subject import FaultSubject
from baqueano.study.truth import Cars, Robots
from baqueano.vehicle_file import VehicleFile


class FaultPlan(NamedTuple):
    """A vehicle to simulate, and the file to fit to it."""

    vehicle: Robots | Cars
    effective_commands: np.ndarray  # (N, m)
    vehicle_file: VehicleFile
    # parameters that are fixed, so that the fit cannot find the effect
    excluded_parameters: tuple[str, ...] = ()
    second_vehicle: Robots | Cars | None = None  # another vehicle with the same commands
    change: Callable[[Run, Run], Run] | None = None  # changes the run, with the run of the second vehicle


Structure = Callable[[FaultSubject, np.ndarray, Run, np.random.Generator], FaultPlan]


def _plan(subject: FaultSubject, effective_commands: np.ndarray, **fields: Any) -> FaultPlan:
    limit = np.asarray(subject.vehicle_file.command.limit)
    return FaultPlan(
        subject.vehicle, np.clip(effective_commands, -limit, limit), subject.vehicle_file, **fields
    )


def _channels(subject: FaultSubject, u: np.ndarray) -> np.ndarray:
    """Return the duties (N, 2) [left, right] of a two-wheeled vehicle, else the commands (N, m), relative to the
    limit.
    """
    limit = np.asarray(subject.vehicle_file.command.limit)
    part = u / np.where(limit > 0.0, limit, 1.0)
    return np.column_stack([part[:, 0] - part[:, 2], part[:, 0] + part[:, 2]]) if len(limit) == 3 else part


def _command(subject: FaultSubject, w: np.ndarray) -> np.ndarray:
    limit = np.asarray(subject.vehicle_file.command.limit)
    if len(limit) == 3:
        w = np.column_stack([0.5 * (w[:, 0] + w[:, 1]), np.zeros(len(w)), 0.5 * (w[:, 1] - w[:, 0])])
    return w * limit


def _throttle(
    subject: FaultSubject, u: np.ndarray, change: Callable[[np.ndarray], np.ndarray], **fields: Any
) -> FaultPlan:
    """Return the plan with `change` applied to the duty of each wheel, or to a car's throttle."""
    w = _channels(subject, u)
    for k in range(w.shape[1] if isinstance(subject.vehicle, Robots) else 1):
        w[:, k] = change(w[:, k])
    return _plan(subject, _command(subject, w), **fields)


def dead_zone(subject: FaultSubject, u: np.ndarray, sound_run: Run, rng: np.random.Generator) -> FaultPlan:
    """Remove the dead zone from the model; a car's true dead zone is 10 to 30 % of its full throttle."""
    none = np.zeros(2).tolist()
    zones = {f"model.drivetrain.dead_zone_{direction}": none for direction in ("forward", "backward")}
    plan = FaultPlan(subject.vehicle, u, subject.vehicle_file.with_values(zones))
    if isinstance(subject.vehicle, Cars):
        zone = subject.vehicle_file.command.limit[0] * rng.uniform(0.1, 0.3) * np.ones((1, 2))
        plan = plan._replace(vehicle=subject.vehicle.with_parameters(zone=zone))
    return plan


def saturation(subject: FaultSubject, u: np.ndarray, sound_run: Run, rng: np.random.Generator) -> FaultPlan:
    """Saturate the force at 40 to 70 % of the full force, as with slipping wheels."""
    end = rng.uniform(0.4, 0.7)
    return _throttle(subject, u, lambda w: end * np.tanh(w / end))


def lag(subject: FaultSubject, u: np.ndarray, sound_run: Run, rng: np.random.Generator) -> FaultPlan:
    """Give the motors a time constant of 50 to 300 ms, and remove the lag from the model."""
    lagging_vehicle = subject.vehicle.with_parameters(lag_s=rng.uniform(0.05, 0.3, 1))
    return FaultPlan(
        lagging_vehicle, u, subject.vehicle_file.with_values({LAG: 0.0}), excluded_parameters=(LAG,)
    )


def delay(subject: FaultSubject, u: np.ndarray, sound_run: Run, rng: np.random.Generator) -> FaultPlan:
    """Delay the commands by 20 to 150 ms, and remove the delay from the model."""
    delayed_vehicle = subject.vehicle.with_parameters(delay_s=rng.uniform(0.02, 0.15, 1))
    return FaultPlan(
        delayed_vehicle, u, subject.vehicle_file.with_values({DELAY: 0.0}), excluded_parameters=(DELAY,)
    )


def fading_battery(
    subject: FaultSubject, u: np.ndarray, sound_run: Run, rng: np.random.Generator
) -> FaultPlan:
    """Reduce the voltage evenly by 15 to 50 % over the run."""
    loss = rng.uniform(0.15, 0.5)
    return _throttle(subject, u, lambda w: w * (1.0 - loss * np.linspace(0.0, 1.0, len(w))))


def sagging_battery(
    subject: FaultSubject, u: np.ndarray, sound_run: Run, rng: np.random.Generator
) -> FaultPlan:
    """Reduce the voltage by 20 to 50 % at full command, and in proportion below."""
    loss = rng.uniform(0.2, 0.5)
    return _throttle(subject, u, lambda w: w * (1.0 - loss * np.abs(w)))


def _velocity(run: Run) -> np.ndarray:
    """Return the true ν (N, 3) of a simulation."""
    return np.zeros((0, 3)) if run.truth is None else run.truth.nu


def backlash(subject: FaultSubject, u: np.ndarray, sound_run: Run, rng: np.random.Generator) -> FaultPlan:
    """Set the force to zero for 50 to 200 ms after a change of its sign."""
    ticks = round(rng.uniform(0.05, 0.2) * subject.vehicle_file.rate_hz)

    def loose(w: np.ndarray) -> np.ndarray:
        sign = np.sign(w)
        force, ticks_since_change, previous_sign = w.copy(), ticks, 0.0
        for k in range(len(w)):
            if sign[k] != 0.0 and sign[k] != previous_sign:
                ticks_since_change, previous_sign = 0, sign[k]
            force[k] = 0.0 if ticks_since_change < ticks else w[k]
            ticks_since_change += 1
        return force

    return _throttle(subject, u, loose)


def caster(subject: FaultSubject, u: np.ndarray, sound_run: Run, rng: np.random.Generator) -> FaultPlan:
    """Add a kick about z when the vehicle reverses; it decays with a time constant of 0.2 to 0.5 s."""
    nu = _velocity(sound_run)
    amplitude, tau = rng.uniform(0.2, 0.5), rng.uniform(0.2, 0.5) * subject.vehicle_file.rate_hz
    kick, level, previous_sign = np.zeros(len(u)), 0.0, 1.0
    for k, v in enumerate(nu[:, 0]):
        if v * previous_sign < 0.0:
            previous_sign, level = np.sign(v), amplitude * np.sign(v) * rng.choice([-1.0, 1.0])
        level *= np.exp(-1.0 / tau)
        kick[k] = level
    effective_commands = u.copy()
    effective_commands[:, 2] += kick * subject.vehicle_file.command.limit[2]
    return _plan(subject, effective_commands)


def cogging(subject: FaultSubject, u: np.ndarray, sound_run: Run, rng: np.random.Generator) -> FaultPlan:
    """Let the force ripple by 10 to 40 % with the rolled distance, with a period of 2 to 10 cm."""
    nu = _velocity(sound_run)
    distance_m = np.cumsum(nu[:, 0]) / subject.vehicle_file.rate_hz
    ripple = rng.uniform(0.1, 0.4) * np.sin(2.0 * np.pi * distance_m / rng.uniform(0.02, 0.1))
    return _throttle(subject, u, lambda w: w * (1.0 + ripple))


def one_sided(subject: FaultSubject, u: np.ndarray, sound_run: Run, rng: np.random.Generator) -> FaultPlan:
    """Reduce the backward force to 50 to 80 % of the forward force."""
    backward_fraction = rng.uniform(0.5, 0.8)
    return _throttle(subject, u, lambda w: np.where(w < 0.0, backward_fraction * w, w))


def wheel_slip(subject: FaultSubject, u: np.ndarray, sound_run: Run, rng: np.random.Generator) -> FaultPlan:
    """Reduce the force of a robot's wheel, or of a car, to 30 % for 5 s. Then an odometer reads 1.5 times the speed."""
    w, k = _channels(subject, u), int(rng.integers(0, 2)) if isinstance(subject.vehicle, Robots) else 0
    start = int(rng.uniform(0.2, 0.6) * len(u))
    slip_rows = slice(start, start + round(SLIP_S * subject.vehicle_file.rate_hz))
    w[slip_rows, k] *= 0.3

    def with_faster_odometer(run: Run, _: Run) -> Run:
        if "odometer" in run.sensors:
            run.sensors["odometer"].z[slip_rows] *= 1.5
        return run

    return _plan(subject, _command(subject, w), change=with_faster_odometer)


def dry_friction(subject: FaultSubject, u: np.ndarray, sound_run: Run, rng: np.random.Generator) -> FaultPlan:
    """Add dry friction of 5 to 30 % of the full force along x, of a robot also about z.
    Remove dry friction from the fitted file.
    """
    friction_fraction, q = rng.uniform(0.05, 0.3), subject.vehicle
    if isinstance(q, Cars):
        full_force_n = q.stall_n * subject.vehicle_file.command.limit[0]
        return FaultPlan(
            q.with_parameters(dry_n=friction_fraction * full_force_n),
            u,
            subject.vehicle_file.with_values({"model.coulomb_m_s2": 0.0}),
        )
    full_force_n = 2.0 * q.stall_n[0] * np.array([1.0, 0.0, 0.06])
    none = subject.vehicle_file.with_values({"model.friction.coulomb": [0.0, 0.0, 0.0]})
    return FaultPlan(q.with_parameters(dry=friction_fraction * full_force_n[None]), u, none)


def centre_of_mass(
    subject: FaultSubject, u: np.ndarray, sound_run: Run, rng: np.random.Generator
) -> FaultPlan:
    """Move the centre of mass along x by 10 to 30 % of the radius of gyration; the fit keeps it fixed."""
    q = subject.vehicle
    assert isinstance(q, Robots)
    ahead_m = q.ahead_m + rng.uniform(0.1, 0.3) * np.sqrt(q.inertia_kg_m2 / q.mass_kg)
    return FaultPlan(
        q.with_parameters(ahead_m=ahead_m),
        u,
        subject.vehicle_file,
        excluded_parameters=("model.centre_of_mass_x_m",),
    )


def tilted_floor(subject: FaultSubject, u: np.ndarray, sound_run: Run, rng: np.random.Generator) -> FaultPlan:
    """Tilt the floor by 2 to 6°."""
    q = subject.vehicle
    rise, uphill_rad = np.radians(rng.uniform(2.0, 6.0, 1)), rng.uniform(-np.pi, np.pi, 1)
    return FaultPlan(q.with_parameters(slope_rad=rise, slope_heading_rad=uphill_rad), u, subject.vehicle_file)


def second_vehicle(
    subject: FaultSubject, u: np.ndarray, sound_run: Run, rng: np.random.Generator
) -> FaultPlan:
    """Replace the readings after 25 to 75 % of the run by the readings of a vehicle with other friction and motors."""
    factor, q = float(rng.choice([-1.0, 1.0])) * rng.uniform(0.15, 0.6), subject.vehicle
    drag = {"viscous": q.viscous} if isinstance(q, Robots) else {"rolling": q.rolling}
    changed_vehicle = q.with_parameters(
        stall_n=q.stall_n * (1.0 - 0.5 * factor), **{k: v * (1.0 + factor) for k, v in drag.items()}
    )
    cut = int(rng.uniform(0.25, 0.75) * len(u))

    def join_logs(run: Run, second_run: Run) -> Run:
        for name, channel in run.sensors.items():
            channel.z[cut:] = second_run.sensors[name].z[cut:]
        return run

    return FaultPlan(q, u, subject.vehicle_file, second_vehicle=changed_vehicle, change=join_logs)


LAG, DELAY = "model.drivetrain.lag_s", "model.drivetrain.delay_s"
SLIP_S = 5.0
STRUCTURES: dict[str, Structure] = {
    N_("dead zone"): dead_zone,
    N_("saturation or slip"): saturation,
    N_("lag"): lag,
    N_("delay of the command"): delay,
    N_("battery fades"): fading_battery,
    N_("battery sags"): sagging_battery,
    N_("backlash"): backlash,
    N_("caster flips"): caster,
    N_("cogging"): cogging,
    N_("weaker backward"): one_sided,
    N_("slip for 5 s"): wheel_slip,
    N_("dry friction"): dry_friction,
    N_("centre of mass"): centre_of_mass,
    N_("tilted floor"): tilted_floor,
    N_("second vehicle"): second_vehicle,
}
