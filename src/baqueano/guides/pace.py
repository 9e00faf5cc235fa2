"""Change the pace of any guide: slow it down, pause it, and continue.

    |p_k − p_{k−1}| ≤ Δt / ramp_s,   p → pace                                                             (1)
    t′ = ∫ p dt,   η_r, ν_r = guide(t′),   ν_r ← p ν_r                                                    (2)
    η_r = η,   ν_r = 0        while p = 0                                                                 (3)
    η_r, ν_r of a path (drive_to.py) from η to a next reference of the guide        when p becomes > 0    (4)

p is the present pace, Δt the length of a tick, t′ the time that the guide receives, η_r and ν_r its reference. At p = 0
the time t′ stops, so a pause does not skip any part of the route. From pace 1 to 0 the vehicle brakes within ramp_s.
With p = 1 the reference of the guide is unchanged. By (3), a vehicle that a person moves in a pause stays where it is
put. By (4), it then returns to the route in front of it. (4) needs `lead_in`, and does not apply near the reference.
"""

from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple

import numpy as np

from baqueano.contracts.values import Tree
from baqueano.guides.drive_to import GOAL_SPACING_M, DriveTo, DriveToState, join_length_m
from baqueano.parameter import document, parameter
from baqueano.signals import NANOSECONDS, Estimate, Reference, seconds
from baqueano.vehicles.bounds import check_bounds

GOAL_STEPS = 2  # references of the guide per GOAL_SPACING_M
MIN_SPEED_M_S = 0.05  # of a reference; a slower one is at rest
# the controller corrects less than this
RETURN_TOLERANCES = {"tolerance_m": 0.05, "tolerance_rad": np.radians(10.0)}


class PaceState(NamedTuple):
    """State of a guide with a pace."""

    t_ns: int  # -1 before the first tick
    guide_ns: int  # t′
    pace: float
    guide: Tree  # state of the inner guide
    lead_in: DriveToState | None = None  # the path of (4), until its end


@document
@dataclass(frozen=True, slots=True, eq=False)
class GuideAtPace:
    """Guide that runs another guide at a pace from 0 (at rest) to 1 (full speed).

    Parameters
    ----------
    guide : Guide
        The inner guide, which receives the time t′.
    lead_in : DriveTo, optional
        Limits of the path of (4); its goals are replaced.

    Examples
    --------
    >>> from baqueano.guides import Repeat
    >>> from baqueano.guides.shapes import circle
    >>> from baqueano.signals import Estimate
    >>> guide, here = GuideAtPace(Repeat.along(circle(0.5, 0.2)), pace=0.5), np.zeros(3)
    >>> state, _ = guide.step(guide.init(), Estimate(0, here, here, np.eye(6)))
    >>> state, reference = guide.step(state, Estimate(2_000_000_000, here, here, np.eye(6)))
    >>> print(reference.nu)
    [0.1 0.  0.2]
    """

    is_interpreted: ClassVar[bool] = True  # `pace` can change between two ticks; the inner guide is compiled
    inner_blocks: ClassVar[tuple[str, ...]] = ("guide",)

    guide: Tree
    pace: float = parameter("1", "pace", low=0.0, high=1.0, default=1.0)
    ramp_s: float = parameter("s", "time from 0 to 1", low=1e-3, high=60.0, default=0.6)
    lead_in: DriveTo | None = None

    def __post_init__(self) -> None:
        check_bounds(self)

    def init(self) -> PaceState:
        """Return the state before the first tick, at full pace."""
        return PaceState(-1, 0, 1.0, self.guide.init())

    def step(self, state: Tree, estimate: Estimate) -> tuple[Tree, Reference]:
        """Return the state, and the reference of the guide at its time t′, or that of a pause or a path.  (2)-(4)"""
        if state.t_ns < 0:
            state = state._replace(t_ns=estimate.t_ns, guide_ns=estimate.t_ns)
        step = seconds(estimate.t_ns, state.t_ns) / self.ramp_s
        pace: float = min(max(self.pace, state.pace - step), state.pace + step)  # (1)
        own_ns = round(pace * (estimate.t_ns - state.t_ns))
        if pace == 0.0:  # (3)
            rest = Reference(estimate.t_ns, estimate.eta, np.zeros(3), 0.0)
            return state._replace(t_ns=estimate.t_ns, pace=pace), rest
        if state.pace == 0.0 and self.lead_in is not None:
            state = self._with_lead_in(state, estimate)
        if state.lead_in is not None:
            assert self.lead_in is not None
            path_estimate = estimate._replace(t_ns=state.lead_in.t_ns + own_ns)
            path_state, reference = self.lead_in.step(state.lead_in, path_estimate)
            if not reference.at_end:
                reference = reference._replace(t_ns=estimate.t_ns, nu=pace * reference.nu)
                return state._replace(t_ns=estimate.t_ns, pace=pace, lead_in=path_state), reference
            if path_state.goal[1] > 0.0:  # the speed of the route at the end of the path
                pace *= min(path_state.v_m_s / float(path_state.goal[1]), 1.0)
            own_ns = 0
        guide_ns = state.guide_ns + own_ns
        own_estimate = estimate if guide_ns == estimate.t_ns else estimate._replace(t_ns=guide_ns)
        guide, reference = self.guide.step(state.guide, own_estimate)
        if pace != 1.0 or reference.t_ns != estimate.t_ns:
            reference = reference._replace(t_ns=estimate.t_ns, nu=pace * reference.nu)
        return PaceState(estimate.t_ns, guide_ns, pace, guide), reference

    def _with_lead_in(self, state: PaceState, estimate: Estimate) -> PaceState:
        """Return the state at the start of a path from the vehicle to one of the next references of the guide.  (4)"""
        assert self.lead_in is not None
        length_m = join_length_m(self.lead_in.radius_m, self.lead_in.ramp_m)
        guide_ns, entries = state.guide_ns, []
        guide, reference = self.guide.step(state.guide, estimate._replace(t_ns=guide_ns))
        step_m = GOAL_SPACING_M / GOAL_STEPS
        step_ns = round(NANOSECONDS * step_m / max(abs(float(reference.nu[0])), MIN_SPEED_M_S))
        while not reference.at_end and len(entries) * step_m <= length_m:
            entries.append((guide_ns, guide, reference))
            guide_ns += step_ns
            follower = estimate._replace(t_ns=guide_ns, eta=reference.eta, nu=reference.nu)
            guide, reference = self.guide.step(guide, follower)
        if not entries:
            return state
        nu = np.array([reference.nu for _, _, reference in entries], dtype=float)
        is_moving = np.abs(nu[:, 0]) > MIN_SPEED_M_S
        lead_in = replace(
            self.lead_in, goals=np.array([reference.eta for _, _, reference in entries], dtype=float),
            tau_s=np.arange(float(len(entries))), v_m_s=nu[:, 0],
            kappa_1_m=np.where(is_moving, nu[:, 2] / np.where(is_moving, nu[:, 0], 1.0), 0.0), **RETURN_TOLERANCES,
        )  # fmt: skip
        path_state, _ = lead_in.step(lead_in.init(), estimate._replace(t_ns=0))
        guide_ns, guide, _ = entries[round(float(path_state.goal[0]))]
        path = path_state if path_state.path.length_m > 0.0 else None
        return state._replace(guide_ns=guide_ns, guide=guide, lead_in=path)
