"""The drivetrain, from the sent command to the effort on the body, in the order of the hardware:

    delayed   u_d = the commands of delay_s ago, one after the other during the tick (delay.py)           (1)
    mixed     w = (u_x − u_ψ, u_x + u_ψ)          left and right wheel, if mixing = "two_wheels"          (2)
    limited   w ← clip(w, −limit, limit), w in whole steps of the timer that makes the pulses             (3)
    battery   w ← w (1 + κ (V/V₀ − 1)) (1 − sag · mean|w|)     of motors; the servos (last channels) keep w     (4)
    dead zone w ← max(w − forward, 0) + min(w + backward, 0)                                              (5)
    gain      w ← gain · w / (1 − c + c |w before the dead zone|)      c = 1: coasts between two pulses   (6)
    lag       λ ẇ_l = w + λ ė − w_l, exact over each segment of a tick (effort.py); servos have their own λ   (7)
    unmixed   u_x = (l + r)/2, u_y = 0, u_ψ = (r − l)/2           l, r: left and right channel            (8)

All quantities are in the unit of u; with the defaults the effort is the command. Only (2) and (8) mix wheels; the
connection to the robot uses them too. V is the voltage: with battery = "logged", it is the channel `battery` of
the run [V]. κ is `battery_effect`, V₀ `battery_nominal_v`; e is the back-EMF of state.py. Derivation:
docs/derivations/vehicles.md.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from baqueano.contracts.values import Value
from baqueano.errors import Invalid
from baqueano.parameter import INF, document, parameter, parameters
from baqueano.vehicles.bounds import check_bounds
from baqueano.vehicles.delay import (
    INITIAL_STEP_S,
    CommandSegment,
    check_delay,
    command_segments,
    with_newest_value,
)
from baqueano.vehicles.effort import Effort, direct_effort, lagged_effort

MIN_LAG_S = 1e-100  # a tick divided by a smaller lag exceeds the range of floating-point numbers
MIXINGS = ("none", "two_wheels")
MIN_DUTY = 1e-3  # keeps (6) finite without a command
TURN_RESERVE = 0.02  # of a wheel's range, kept for the turn
DEAD_ZONE_RAMP = 0.02  # of a channel: below this, the inverse of a dead zone is a ramp without a jump
BATTERY_MODES = ("steady", "logged")
LARGEST_DELAY_S = 2.0
# the cost has a kink at every whole tick; the distance is half a period of the fastest command that is followed, 20 Hz
DELAY_STARTS_S = tuple((k + 0.5) * 0.025 for k in range(10))


class DrivetrainState(NamedTuple):
    """State of a drivetrain between two ticks.

    Attributes
    ----------
    past_rows : ndarray (delay_slots, n) [unit of u]
        Commands of the previous ticks, newest first.
    steps_s : ndarray (delay_slots,)
        Duration of each of the previous ticks.
    lag_state : ndarray (k,) [unit of u]
        Channels after the lag of the motors and servos.
    """

    past_commands: np.ndarray
    steps_s: np.ndarray
    lag_state: np.ndarray


def mix(mixing: str, u: np.ndarray) -> np.ndarray:
    """Return the channels (k,) of a command `u` (n,): left and right wheel for "two_wheels".  (2)"""
    if mixing == "none":
        return u
    return np.array([u[0] - u[2], u[0] + u[2]])


def quantise(z: np.ndarray, step: Value) -> np.ndarray:
    """Return z (m,) rounded to whole steps (m,); a step of 0 leaves z unchanged."""
    divisor = np.where(step > 0.0, step, 1.0)
    return np.where(step > 0.0, divisor * np.floor(z / divisor + 0.5), z)


def unmix(mixing: str, w: np.ndarray) -> np.ndarray:
    """Return the command (n,) that corresponds to channels (k,); u_y of two wheels is 0.  (8)"""
    if mixing == "none":
        return w
    return np.array([0.5 * (w[0] + w[1]), 0.0, 0.5 * (w[1] - w[0])])


@document
@dataclass(frozen=True, slots=True, eq=False)
class Drivetrain:
    """Drivetrain from the command u (n,) to the effort (n,).

    Arrays contain one value per channel: (k,), or (1,) for all channels. k is 2 for two wheels, else n. The first six
    fields are configuration and are never traced.

    Parameters
    ----------
    mixing : str
        "none", or "two_wheels": the channels are a left and a right motor.
    battery : str
        "steady", or "logged": a fit reads the voltage from the run.
    commands : int
        n, the length of the command.
    servos : int
        Number of servos; they are the last channels.
    delay_slots : int
        Number of past rows that are stored for the delay: delay_s · rows per second (rk4.row_rate_hz), rounded up.
    has_lag : bool
        True if lag_s > 0; set automatically.
    has_servo_lag : bool
        True if servo_lag_s > 0; set automatically.
    has_back_emf : bool
        True if back_emf_share > 0; set automatically.

    Notes
    -----
    Equations (1)-(8) of the module, in the order of the hardware.

    Examples
    --------
    >>> motors = Drivetrain(mixing="two_wheels", dead_zone_forward=np.array([0.1]))
    >>> _, effort = motors.step(motors.init(), np.array([0.5, 0.0, 0.0]), 0.01)
    >>> print(effort.mean)
    [0.4 0.  0. ]
    """

    mixing: str = "none"
    battery: str = "steady"
    commands: int = 3
    servos: int = 0
    delay_slots: int = 0
    has_lag: bool = False
    has_servo_lag: bool = False
    has_back_emf: bool = False
    limit: np.ndarray = parameter(
        "unit of u", "largest magnitude of a channel", low=0.0, default=(INF,), shape=None, role="fixed",
        shown_by="commands beyond what the {nth} motor can do", symbol="u_{m}",
    )  # fmt: skip
    duty_step: float = parameter(
        "unit of u", "step of a channel: 1/255 of a duty with 8 bits; 0 for none", low=0.0, high=1.0, default=0.0,
        role="fixed", symbol="q_{u}",
    )  # fmt: skip
    dead_zone_forward: np.ndarray = parameter(
        "unit of u", "channel below which a motor does not turn, forward", low=0.0, high=1e6, default=(0.0,),
        shape=None, role="term", shown_by="forward commands just above the dead zone of the {nth} motor",
        symbol="z_{f}", label="dead zone forward, {nth} motor",
    )  # fmt: skip
    dead_zone_backward: np.ndarray = parameter(
        "unit of u", "channel below which a motor does not turn, backward", low=0.0, high=1e6, default=(0.0,),
        shape=None, role="term", shown_by="backward commands just above the dead zone of the {nth} motor",
        symbol="z_{b}", label="dead zone backward, {nth} motor",
    )  # fmt: skip
    gain: np.ndarray = parameter(
        "1", "slope of a channel: motors are not equal", low=0.0, high=1e3, default=(1.0,), shape=None,
        role="fixed", symbol="g",
    )  # fmt: skip
    coast: np.ndarray = parameter(
        "1", "1 if a motor coasts between pulses, 0 if it brakes (kinematic)", low=0.0, high=1.0,
        default=(0.0,), shape=None, role="term", symbol="g_{c}",
    )  # fmt: skip
    lag_s: float = parameter(
        "s", "time constant of the motors", low=0.0, high=10.0, default=0.0, role="term",
        term="motor lag", start=(0.05,), shown_by="sudden changes of the command", symbol=r"\tau",
        label="lag of the motors",
    )  # fmt: skip
    servo_lag_s: float = parameter(
        "s", "time constant of the servos", low=0.0, high=10.0, default=0.0, role="term",
        term="servo lag", start=(0.05,), shown_by="steering during stops, followed by starts",
        symbol=r"\tau_{s}", label="lag of the servo",
    )  # fmt: skip
    delay_s: float = parameter(
        "s", "delay from command to motor", low=0.0, high=LARGEST_DELAY_S, default=0.0,
        role="fixed", neutral=0.0, term="delay", start=DELAY_STARTS_S, shown_by="sudden changes of the command",
        symbol=r"\Delta t",
    )  # fmt: skip
    back_emf_share: float = parameter(
        "1", "fraction of the viscous drag that is back-EMF, behind the lag of the motors", low=0.0, high=10.0,
        default=0.0, role="term", term="back-EMF behind the lag", start=(1.0,), requires="lag_s",
        shown_by="sudden changes of the command", symbol="e", label="back-EMF behind the lag",
    )  # fmt: skip
    battery_v: float = parameter("V", "voltage of the battery", low=0.1, high=1e3, default=6.0, role="fixed")
    battery_nominal_v: float = parameter(
        "V", "voltage for which the actuator matrix is valid", low=0.1, high=1e3, default=6.0, role="fixed"
    )
    battery_effect: float = parameter(
        "1", "fraction of a change of voltage that reaches the motors, κ", low=0.0, high=3.0, default=1.0,
        role="fixed", shown_by="a voltage that changes: runs with a full and with an empty battery",
        symbol="b",
    )  # fmt: skip
    sag: float = parameter(
        "1", "fraction of the voltage lost at full command", low=0.0, high=0.9, default=0.0, role="fixed",
        neutral=0.0, term="battery sag", start=(0.05,), shown_by="small commands and the largest ones",
        symbol="s_{b}",
    )  # fmt: skip

    def __post_init__(self) -> None:
        if self.mixing not in MIXINGS:
            raise Invalid.of("drivetrain.mixing", value=repr(self.mixing), valid=MIXINGS)
        if self.battery not in BATTERY_MODES:
            raise Invalid.of("drivetrain.battery", value=repr(self.battery), valid=BATTERY_MODES)
        if self.mixing == "two_wheels" and self.commands != 3:
            raise Invalid.of("drivetrain.commands", commands=self.commands)
        check_bounds(self)
        check_delay("Drivetrain", self.delay_s, self.delay_slots)
        self._check_channels()
        for name, flag in (("lag_s", "has_lag"), ("servo_lag_s", "has_servo_lag")):
            lag_s = getattr(self, name)
            if getattr(self, flag) and lag_s == 0.0:
                raise Invalid.of("drivetrain.lag", name=name, flag=flag)
            if 0.0 < lag_s < MIN_LAG_S:
                raise Invalid.of("drivetrain.lag-tiny", name=name, lag_s=lag_s)
            if lag_s > 0.0:
                object.__setattr__(self, flag, True)
        if self.back_emf_share > 0.0:
            object.__setattr__(self, "has_back_emf", True)

    def _check_channels(self) -> None:
        k = self.channels
        for name, p in parameters(self):
            shape = np.shape(getattr(self, name))
            if p.shape is None and shape not in ((1,), (k,)):
                raise Invalid.of(
                    "drivetrain.shape",
                    name=name,
                    value=str(shape),
                    channels=k,
                    mixing=repr(self.mixing),
                    commands=self.commands,
                )

    @property
    def channels(self) -> int:
        """Return k, the number of motors or servos behind the mix."""
        return 2 if self.mixing == "two_wheels" else self.commands

    @property
    def driven_axes(self) -> tuple[int, ...]:
        """Return the axes along which a command acts: 0 forward, 1 sideways, 2 turning. Two wheels roll sideways
        only with their vehicle."""
        return (0, 2) if self.mixing == "two_wheels" else (0, 1, 2)

    @property
    def longest_lag_s(self) -> Value:
        """Return the longer lag of motors and servos [s]."""
        return np.maximum(self.lag_s, self.servo_lag_s) if self.has_servo_lag else self.lag_s

    def mix(self, u: np.ndarray) -> np.ndarray:
        """Return the channels (k,) of a command (n,).  (2)"""
        return mix(self.mixing, u)

    def unmix(self, w: np.ndarray) -> np.ndarray:
        """Return the command (n,) that corresponds to channels (k,).  (8)"""
        return unmix(self.mixing, w)

    def init(self) -> DrivetrainState:
        """Return the state of motors that have been off for a long time."""
        past_rows = np.zeros((self.delay_slots, self.commands))
        return DrivetrainState(past_rows, INITIAL_STEP_S * np.ones(self.delay_slots), np.zeros(self.channels))

    def steady_state(self, u: np.ndarray) -> DrivetrainState:
        """Return the state of motors that have had the command `u` (n,) for a long time."""
        rest_state = self.init()
        return rest_state._replace(
            past_commands=rest_state.past_commands + u,
            lag_state=self.static_response(self.mix(u)) if self._has_any_lag else rest_state.lag_state,
        )

    def step(
        self, state: DrivetrainState, u: np.ndarray, dt_s: float, emf_rate: np.ndarray | None = None
    ) -> tuple[DrivetrainState, Effort]:
        """Return the state and the effort over a tick of `dt_s`, during which `u` (n,) is sent.  (1)-(8)
        `emf_rate` (n,) is ė, the rate of change of the back-EMF [unit of u per s].
        """
        pieces = command_segments(u, state.past_commands, state.steps_s, self.delay_s, dt_s)
        pieces = [piece._replace(u=self.static_response(self.mix(piece.u))) for piece in pieces]
        if emf_rate is not None and self.has_lag:
            lead = self.lag_s * self.mix(emf_rate)
            pieces = [piece._replace(u=piece.u + lead) for piece in pieces]
        lag = (
            self._lagged(pieces, state.lag_state, dt_s) if self._has_any_lag else direct_effort(pieces, dt_s)
        )
        next_state = DrivetrainState(
            with_newest_value(state.past_commands, u),
            with_newest_value(state.steps_s, dt_s),
            lag.last if self._has_any_lag else state.lag_state,
        )
        return next_state, Effort(*map(self.unmix, lag))

    def _lagged(self, pieces: list[CommandSegment], lag_state: np.ndarray, dt_s: float) -> Effort:
        """Return the effort of the channels (k,): motors and servos, each behind its lag.  (7)"""

        def part(channels: slice, lag_s: Value, has_lag: bool) -> Effort:
            inputs = [piece._replace(u=piece.u[channels]) for piece in pieces]
            return (
                lagged_effort(inputs, lag_state[channels], lag_s, dt_s)
                if has_lag
                else direct_effort(inputs, dt_s)
            )

        motors = part(self._motors, self.lag_s, self.has_lag)
        if not self.servos:
            return motors
        servos = part(slice(self.channels - self.servos, None), self.servo_lag_s, self.has_servo_lag)
        return Effort(*map(np.concatenate, zip(motors, servos, strict=True)))

    def static_response(self, w: np.ndarray) -> np.ndarray:
        """Return the input (k,) of the motor lag for the channels `w` (k,).  (3)-(6)"""
        w = np.clip(quantise(w, self.duty_step), -self.limit, self.limit)
        w = w * self._supply(1.0 - self.sag * np.mean(np.abs(w[self._motors])))
        duty = np.maximum(np.abs(w), MIN_DUTY)
        # in this order the derivative at 0 is 1 without a dead zone
        w = w - np.minimum(self.dead_zone_forward, np.maximum(-self.dead_zone_backward, w))
        return self.gain * w / (1.0 - self.coast + self.coast * duty)

    def inverse(self, effort: np.ndarray) -> np.ndarray:
        """Return the command (n,) that causes `effort` (n,) after delay and lag: the inverse of (2) and (4)-(6).

        At 0 the step of the dead zone is replaced by a ramp of width DEAD_ZONE_RAMP. The caller applies `limit`.
        """
        w = self.mix(effort)
        magnitude, zone = np.abs(w), np.where(w > 0.0, self.dead_zone_forward, self.dead_zone_backward)
        zone = zone / np.maximum(magnitude / self.gain, DEAD_ZONE_RAMP)
        duty = w * (1.0 - self.coast + zone) / np.maximum(self.gain - self.coast * magnitude, MIN_DUTY)
        # mean|w| before the sag solves sag · x² − x + mean_effort = 0
        mean_effort = np.mean(np.abs(duty / self._supply(1.0))[self._motors])
        sag_factor = 0.5 + 0.5 * np.sqrt(np.maximum(1.0 - 4.0 * self.sag * mean_effort, 0.0))
        return self.unmix(duty / self._supply(sag_factor))

    def without_idle_zones(self, u: np.ndarray) -> "Drivetrain":
        """Return a drivetrain without the dead zones that contain the channels of `u` (n,), or self if none does."""
        w = self.mix(u)
        is_idle = (w < self.dead_zone_forward) & (w > -self.dead_zone_backward)
        if not np.any(is_idle):
            return self
        forward, backward = (
            np.where(is_idle, 0.0, z) for z in (self.dead_zone_forward, self.dead_zone_backward)
        )
        return replace(self, dead_zone_forward=forward, dead_zone_backward=backward)

    def prioritise_turn(self, u: np.ndarray) -> np.ndarray:
        """Return the command (n,) with its speed reduced so that no wheel reaches its limit; u_ψ is not reduced.

        A wheel at its limit would turn the vehicle off its path. Without a mix of wheels, return `u` unchanged.
        """
        if self.mixing == "none":
            return u
        headroom = np.maximum((1.0 - TURN_RESERVE) * np.min(self.limit) - np.abs(u[2]), 0.0)
        return np.array([np.clip(u[0], -headroom, headroom), u[1], u[2]])

    @property
    def _has_any_lag(self) -> bool:
        return self.has_lag or self.has_servo_lag

    @property
    def _motors(self) -> slice:
        """Return the slice of the channels that depend on the battery: all channels except the servos."""
        return slice(0, self.channels - self.servos)

    def _supply(self, sag_factor: Value) -> Value:
        """Return the relative voltage of each channel (k,), or of all channels (); `sag_factor` multiplies it.  (4)"""
        supply = sag_factor * (1.0 + self.battery_effect * (self.battery_v / self.battery_nominal_v - 1.0))
        if not self.servos:
            return supply
        return np.where(np.arange(self.channels) < self.channels - self.servos, supply, 1.0)
