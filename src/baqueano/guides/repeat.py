"""Repeat a route, as the paper's Teach and Repeat does: the reference is the teacher's pose at the same time.

    t = time since the first tick,   lap = ⌊τ / T⌋,   η_r = route(τ − lap T),   ν_r = τ̇ ν(τ − lap T)       (1)
    τ̇ = 1,   at the end 1 − (t − t_b) / D,   D = |v_e| / braking_m_s2,   t_b = laps T − D / 2              (2)

T is the duration of the route, η_r and ν_r the reference, v_e the speed at which the route ends. In the paper τ = t.
(2) brakes a drawn route, which ends at full speed, to rest at its end; a taught route ends at rest, so D = 0. The
reference does not wait for the vehicle. An open route is driven once. After the last lap the reference stays at the end
of the route, at rest. Source: Grotz et al., section Guidance System.
"""

from copy import copy
from dataclasses import dataclass, is_dataclass, replace
from typing import NamedTuple

import numpy as np

from baqueano.contracts import optional
from baqueano.contracts.blocks import Guide
from baqueano.contracts.values import Tree, Value
from baqueano.diagnostics import fault
from baqueano.errors import Invalid, UsageError
from baqueano.geometry import wrap
from baqueano.guides.route import Route
from baqueano.parameter import document, parameter
from baqueano.signals import NANOSECONDS, Estimate, Reference, seconds
from baqueano.vehicles.bounds import check_bounds

BEFORE_START = -1


class RepeatState(NamedTuple):
    """State of a repeated route: the time at which it started."""

    start_ns: int  # BEFORE_START until the first tick; can be below 0 after the vehicle joined the route


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

    References
    ----------
    Grotz et al., section Guidance System: equation (1) of the module.

    Examples
    --------
    >>> from baqueano.signals import Estimate
    >>> from baqueano.guides.shapes import circle
    >>> guide = Repeat.along(circle(0.5, 0.2), laps=2)
    >>> _, reference = guide.step(guide.init(), Estimate(0, np.zeros(3), np.zeros(3), np.eye(6)))
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
    braking_m_s2: float = parameter("m/s²", "deceleration at the end of the last lap", low=0.01, default=0.3)

    def __post_init__(self) -> None:
        for name in ("t_s", "eta", "nu"):
            object.__setattr__(self, name, np.array(getattr(self, name), dtype=float))
        m = len(self.t_s)
        if m < 2 or self.t_s.shape != (m,) or self.eta.shape != (m, 3) or self.nu.shape != (m, 3):
            shapes = {name: str(getattr(self, name).shape) for name in ("t_s", "eta", "nu")}
            raise Invalid(fault("route.shapes", **shapes))
        if not all(np.all(np.isfinite(x)) for x in (self.t_s, self.eta, self.nu)):
            raise Invalid(fault("route.not-finite"))
        check_bounds(self)
        if self.t_s[0] != 0.0 or not np.all(np.diff(self.t_s) > 0.0):
            raise Invalid(fault("guide.times", value=str(self.t_s[:3].tolist())))
        if self.laps < 0:
            raise Invalid(fault("route.laps", value=self.laps))
        self.eta[:, 2] = np.unwrap(self.eta[:, 2])

    @classmethod
    def along(cls, route: Route, laps: int = 1, **parameters: float) -> "Repeat":
        """Return the guide that repeats `route`; `parameters` are further fields, such as `braking_m_s2`."""
        return cls(route.t_s, route.eta, route.nu, laps, route.closed, **parameters)

    def init(self) -> RepeatState:
        """Return the state before the first tick."""
        return RepeatState(BEFORE_START)

    def entry_state(self, t_ns: Value, tau_s: Value) -> Tree:
        """Return the state of a vehicle that joins the route at the time `tau_s` of the route."""
        return RepeatState(t_ns - np.rint(tau_s * NANOSECONDS))

    def step(self, state: RepeatState, estimate: Estimate) -> tuple[RepeatState, Reference]:
        """Return the state, and the reference: pose and velocity of the route at this time of the lap.  (1)"""
        start_ns: Value = np.where(state.start_ns == BEFORE_START, estimate.t_ns, state.start_ns)
        tau_s, pace, is_over = self._time_of_route(seconds(estimate.t_ns, start_ns))
        period = self.t_s[-1]
        phase = np.where(is_over > 0.0, period, tau_s - period * np.floor(tau_s / period))
        eta = [np.interp(phase, self.t_s, self.eta[:, i]) for i in range(3)]
        nu = [
            np.where(is_over > 0.0, 0.0, pace * np.interp(phase, self.t_s, self.nu[:, i])) for i in range(3)
        ]
        reference = Reference(estimate.t_ns, np.array([eta[0], eta[1], wrap(eta[2])]), np.array(nu), is_over)
        return RepeatState(start_ns), reference

    @property
    def braking_s(self) -> float:
        """Return D [s], the time in which the reference brakes at the end; at most for half of a lap.  (2)"""
        return min(float(np.hypot(*self.nu[-1, :2])) / self.braking_m_s2, float(self.t_s[-1]))

    def _time_of_route(self, t: Value) -> tuple[Value, Value, Value]:
        """Return τ [s] at the time t [s], the pace τ̇, and 1 after the end, else 0.  (2)"""
        if self.laps == 0 and self.closed:
            return t, 1.0, 0.0
        end_s, D = (self.laps if self.closed else 1) * self.t_s[-1], self.braking_s
        is_over: Value = np.where(t >= end_s + 0.5 * D, 1.0, 0.0)
        if D == 0.0:
            return t, 1.0, is_over
        x = np.clip(t - (end_s - 0.5 * D), 0.0, D)
        return np.minimum(t, end_s - 0.5 * D) + x * (1.0 - 0.5 * x / D), 1.0 - x / D, is_over


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
        guide_of_laps: Tree = copy(guide)
        guide_of_laps.laps = laps
    except (AttributeError, TypeError, ValueError) as error:
        class_name = type(guide).__name__
        raise UsageError(
            fault("route.laps-kept", kind=class_name, before=present_laps, laps=laps, cause=error)
        ) from error
    return guide_of_laps
