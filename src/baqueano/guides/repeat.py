"""Repeat a route, as the paper's Teach and Repeat does: the reference is the teacher's pose at the same time.

    t = time since the first tick,   lap = ⌊τ / T⌋,   η_r = route(τ − lap T),   ν_r = τ̇ ν(τ − lap T)       (1)
    σ̇ = min(p + t / D, 1),   D = |ν(τ_0)| / a                             from σ = τ_0 at t = 0             (2)
    dτ/dσ = 1,   at the end 1 − (σ − σ_b) / D,   D = |ν(T)| / a,   σ_b = laps T − D / 2                     (3)

T is the duration of the route, η_r and ν_r the reference, a = acceleration_m_s2. In the paper τ = t. (2) accelerates a
drawn route, which begins at full speed, from the speed p |ν(τ_0)| of the vehicle. (3) brakes it to rest at its end. A
taught route begins and ends at rest, so D = 0. A vehicle at the start has τ_0 = 0; τ_0 > 0 if it joins the route later.
The reference does not wait for the vehicle. An open route is driven once. After the last lap the reference stays at the
end of the route, at rest. Source: Grotz et al., section Guidance System.
"""

from copy import copy
from dataclasses import dataclass, is_dataclass, replace
from typing import NamedTuple

import numpy as np

from baqueano.contracts import optional
from baqueano.contracts.blocks import Guide
from baqueano.contracts.values import Tree, Value
from baqueano.errors import Invalid, UsageError
from baqueano.geometry import wrap
from baqueano.guides.route import Route
from baqueano.parameter import document, parameter
from baqueano.signals import Estimate, Reference, seconds
from baqueano.vehicles.bounds import check_bounds

NOT_STARTED = -1
ENDLESS_S = 1e9  # 32 years
REST_M_S = 0.05  # a drive starts and ends slower: a taught route begins one tick before its vehicle moves
TINY = 1e-12


class RepeatState(NamedTuple):
    """State of a repeated route: when, where and at which pace the vehicle joined it."""

    start_ns: int  # NOT_STARTED until the first tick
    tau_s: float  # τ_0
    pace: float  # p, from 0 to 1


@document
@dataclass(frozen=True, slots=True, eq=False)
class Repeat:
    """Guide that follows a route over time, for `laps` laps.

    Parameters
    ----------
    laps : int
        Number of laps of a closed route; 0 repeats without end.
    closed : bool
        True if the last pose equals the first one.
    ends_in_motion : bool
        True if the last lap ends at the speed of the route, so that a lap taught in this way can be repeated.

    References
    ----------
    Grotz et al., section Guidance System: equation (1) of the module.

    Examples
    --------
    >>> from baqueano.signals import Estimate
    >>> from baqueano.guides.shapes import circle
    >>> guide = Repeat.along(circle(0.5, 0.2), laps=2)
    >>> state, _ = guide.step(guide.init(), Estimate(0, np.zeros(3), np.zeros(3), np.eye(6)))
    >>> _, reference = guide.step(state, Estimate(1_000_000_000, np.zeros(3), np.zeros(3), np.eye(6)))
    >>> print(reference.nu)
    [0.2 0.  0.4]
    """

    t_s: np.ndarray = parameter("s", "times of the route, from 0, increasing, (m,)", shape=None)
    eta: np.ndarray = parameter(
        "m, m, rad", "poses of the route in the map, heading continuous, (m, 3)", shape=None
    )
    nu: np.ndarray = parameter("m/s, m/s, rad/s", "velocities of the route, body frame, (m, 3)", shape=None)
    laps: int = 1
    closed: bool = False
    acceleration_m_s2: float = parameter(
        "m/s²",
        "acceleration at the start, and deceleration at the end of the last lap",
        low=0.01,
        default=0.3,
    )
    ends_in_motion: bool = False

    def __post_init__(self) -> None:
        for name in ("t_s", "eta", "nu"):
            object.__setattr__(self, name, np.array(getattr(self, name), dtype=float))
        m = len(self.t_s)
        if m < 2 or self.t_s.shape != (m,) or self.eta.shape != (m, 3) or self.nu.shape != (m, 3):
            shapes = {name: str(getattr(self, name).shape) for name in ("t_s", "eta", "nu")}
            raise Invalid.of("route.shapes", **shapes)
        if not all(np.all(np.isfinite(x)) for x in (self.t_s, self.eta, self.nu)):
            raise Invalid.of("route.not-finite")
        check_bounds(self)
        if self.t_s[0] != 0.0 or not np.all(np.diff(self.t_s) > 0.0):
            raise Invalid.of("guide.times", value=str(self.t_s[:3].tolist()))
        if self.laps < 0:
            raise Invalid.of("route.laps", value=self.laps)
        self.eta[:, 2] = np.unwrap(self.eta[:, 2])

    @classmethod
    def along(
        cls, route: Route, laps: int = 1, ends_in_motion: bool = False, **parameters: float
    ) -> "Repeat":
        """Return the guide that repeats `route`; `parameters` are further fields, such as `acceleration_m_s2`."""
        columns = route.t_s, route.eta, route.nu
        return cls(*columns, laps, route.closed, ends_in_motion=ends_in_motion, **parameters)

    def init(self) -> RepeatState:
        """Return the state before the first tick."""
        return RepeatState(NOT_STARTED, 0.0, 0.0)

    def entry_state(self, t_ns: Value, tau_s: Value, speed_m_s: Value) -> Tree:
        """Return the state of a vehicle that joins the route with this speed, at the time `tau_s` of the route."""
        pace = speed_m_s / np.maximum(np.interp(tau_s, self.t_s, self._speed()), TINY)
        return RepeatState(t_ns, tau_s, np.clip(pace, 0.0, 1.0))

    def step(self, state: RepeatState, estimate: Estimate) -> tuple[RepeatState, Reference]:
        """Return the state, and the reference: pose and velocity of the route at this time of the lap.  (1)"""
        state = self._entry_state(state, estimate)
        sigma_s, starting_pace = self._start(state, estimate.t_ns)
        tau_s, ending_pace, is_over = self._end(sigma_s)
        period, pace = self.t_s[-1], starting_pace * ending_pace
        phase = np.where(is_over > 0.0, period, tau_s - period * np.floor(tau_s / period))
        eta = [np.interp(phase, self.t_s, self.eta[:, i]) for i in range(3)]
        nu = [
            np.where(is_over > 0.0, 0.0, pace * np.interp(phase, self.t_s, self.nu[:, i])) for i in range(3)
        ]
        return state, Reference(
            estimate.t_ns, np.array([eta[0], eta[1], wrap(eta[2])]), np.array(nu), is_over
        )

    @property
    def end_s(self) -> float:
        """Return the time τ [s] at the end of the last lap; ENDLESS_S for a closed route without end."""
        laps = self.laps if self.closed else 1
        return laps * float(self.t_s[-1]) if laps > 0 else ENDLESS_S

    @property
    def duration_s(self) -> float:
        """Return the time [s] from rest at the start of the route to rest at its end.  (2), (3)"""
        return self.end_s + 0.5 * float(self.ramp_s(0.0) + self.braking_s)

    @property
    def braking_s(self) -> Value:
        """Return D [s] of the end of the last lap; 0 for a guide that ends in motion.  (3)"""
        return 0.0 if self.ends_in_motion else self.ramp_s(self.t_s[-1])

    def ramp_s(self, tau_s: Value) -> Value:
        """Return D [s], the time between rest and the speed of the route at `tau_s`; at most a lap.  (2), (3)"""
        return np.minimum(np.interp(tau_s, self.t_s, self._speed()) / self.acceleration_m_s2, self.t_s[-1])

    def _speed(self) -> np.ndarray:
        """Return the speed (m,) [m/s] of the route; 0 below REST_M_S."""
        speed = np.hypot(self.nu[:, 0], self.nu[:, 1])
        return np.where(speed < REST_M_S, 0.0, speed)

    def _entry_state(self, state: RepeatState, estimate: Estimate) -> RepeatState:
        """Return the state; at the first tick that of a vehicle at the start of the route, with its present speed."""
        direction = self.nu[0, :2] / max(float(self._speed()[0]), TINY)
        speed_m_s = np.maximum(direction[0] * estimate.nu[0] + direction[1] * estimate.nu[1], 0.0)
        at_start = Repeat.entry_state(self, estimate.t_ns, 0.0, speed_m_s)
        is_first = state.start_ns == NOT_STARTED
        start_ns, tau_s, pace = (np.where(is_first, a, b) for a, b in zip(at_start, state, strict=True))
        return state._replace(start_ns=start_ns, tau_s=tau_s, pace=pace)

    def _start(self, state: RepeatState, t_ns: Value) -> tuple[Value, Value]:
        """Return σ [s] at the time `t_ns`, and the pace σ̇.  (2)"""
        t = seconds(t_ns, state.start_ns)
        if np.isinf(
            self.acceleration_m_s2
        ):  # D = 0: the reference does not depend on the speed of the vehicle
            return state.tau_s + t, 1.0
        D = self.ramp_s(state.tau_s)
        starting_s = (1.0 - state.pace) * D
        x = np.clip(t, 0.0, starting_s)
        pace_rise = x / np.maximum(D, TINY)
        sigma_s = state.tau_s + x * (state.pace + 0.5 * pace_rise) + (t - x)
        return sigma_s, np.where(t < starting_s, state.pace + pace_rise, 1.0)

    def _end(self, sigma_s: Value) -> tuple[Value, Value, Value]:
        """Return τ [s] for σ, its slope dτ/dσ, and 1 after the end, else 0.  (3)"""
        D = self.braking_s
        begin_s = self.end_s - 0.5 * D
        x = np.clip(sigma_s - begin_s, 0.0, D)
        pace_fall, is_over = x / max(D, TINY), np.where(sigma_s >= begin_s + D, 1.0, 0.0)
        return np.minimum(sigma_s, begin_s) + x * (1.0 - 0.5 * pace_fall), 1.0 - pace_fall, is_over


def with_laps(guide: Guide, laps: int) -> Guide:
    """Return the guide with this number of laps, as a new object of the same class.

    A guide without an attribute `laps`, or already with this number, is returned unchanged. The fields of a dataclass
    are checked again. A plain class must read self.laps in its step. Raise UsageError if `laps` cannot be set.
    """
    present_laps = optional.attribute(guide, "laps")
    if present_laps is None or present_laps == laps:
        return guide
    try:
        if is_dataclass(type(guide)):
            return replace(guide, laps=laps)  # pyright: ignore[reportArgumentType, reportCallIssue]
        lap_guide: Tree = copy(guide)
        lap_guide.laps = laps
    except Invalid:
        raise
    except (AttributeError, TypeError, ValueError) as error:
        class_name = type(guide).__name__
        raise UsageError.of(
            "route.laps-kept", kind=class_name, former_laps=present_laps, laps=laps, cause=error
        ) from error
    return lap_guide
