"""Drive a vehicle for the first time, when its response to a command is unknown: growing pulses around one spot.

  rough gain along x = Σ v v̂ / Σ v̂²,  about z = Σ Δψ Δψ̂ / Σ Δψ̂²                                      (1)
  left forward    v > 0, Δψ < 0    correct                                                              (2)
                  v < 0, Δψ > 0    the left motor runs backwards
                  v > 0, Δψ > 0    the right wheel turned: the two are swapped
                  v < 0, Δψ < 0    swapped, and the right motor runs backwards

v is the largest speed after a pulse and Δψ the turn, both from commands and IMU only. v̂ and Δψ̂ are the same
quantities of the file's model under the same commands. The model's dead zones are replaced by the levels at which
motion was first measured, unless all pulses fit better with the file's dead zones. Two wheels are tried one at a time,
forward and backward, because each has two dead zones. Correct the wiring before you fit parameters.
first_drive_pulses.py plans the pulses.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from baqueano.contracts.result import Result
from baqueano.contracts.values import TableRow
from baqueano.controllers import PulseController
from baqueano.diagnostics import Diagnostic, fault, merge_diagnostics
from baqueano.drive.first_drive_pulses import GROWTH, MIN_SIGMA, STEP, PulsePlanner
from baqueano.drive.session import drive
from baqueano.errors import AnswerNo, UsageError
from baqueano.estimators import Inertial
from baqueano.guides import PulseGuide
from baqueano.loop import Blocks
from baqueano.messages import texts
from baqueano.messages.language import mark as N_, translate as _
from baqueano.parameter import all_parameters
from baqueano.runs import Run
from baqueano.signals import seconds
from baqueano.vehicle_file.file import VehicleFile
from baqueano.vehicles.freedoms import is_steered

MIN_SIGNIFICANCE = 3.0  # standard deviations by which the sum of a wheel's speeds must exceed 0
RESPONSE_S = 0.5  # time after a pulse in which its motion is measured


class Pulse(NamedTuple):
    """A pulse of the command, with the largest speed and the largest turn after it."""

    u: np.ndarray  # (n,)
    v: float  # the largest speed, signed [m/s]
    turn_rad: float  # [rad]
    v_significance: float  # v in standard deviations
    turn_significance: float  # the larger of v and turn in standard deviations


WHEEL_NAMES = {
    ("left", "forward"): N_("the left wheel forward"), ("left", "backward"): N_("the left wheel backward"),
    ("right", "forward"): N_("the right wheel forward"), ("right", "backward"): N_("the right wheel backward"),
}  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class FirstDrive(Result):
    """The result of a first drive.

    Attributes
    ----------
    run : Run
        The drive.
    pulses : tuple of Pulse
        Each pulse, and the motion after it.
    wiring : tuple of Diagnostic
        Wiring faults and their remedies; empty if the wiring is right.
    no_motion : tuple of Diagnostic
        Directions in which the vehicle did not move.
    forward_gain, turn_gain : float
        Gains of the vehicle divided by the gains of the file's model [no unit], along x and about z; NaN without
        measured motion.
    onset_level : ndarray (D,)
        Part of the limit [no unit] at which motion was first measured, per direction; NaN if it was never measured.
    file_dead_zones_fit : bool
        True if the dead zones of the file fit better than `onset_level`: the vehicle moved before that level.

    Examples
    --------
    >>> nothing = FirstDrive(bq.simulate(bq.load("small"), np.zeros((9, 3))), (), (), (), np.nan, np.nan, np.zeros(4))
    >>> print(nothing.table())
    0 pulses, 0 of them moved the vehicle
    """

    run: Run
    pulses: tuple[Pulse, ...]
    wiring: tuple[Diagnostic, ...]
    no_motion: tuple[Diagnostic, ...]
    forward_gain: float
    turn_gain: float
    onset_level: np.ndarray
    file_dead_zones_fit: bool = False

    @property
    def moving_pulses(self) -> int:
        """Return the number of pulses that moved the vehicle."""
        return sum(p.turn_significance > MIN_SIGMA for p in self.pulses)

    def rows(self) -> list[TableRow]:
        """Return one flat row per pulse."""
        return [
            {
                "command": " ".join(f"{x:g}" for x in p.u),
                "v_m_s": p.v,
                "turn_rad": p.turn_rad,
                "moved": p.turn_significance > MIN_SIGMA,
            }
            for p in self.pulses
        ]

    def table(self) -> str:
        """Return gains, directions without motion, and wiring faults as sentences."""
        lines = [
            _(
                "{pulses} pulses, {moved} of them moved the vehicle",
                pulses=len(self.pulses),
                moved=self.moving_pulses,
            )
        ]
        if np.isfinite(self.forward_gain):
            lines.append(_("along: {times:.2g} times the gain in the file", times=self.forward_gain))
        if np.isfinite(self.turn_gain):
            lines.append(_("about z: {times:.2g} times the gain in the file", times=self.turn_gain))
        return "\n".join([*lines, *texts((*self.no_motion, *self.wiring))])


def first_drive(vehicle_file: VehicleFile, **options: Any) -> FirstDrive:
    """Drive a vehicle carefully for about a minute, and measure its response to commands; only an IMU is needed.

    Parameters
    ----------
    vehicle_file : VehicleFile
        The vehicle, whose model is a guess.
    **options : object
        Keywords of `drive` and of its `Conditions`.

    Returns
    -------
    FirstDrive
        Rough gains, dead zones, and wiring faults.

    Raises
    ------
    UsageError
        If the file lacks the sensor imu, or a finite [command] limit above 0.

    Notes
    -----
    Equations (1) and (2) of the module.

    Examples
    --------
    >>> from baqueano.vehicle_file import load
    >>> drive = first_drive(load("small"))
    >>> drive.wiring, drive.no_motion, round(drive.forward_gain, 1), round(drive.turn_gain, 1)
    ((), (), 1.0, 1.0)
    """
    return estimate_first_drive(careful_drive(vehicle_file, **options), vehicle_file)


def careful_drive(vehicle_file: VehicleFile, **options: Any) -> Run:
    """Return the run of a first drive without evaluating it.

    It takes the options and raises the errors of `first_drive`.
    """
    if "imu" not in vehicle_file.sensors._fields:
        raise UsageError.of("first-drive.no-imu", name=vehicle_file.name)
    pulses = PulsePlanner(directions(vehicle_file))
    blocks = Blocks(Inertial(), PulseGuide(pulses), PulseController(pulses), vehicle_file.supervisor())
    return drive(blocks, vehicle_file, "first drive", **options)


def directions(vehicle_file: VehicleFile) -> np.ndarray:
    """Return the commands (D, n) of the pulses at full level, one for each of D directions.

    The turn is the first of several channels, because the vehicle then stays in place; for a car the throttle is first.
    Raise UsageError if the command limits are not finite or all zero.
    """
    limit = np.asarray(vehicle_file.command.limit, dtype=float)
    if not np.all(np.isfinite(limit)) or not np.any(limit > 0.0):
        raise UsageError.of("first-drive.limit", vehicle=vehicle_file.name, limit=str(limit.tolist()))
    if is_steered(vehicle_file.vehicle):
        servo = 0.5 * limit[1]
        throttle_and_servo = [[limit[0], s] for s in (0.0, servo, -servo)]
        return np.array([[sign * t, s] for t, s in throttle_and_servo for sign in (1.0, -1.0)])
    if is_two_wheeled(vehicle_file):
        full_level = min(2.0 * limit[0], 2.0 * limit[2], float(np.min(vehicle_file.vehicle.drivetrain.limit)))
        wheels = np.array([[full_level, 0.0], [-full_level, 0.0], [0.0, full_level], [0.0, -full_level]])
        return np.array([vehicle_file.vehicle.drivetrain.unmix(w) for w in wheels])
    channels = [j for j in reversed(range(len(limit))) if limit[j] > 0.0]
    return np.array([sign * limit * (np.arange(len(limit)) == j) for j in channels for sign in (1.0, -1.0)])


def is_two_wheeled(vehicle_file: VehicleFile) -> bool:
    """Return True if the commands are mixed to a left and a right wheel, and the limits allow both to move."""
    limit = vehicle_file.command.limit
    return vehicle_file.vehicle.drivetrain.mixing == "two_wheels" and min(limit[0], limit[2]) > 0.0


def estimate_first_drive(run: Run, vehicle_file: VehicleFile) -> FirstDrive:
    """Return the gains, dead zones and wiring of a first drive, estimated from commands and IMU."""
    commands = directions(vehicle_file)
    pulses = find_pulses(run)
    onset_levels = np.array([_onset_level(pulses, command) for command in commands])
    standstill = tuple(
        _no_motion_reason(_command_text(command, vehicle_file), max(_levels(pulses, command), default=0.0))
        for command, level in zip(commands, onset_levels, strict=True)
        if not np.isfinite(level)
    )
    fits = [
        _model_gains(run, pulses, model_file)
        for model_file in (with_dead_zones(vehicle_file, commands, onset_levels), vehicle_file)
    ]
    is_late = fits[1][1] < fits[0][1]
    forward_gain, turn_gain = fits[is_late][0]
    wiring = _wiring_faults(pulses, commands) if is_two_wheeled(vehicle_file) else ()
    return FirstDrive(run, pulses, wiring, standstill, forward_gain, turn_gain, onset_levels, is_late)


def find_pulses(run: Run) -> tuple[Pulse, ...]:
    """Return the pulses of a first drive and their motion, in order. Raise UsageError for a run without estimates."""
    is_commanded = np.any(run.applied_commands != 0.0, axis=1).astype(int)
    begins = np.flatnonzero(np.diff(is_commanded, prepend=0) == 1)
    ends = np.flatnonzero(np.diff(is_commanded, append=0) == -1)
    log, pulses = run.estimate, []
    if log is None or log.cov is None:
        raise UsageError.of("first-drive.no-estimates", name=run.name)
    for a, b in zip(begins, ends, strict=True):
        end_index = int(np.searchsorted(log.t_ns, run.t_ns[b] + round(RESPONSE_S * 1e9)))
        rows = slice(a, min(end_index, len(log.t_ns)))
        nu, var = log.nu[rows], np.maximum(np.diagonal(log.cov[rows], axis1=1, axis2=2), 1e-18)
        turns = log.eta[rows, 2] - log.eta[max(a - 1, 0), 2]
        v_significance = float(np.max(np.abs(nu[:, 0]) / np.sqrt(var[:, 3])))
        significance = max(v_significance, float(np.max(np.abs(turns) / np.sqrt(var[:, 2]))))
        pulses.append(
            Pulse(run.applied_commands[a], _peak(nu[:, 0]), _peak(turns), v_significance, significance)
        )
    return tuple(pulses)


def with_dead_zones(vehicle_file: VehicleFile, commands: np.ndarray, duties: np.ndarray) -> VehicleFile:
    """Return the file with dead zones from `duties` (D,), the levels of first motion along `commands` (D, n).

    A dead zone is set to the midpoint below its level, see `onset_midpoints`. Dead zones that are 0 in the file stay 0.
    """
    drivetrain, changes = vehicle_file.vehicle.drivetrain, {}
    channel = np.array([drivetrain.mix(command) for command in commands])  # (D, k)
    for name, sign in (("dead_zone_forward", 1.0), ("dead_zone_backward", -1.0)):
        old_zones = np.broadcast_to(getattr(drivetrain, name), channel.shape[1])
        onsets = np.where(sign * channel > 1e-9, sign * channel, np.nan) * onset_midpoints(duties)[:, None]
        onset = [np.min(c[np.isfinite(c)], initial=np.inf) for c in onsets.T]
        new_zones = [x if n > 0.0 and np.isfinite(x) else n for n, x in zip(old_zones, onset, strict=True)]
        if np.any(old_zones > 0.0):
            changes[f"model.drivetrain.{name}"] = [float(x) for x in new_zones]
    return vehicle_file.with_values(changes) if changes else vehicle_file


def onset_midpoints(level: np.ndarray) -> np.ndarray:
    """Return the midpoint (D,) between each level of first motion and the previous level, which gave no motion."""
    previous_level = np.maximum(level - STEP, 0.0)
    previous_level = np.where(GROWTH * previous_level > STEP, level / (1.0 + GROWTH), previous_level)
    return 0.5 * (previous_level + level)


def with_rough_gains(result: FirstDrive, vehicle_file: VehicleFile) -> VehicleFile:
    """Return the file with the rough gains as initial values for a fit, and with the measured dead zones.

    The dead zones of the file stay if `result.file_dead_zones_fit` is True.

    Raise AnswerNo if the wiring is wrong or a direction did not move the vehicle.
    """
    if (fault_note := merge_diagnostics([*result.wiring, *result.no_motion])) is not None:
        raise AnswerNo(fault_note)
    rough_file = vehicle_file
    if not result.file_dead_zones_fit:
        rough_file = with_dead_zones(rough_file, directions(rough_file), result.onset_level)
    k_x, k_z, changes = _gain_or_one(result.forward_gain), _gain_or_one(result.turn_gain), {}
    for path, p in all_parameters(rough_file.vehicle, "model"):
        if p.role == "gain":
            old_values = np.asarray(rough_file.value(path), float)
            factors = np.array([k_x, k_x, k_z])[:, None] if p.axes else 1.0 if p.unit[:3] == "rad" else k_x
            changes[path] = (old_values * factors).tolist()
    return rough_file.with_values(changes) if changes else rough_file


def _model_gains(
    run: Run, pulses: tuple[Pulse, ...], vehicle_file: VehicleFile
) -> tuple[tuple[float, float], float]:
    """Return the gains (1), and the sum of the relative squared residuals of v and Δψ over all pulses."""
    from baqueano.simulate import simulate  # only a laptop needs it: a robot only drives

    model = simulate(
        vehicle_file,
        np.clip(run.applied_commands, -vehicle_file.command.limit, vehicle_file.command.limit),
        noise=False,
    )
    truth = model.truth
    assert truth is not None
    is_commanded = np.any(run.applied_commands != 0.0, axis=1).astype(int)
    begins = np.flatnonzero(np.diff(is_commanded, prepend=0) == 1)
    ends = np.flatnonzero(np.diff(is_commanded, append=0) == -1)
    psi = np.unwrap(truth.eta[:, 2])
    simulated_peaks = []
    for a, b in zip(begins, ends, strict=True):
        rows = slice(a, b + round(RESPONSE_S / max(seconds(run.t_ns[1], run.t_ns[0]), 1e-6)))
        simulated_peaks.append([_peak(truth.nu[rows, 0]), _peak(psi[rows] - psi[max(a - 1, 0)])])
    is_significant, gains, residual = (
        np.array([p.turn_significance > MIN_SIGMA for p in pulses], bool),
        [],
        0.0,
    )
    for x, y in zip(
        np.reshape(simulated_peaks, (-1, 2)).T,
        ([p.v for p in pulses], [p.turn_rad for p in pulses]),
        strict=True,
    ):
        y = np.array(y)
        power = float(x[is_significant] @ x[is_significant])
        gain = float(x[is_significant] @ y[is_significant]) / power if power > 1e-12 else float("nan")
        gains.append(gain)
        used_gain = gain if np.isfinite(gain) else 0.0
        residual += float(np.sum((y - used_gain * x) ** 2) / max(np.sum(y**2), 1e-12))
    return (gains[0], gains[1]), residual


def _wiring_faults(pulses: tuple[Pulse, ...], commands: np.ndarray) -> tuple[Diagnostic, ...]:
    """Return the wiring faults of (2).

    If the measured speeds are not significant, only the gyro is used. On a sloping floor the speeds of all pulses have
    errors of the same sign, so the standard deviations are added, not their squares.
    """
    turn, speed_turn, std = np.zeros(2), np.zeros(2), np.zeros(2)
    for p in pulses:
        for wheel, forward in enumerate((commands[0], commands[2])):
            if p.turn_significance > MIN_SIGMA and _is_parallel(p.u, forward):
                side = (-1.0, 1.0)[wheel]
                turn[wheel] += p.turn_rad * np.sign(p.u @ forward) * side
                speed_turn[wheel] += p.v * p.turn_rad * side  # large pulses have the largest weight
                std[wheel] += abs(p.turn_rad * p.v) / max(p.v_significance, 1e-9)
    if not np.all(turn != 0.0):
        return ()
    if np.any(np.abs(speed_turn) < MIN_SIGNIFICANCE * std):
        inverted_sides = [side for side, x in zip(("left", "right"), turn, strict=True) if x < 0.0]
        return tuple(fault(f"wiring.turns-wrong-{side}") for side in inverted_sides)
    is_own_wheel = speed_turn > 0.0  # the commanded wheel is the wheel that turned
    if is_own_wheel.any() and not is_own_wheel.all():
        return (fault("wiring.same-response"),)
    swap = [] if is_own_wheel.all() else [fault("wiring.swapped")]
    names, forward_turn = (("left", "right"), turn) if is_own_wheel.all() else (("right", "left"), -turn)
    backwards = [name for name, x in zip(names, forward_turn, strict=True) if x < 0.0]
    return (*swap, *(fault(f"wiring.backwards-{name}") for name in backwards))


def _onset_level(pulses: tuple[Pulse, ...], command: np.ndarray) -> float:
    """Return the smallest part of `command` (n,) that moved the vehicle, NaN if it never moved."""
    return min(_levels([p for p in pulses if p.turn_significance > MIN_SIGMA], command), default=float("nan"))


def _levels(pulses: Sequence[Pulse], d: np.ndarray) -> list[float]:
    """Return the parts of the command `d` (n,) that were tried, in order."""
    return [float(p.u @ d / (d @ d)) for p in pulses if p.u @ d > 0.0 and _is_parallel(p.u, d)]


def _no_motion_reason(command: str, level: float) -> Diagnostic:
    if level > 1.0 - 1e-6:
        return fault("first-drive.nothing-moved", command=command)
    return fault("first-drive.ended-early", command=command, command_percent=100.0 * level)


def _is_parallel(u: np.ndarray, d: np.ndarray) -> bool:
    """Return True if the two commands are parallel."""
    return bool(abs(abs(u @ d) - np.linalg.norm(u) * np.linalg.norm(d)) < 1e-6 * (u @ u + d @ d))


def _command_text(command: np.ndarray, vehicle_file: VehicleFile) -> str:
    if is_two_wheeled(vehicle_file):
        w = vehicle_file.vehicle.drivetrain.mix(command)
        return WHEEL_NAMES["left" if w[0] else "right", "forward" if w.sum() > 0.0 else "backward"]
    names = vehicle_file.command.names
    return ", ".join(f"{name} = {x:g}" for name, x in zip(names, command, strict=True) if x)


def _peak(x: np.ndarray) -> float:
    """Return the entry of the largest magnitude, with its sign."""
    return float(x[np.argmax(np.abs(x))])


def _gain_or_one(gain: float) -> float:
    return gain if np.isfinite(gain) and gain > 0.0 else 1.0
