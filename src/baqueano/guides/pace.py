"""Change the pace of any guide: slow it down, pause it, and continue.

    |p_k − p_{k−1}| ≤ Δt / ramp_s,   p → pace                                                             (1)
    t′ = ∫ p dt,   η_r, ν_r = guide(t′),   ν_r ← p ν_r                                                    (2)

p is the present pace, Δt the length of a tick, t′ the time that the guide receives, η_r and ν_r its reference. At p = 0
the time t′ stops, so a pause does not skip any part of the route. From pace 1 to 0 the vehicle brakes within ramp_s.
With p = 1 the reference of the guide is unchanged.
"""

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from baqueano.contracts.values import Tree
from baqueano.parameter import document, parameter
from baqueano.signals import Estimate, Reference, seconds
from baqueano.vehicles.bounds import check_bounds


class PaceState(NamedTuple):
    """The present pace, the time t′ of the inner guide, and the state of the inner guide."""

    t_ns: int  # -1 before the first tick
    guide_ns: int  # t′
    pace: float
    guide: Tree


@document
@dataclass(frozen=True, slots=True, eq=False)
class GuideAtPace:
    """Guide that runs another guide at a pace from 0 (at rest) to 1 (full speed).

    Parameters
    ----------
    guide : Guide
        The inner guide, which receives the time t′.

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

    def __post_init__(self) -> None:
        check_bounds(self)

    def init(self) -> PaceState:
        """Return the state before the first tick, at full pace."""
        return PaceState(-1, 0, 1.0, self.guide.init())

    def step(self, state: Tree, estimate: Estimate) -> tuple[Tree, Reference]:
        """Return the state, and the reference of the guide at its time t′.  (2)"""
        if state.t_ns < 0:
            state = state._replace(t_ns=estimate.t_ns, guide_ns=estimate.t_ns)
        step = seconds(estimate.t_ns, state.t_ns) / self.ramp_s
        pace: float = min(max(self.pace, state.pace - step), state.pace + step)  # (1)
        guide_ns = state.guide_ns + round(pace * (estimate.t_ns - state.t_ns))
        own_estimate = estimate if guide_ns == estimate.t_ns else estimate._replace(t_ns=guide_ns)
        guide, reference = self.guide.step(state.guide, own_estimate)
        if pace != 1.0 or reference.t_ns != estimate.t_ns:
            reference = reference._replace(t_ns=estimate.t_ns, nu=pace * reference.nu)
        return PaceState(estimate.t_ns, guide_ns, pace, guide), reference
