"""Find side, direction and dead zone of each motor, by gyro and accelerometer, without encoders.

    ramp      only one motor, until the vehicle turns: the sign of ω shows its side or its plug             (1)
    push      both, so that the turns cancel: ∫ a dt shows forward or backward, and so side or plug         (2)
    sweep     the other motor keeps the vehicle turning; this one steps down from far above its ramp:
              d = d₀ + a Δω + b Δω²,   with Δω its share of the turn                                        (3)
    store     duty = d₀ + s r,  s = c/k, k = Δω/(d − d₀) at the top of the sweep, c = min (1 − d₀) k        (4)
    straight  both at r = 0.5: the remaining turn is ω = c r ε; each slope is corrected by half of ε, once  (5)
    held      the same with the heading held by the gyro (controllers/heading_hold.py): ω = 2 c u_ψ         (6)

A left motor that runs backwards and a right motor that runs forwards look alike in (1). In (3) the other motor
overcomes caster and bearings, so d₀ belongs only to this motor and its gears. With (4) a request r has the same effect
on both wheels, forward and backward. Each duty is kept for SETTLE_S before ω is measured. This is five times the
slowest lag of these vehicles (0.17 s, mechanical).
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import degrees
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from baqueano.contracts.values import TableRow
from baqueano.controllers.heading_hold import MAX_SPEED_SHARE, HeadingHold, pole_placement_gains
from baqueano.controllers.manual import ManualController
from baqueano.errors import AnswerNo, RobotUnreachable
from baqueano.messages.language import mark as N_, number, translate as _
from baqueano.messages.text_table import text_table
from baqueano.robot.uno import settings as uno_settings
from baqueano.robot.uno.frames import Settings, WheelCurve, Wiring
from baqueano.signals import NANOSECONDS, Estimate, Reference, seconds
from baqueano.vehicles.drivetrain import mix

if TYPE_CHECKING:
    from baqueano.robot.workshop.floor_tests import FloorTests, ImuSamples
    from baqueano.worlds.robot import Sample

MIN_TURN_RAD_S = 0.7  # ten times the vibration of these vehicles, 0.07
RAMP_PER_S = 0.25
EXTRA_DUTY = 0.25  # added to the duty of the ramp, so that a motor runs with certainty
LEVEL_COUNT = 7
SETTLE_S, MEAN_S, PAUSE_S = 0.8, 0.3, 0.4
PUSH_S, PUSHED_M_S = 0.4, 0.1  # 0.1 m/s: 3 times the integral of a vibration of 0.05 m/s²
STRAIGHT_REQUEST, STRAIGHT_S = 0.5, 1.5
MAX_DIFFERENCE = 0.05  # with a smaller difference of the wheels, any controller can keep straight
MAX_LAG_S, DEAD_TIME_S = 0.17, 0.1  # of (6): slowest lag, and dead time of motors and wire
MAX_TRIES = 3  # attempts to restore the former settings
WHEEL_DIRECTIONS = (N_("left forwards"), N_("left backwards"), N_("right forwards"), N_("right backwards"))
TURN_SIGNS = (-1.0, 1.0)  # turn by a wheel that runs forwards: the left wheel turns the vehicle right
Notify = Callable[[str], object]


class Sweep(NamedTuple):
    """The result of a sweep of one wheel in one direction."""

    starting_duty: float  # duty at which only this wheel moved the vehicle from rest
    dead_zone: float
    gain: float  # turn per duty beyond the dead zone [rad/s]
    rms: float  # residual of the fit (3), in duty


Sweeps = tuple[Sweep, ...]


@dataclass(frozen=True)
class MotorCalibration:
    """The result of `calibrate`, which is stored in the Uno.

    `wheel_differences` (2,) is the remaining relative difference of the wheels, forwards and backwards.
    `heading_errors_deg` (2,) is the heading error at the end of (6).
    """

    settings: Settings
    sweeps: Sweeps
    before: tuple[float, float]
    wheel_differences: tuple[float, float]
    turn_rates_dps: tuple[float, float]
    heading_errors_deg: tuple[float, float]

    @property
    def verdict(self) -> str:
        """Return BALANCED if the wheels differ by at most MAX_DIFFERENCE in both directions, else UNBALANCED."""
        return "BALANCED" if max(map(abs, self.wheel_differences)) <= MAX_DIFFERENCE else "UNBALANCED"

    def rows(self) -> list[TableRow]:
        """Return a row for the whole vehicle, then a row for each wheel and direction."""
        row = {
            "wiring": int(self.settings.wiring), "wheel_differences_before": self.before,
            "wheel_differences": self.wheel_differences, "turn_rates_dps": self.turn_rates_dps,
            "heading_errors_deg": self.heading_errors_deg,
        }  # fmt: skip
        directions = zip(WHEEL_DIRECTIONS, self.sweeps, self.settings.curves, strict=True)
        return [row, *({"wheel": name} | s._asdict() | curve._asdict() for name, s, curve in directions)]

    @classmethod
    def from_rows(cls, rows: list[TableRow]) -> "MotorCalibration":
        """Return the result from rows in JSON, the inverse of `rows`, with only the settings that `table` uses."""
        uno_row, *wheels = rows
        curves = tuple(WheelCurve(*(row[name] for name in WheelCurve._fields)) for row in wheels)
        sweeps = tuple(Sweep(*(row[name] for name in Sweep._fields)) for row in wheels)
        names = ("wheel_differences_before", "wheel_differences", "turn_rates_dps", "heading_errors_deg")
        pairs = (tuple(uno_row[name]) for name in names)
        return cls(Settings(wiring=uno_row["wiring"], curves=curves), sweeps, *pairs)

    def table(self) -> str:
        """Return wiring, dead zones, slopes and straight drives as text."""
        rows = (
            [_(name), f"{number(s.starting_duty):.0%}", f"{number(curve.dead_zone_permille / 10):.1f} %",
             f"{number(curve.slope_permille / 1000):.2f}", f"± {number(s.rms):.1%}"]
            for name, s, curve in zip(WHEEL_DIRECTIONS, self.sweeps, self.settings.curves, strict=True)
        )  # fmt: skip
        head = ["", _("starts"), _("dead zone"), _("slope"), _("fit")]
        lines = [wiring_text(self.settings.wiring), *text_table("<>>><", head, *rows)]
        names = _("forwards"), _("backwards")
        parts = self.before, self.wheel_differences, self.turn_rates_dps, self.heading_errors_deg
        directions = zip(names, *parts, strict=True)
        for name, b, e, w, h in directions:
            lines.append(
                _(
                    "straight {name}: turns {w:+.1f} °/s, wheels differ by {e:+.1%} (before the trim "
                    "{b:+.1%}); heading error by the gyro {h:+.1f}° after {straight_s:g} s",
                    name=name,
                    w=w,
                    e=e,
                    b=b,
                    h=h,
                    straight_s=STRAIGHT_S,
                )
            )
        if self.verdict == "UNBALANCED":
            lines.append(
                _(
                    "The wheels differ by more than {straight:.0%}: does a wheel slip or rub? Clean the "
                    "tyres, and calibrate again.",
                    straight=MAX_DIFFERENCE,
                )
            )
        return "\n".join([*lines, _("{verdict}; stored in the Uno", verdict=_(self.verdict))])


def wiring_text(wiring: int) -> str:
    """Return the wiring as text."""
    names = [flag.name.lower().replace("_", " ") for flag in Wiring if wiring & flag and flag.name]
    return _("wiring: {names}", names=", ".join(map(_, names)) or _("as in the guide"))


def calibrate(floor: "FloorTests", notify: Notify = lambda text: None) -> MotorCalibration:
    """Find and store the settings of both motors; keep other settings. The vehicle turns, and drives to and fro 0.5 m.

    Raise AnswerNo if a motor does not turn the vehicle, or if the measurements do not allow a result. After any error
    the former settings are stored again, even in an Uno that is stopped; `notify` reports if the Uno accepted them.
    """
    previous, curves = floor.uno.settings(floor.wait), (WheelCurve(),) * 4
    motors = Wiring.LEFT_MOTOR_REVERSED | Wiring.RIGHT_MOTOR_REVERSED | Wiring.MOTORS_SWAPPED
    neutral = previous._replace(wiring=previous.wiring & ~motors, curves=curves, dither_permille=0)
    floor.uno.arm()
    try:
        floor.check_upright()
        floor.store(neutral)
        wiring = _wiring(floor, notify)
        neutral = neutral._replace(wiring=neutral.wiring | wiring)
        floor.store(neutral)
        sweeps = _sweeps(floor, notify)
        settings = neutral._replace(curves=wheel_curves(sweeps), dither_permille=previous.dither_permille)
        return _equalise(floor, settings, sweeps, notify)
    except BaseException:
        _restore_settings(floor, previous, notify)
        raise
    finally:
        floor.uno.disarm()


def _restore_settings(floor: "FloorTests", previous: Settings, notify: Notify) -> None:
    """Store the former settings again. Ctrl-C ends the attempts.

    An Uno that is still armed, because a command was lost, refuses the settings. Each attempt therefore disarms it
    first.
    """
    try:
        for remaining_tries in reversed(range(MAX_TRIES)):
            floor.uno.disarm()
            floor.wait(0.05)
            try:
                floor.uno.store_settings(previous, floor.wait)
                break
            except RobotUnreachable:
                if not remaining_tries:
                    raise
        notify(_("the Uno keeps its old settings"))
    except (RobotUnreachable, KeyboardInterrupt):
        notify(
            _(
                "the Uno did not accept its former settings, and keeps those of an unfinished calibration. "
                "The motors may run in the wrong direction. When the Uno responds again, calibrate it "
                "again, or type its former settings: {as_typed}",
                as_typed=uno_settings.settings_command(previous),
            )
        )


def _wheel_duties(wheel: int, duty: float, other_duty: float = 0.0) -> tuple[float, float]:
    return (duty, other_duty) if wheel == 0 else (other_duty, duty)


def _ramp(floor: "FloorTests", wheel: int, direction: float) -> tuple[float, float]:
    """Increase the duty of one motor until the vehicle turns; return that duty and the sign of the turn.  (1) Raise
    AnswerNo if the vehicle does not turn."""
    bias = floor.rest_samples(0.3).gyro[:, 2].mean()
    levels: list[float] = []

    def duties(t_s: float) -> tuple[float, float]:
        levels.append(min(1.0, RAMP_PER_S * t_s))
        return _wheel_duties(wheel, direction * levels[-1])

    samples = floor.follow_duties(
        duties, 1.0 / RAMP_PER_S + 0.5, lambda sample: abs(sample.gyro[2] - bias) > MIN_TURN_RAD_S
    )
    turn = samples.gyro[-1, 2] - bias
    floor.hold_duties(0.0, 0.0, PAUSE_S)
    if abs(turn) <= MIN_TURN_RAD_S:
        raise AnswerNo.of(
            "calibrate.motor-does-not-turn",
            side=(N_("left"), N_("right"))[wheel],
            direction=N_("forwards") if direction > 0 else N_("backwards"),
        )
    return levels[-1], float(np.sign(turn))


def _wiring(floor: "FloorTests", notify: Notify) -> Wiring:
    """Return the flags of motor plugs that are reversed or swapped.  (1), (2)

    Raise AnswerNo if a motor does not turn the vehicle, or if the push is too weak.
    """
    notify(_("finding which motor is which: the vehicle will turn to both sides, then move forward and back"))
    (left, turn_l), (right, turn_r) = _ramp(floor, 0, 1.0), _ramp(floor, 1, 1.0)
    # signs of commands that run both wheels in one direction, if the motors are not swapped
    signs = -turn_l, turn_r
    duties = [min(1.0, duty + EXTRA_DUTY) * sign for duty, sign in zip((left, right), signs, strict=True)]
    push_m_s = _forward_speed_change(floor, duties) - _forward_speed_change(floor, [-d for d in duties])
    if abs(push_m_s) < PUSHED_M_S:
        raise AnswerNo.of(
            "calibrate.no-push", "baqueano robot calibrate imu", push_m_s=0.5 * abs(push_m_s), push_s=PUSH_S
        )
    wiring = Wiring(0)
    if push_m_s > 0.0:
        wiring |= Wiring.LEFT_MOTOR_REVERSED if turn_l > 0 else Wiring(0)
        wiring |= Wiring.RIGHT_MOTOR_REVERSED if turn_r < 0 else Wiring(0)
    else:  # the command for the left wheel turns the right wheel
        wiring |= Wiring.MOTORS_SWAPPED
        wiring |= Wiring.RIGHT_MOTOR_REVERSED if turn_l < 0 else Wiring(0)
        wiring |= Wiring.LEFT_MOTOR_REVERSED if turn_r > 0 else Wiring(0)
    notify(wiring_text(wiring))
    return wiring


def _forward_speed_change(floor: "FloorTests", duties: list[float]) -> float:
    """Run both motors with `duties`; return the integral of the forward acceleration [m/s] without its bias.  (2)"""
    bias = floor.rest_samples(0.3).accel[:, 0].mean()
    samples = floor.hold_duties(duties[0], duties[1], PUSH_S)
    floor.hold_duties(0.0, 0.0, PAUSE_S)
    return float(np.mean(samples.accel[:, 0] - bias) * PUSH_S)


def _sweeps(floor: "FloorTests", notify: Notify) -> Sweeps:
    """Return the sweeps of both wheels in both directions.  (3)"""
    start_duties = [_ramp(floor, wheel, direction)[0] for wheel in (0, 1) for direction in (1.0, -1.0)]
    sweeps = []
    for index, name in enumerate(WHEEL_DIRECTIONS):
        wheel, direction = divmod(index, 2)
        sign = 1.0 - 2.0 * direction
        other_duty = min(1.0, start_duties[2 * (1 - wheel) + 1 - direction] + EXTRA_DUTY)  # the other way
        sweeps.append(_sweep(floor, wheel, sign, start_duties[index], other_duty, name))
        notify(_("{name}: dead zone {dead_zone:.1%}", name=_(name), dead_zone=sweeps[-1].dead_zone))
    return tuple(sweeps)


def _sweep(
    floor: "FloorTests", wheel: int, sign: float, start_duty: float, other_duty: float, name: str
) -> Sweep:
    bias = floor.rest_samples(0.3).gyro[:, 2].mean()
    turn = sign * TURN_SIGNS[wheel]
    duties = [*np.linspace(min(1.0, start_duty + 0.4), max(0.02, start_duty - 0.1), LEVEL_COUNT), 0.0]
    turn_rates = []
    for duty in duties:
        wheel_duties = _wheel_duties(wheel, sign * float(duty), -sign * other_duty)
        samples = floor.hold_duties(*wheel_duties, SETTLE_S + MEAN_S).after(SETTLE_S)
        turn_rates.append(turn * float(np.mean(samples.gyro[:, 2] - bias)))
    floor.hold_duties(0.0, 0.0, PAUSE_S)
    return fit_sweep(start_duty, np.array(duties[:-1]), np.array(turn_rates[:-1]) - turn_rates[-1], name)


def fit_sweep(starting_duty: float, duties: np.ndarray, counts_added: np.ndarray, name: str) -> Sweep:
    """Return the fit (3) of `duties` (n,) to `counts_added` (n,), the Δω of each duty [rad/s].

    Only points with Δω over 0.1 rad/s and over a fifth of the largest Δω are used. Raise AnswerNo for fewer than four
    of these points, or for a dead zone above 0.7.
    """
    runs = counts_added > max(0.2 * counts_added.max(), 0.1)
    if runs.sum() < 4:
        raise AnswerNo.of(
            "calibrate.few-duties",
            name=name,
            duties=len(duties),
            low=duties.min(),
            high=duties.max(),
            count=runs.sum(),
        )
    powers = np.stack([np.ones(runs.sum()), counts_added[runs], counts_added[runs] ** 2], axis=1)
    line, *_rest = np.linalg.lstsq(powers, duties[runs], rcond=None)
    rms = float(np.sqrt(np.mean((powers @ line - duties[runs]) ** 2)))
    dead_zone = float(np.clip(line[0], 0.0, 1.0))
    if dead_zone > 0.7:
        raise AnswerNo.of("calibrate.dead-zone", name=name, dead_zone=dead_zone)
    top = float(counts_added.max())
    return Sweep(starting_duty, dead_zone, top / (float(duties[np.argmax(counts_added)]) - dead_zone), rms)


def wheel_curves(sweeps: Sweeps) -> tuple[WheelCurve, ...]:
    """Return the settings of each wheel and direction, in the order of the sweeps.  (4)"""
    reach = min((1.0 - s.dead_zone) * s.gain for s in sweeps)
    return tuple(WheelCurve(round(1000 * s.dead_zone), _clipped_slope(1e3 * reach / s.gain)) for s in sweeps)


def _clipped_slope(permille: float) -> int:
    return int(np.clip(round(permille), 100, 3000))


def _equalise(floor: "FloorTests", settings: Settings, sweeps: Sweeps, notify: Notify) -> MotorCalibration:
    """Drive straight, correct the slopes, drive straight again, and return the result.  (5), (6)"""
    notify(_("straight ahead: half a metre forward and back, three times"))
    reach = min((1.0 - s.dead_zone) * s.gain for s in sweeps)
    floor.store(settings)
    differences = tuple(_wheel_difference(floor, sign, reach)[0] for sign in (1.0, -1.0))
    curves = list(settings.curves)
    for index, curve in enumerate(curves):
        wheel, direction = divmod(index, 2)
        factor = 1.0 - TURN_SIGNS[wheel] * 0.5 * differences[direction]
        curves[index] = curve._replace(slope_permille=_clipped_slope(curve.slope_permille * factor))
    settings = settings._replace(curves=tuple(curves))
    floor.store(settings)
    (forwards, turn_f), (backwards, turn_b) = (_wheel_difference(floor, sign, reach) for sign in (1.0, -1.0))
    error_f, error_b = (_heading_error(floor, sign, reach) for sign in (1.0, -1.0))
    return MotorCalibration(
        settings, sweeps, (differences[0], differences[1]), (forwards, backwards),
        (degrees(turn_f), degrees(turn_b)), (degrees(error_f), degrees(error_b)),
    )  # fmt: skip


def _wheel_difference(floor: "FloorTests", sign: float, reach: float) -> tuple[float, float]:
    """Return ε of (5), positive if the right wheel is faster, and the turn [rad/s]."""
    bias, request = floor.rest_samples(0.3).gyro[:, 2].mean(), sign * STRAIGHT_REQUEST
    samples: ImuSamples = floor.hold_duties(request, request, STRAIGHT_S).after(SETTLE_S)
    turn = float(np.mean(samples.gyro[:, 2] - bias))
    floor.hold_duties(0.0, 0.0, PAUSE_S)
    return turn / (request * reach), turn


def _heading_error(floor: "FloorTests", sign: float, reach: float) -> float:
    """Return the heading error [rad] after a straight drive with the heading held.  (6)"""
    bias = floor.rest_samples(0.3).gyro[:, 2].mean()
    hand = ManualController(lambda: np.array([sign * STRAIGHT_REQUEST, 0.0, 0.0]))
    law = HeadingHold(hand, pole_placement_gains(2.0 * reach, MAX_LAG_S, DEAD_TIME_S), 1.0, MAX_SPEED_SHARE)
    state, psi, r, imu_ns = law.init(), 0.0, 0.0, -1

    def duties(t_s: float) -> tuple[float, float]:
        nonlocal state
        estimate = Estimate(
            round(t_s * NANOSECONDS), np.array([0.0, 0.0, psi]), np.array([0.0, 0.0, r]), np.zeros((6, 6))
        )
        reference = Reference(estimate.t_ns, estimate.eta, np.zeros(3), 0.0)
        state, command = law.step(state, reference, estimate)
        left, right = mix("two_wheels", command.u)
        return float(left), float(right)

    def integrate_gyro(sample: "Sample") -> bool:
        nonlocal psi, r, imu_ns
        r = float(sample.gyro[2] - bias)
        psi, imu_ns = psi + (r * seconds(sample.t_ns, imu_ns) if imu_ns >= 0 else 0.0), sample.t_ns
        return False

    floor.follow_duties(duties, STRAIGHT_S, integrate_gyro)
    floor.hold_duties(0.0, 0.0, PAUSE_S)
    return psi
