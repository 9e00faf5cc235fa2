"""The PD controller exactly as in the paper.

    e = J(ψ)⁻¹ (η_r − η)                                                                                  (1)
    u_x = α e_x,   u_y = 0,   u_ψ = β e_ψ + γ ė_ψ                                                         (2)

η is the pose, η_r the reference, e the error in the body frame, J(ψ) the rotation from body to map; α, β, γ are gains.

Source: Grotz et al., section Base Controller. The paper does not define how to compute ė_ψ. Here it is the wrapped
difference of e_ψ between two ticks, divided by the time between them; at the first tick it is 0.

The law does not correct e_y: an offset from the path remains (errata 10). Pd is the baseline for the other
controllers.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from baqueano.errors import Invalid
from baqueano.geometry import pose_error, wrap
from baqueano.parameter import INF, document, parameter
from baqueano.signals import Command, Estimate, Reference, seconds
from baqueano.vehicles.bounds import check_bounds


class PdState(NamedTuple):
    """Memory of a PD controller: the previous tick, for the derivative.

    Attributes
    ----------
    t_ns : int
        Time of the tick; -1 before the first.
    e_psi : float [rad]
        Error of the heading.
    """

    t_ns: int
    e_psi: float


@document
@dataclass(frozen=True, slots=True, eq=False)
class Pd:
    """PD controller of the paper: proportional along the path, proportional and derivative in heading.

    `PdFeedforward` is usually better: `Pd` never corrects the cross-track error (errata 10).

    References
    ----------
    Grotz et al., section Base Controller: equations (1) and (2) of the module.

    Examples
    --------
    >>> from baqueano.signals import Estimate, Reference
    >>> law = Pd(alpha=4.0, beta=1.0, gamma=0.1, limit=np.ones(3))
    >>> here = Estimate(0, np.zeros(3), np.zeros(3), np.eye(6))
    >>> _, command = law.step(law.init(), Reference(0, np.array([0.1, 0.0, 0.2]), np.zeros(3), 0.0), here)
    >>> print(command.u)
    [0.4 0.  0.2]
    """

    alpha: float = parameter("unit of u per m", "gain α of the along-track error, e_x")
    beta: float = parameter("unit of u per rad", "gain β of the heading error e_ψ")
    gamma: float = parameter("unit of u per rad/s", "gain γ of the rate of change of e_ψ", default=0.0)
    limit: np.ndarray = parameter(
        "unit of u",
        "largest command: (u_x, u_y, u_ψ), or (throttle, servo)",
        low=0.0,
        default=(INF, INF, INF),
        shape=None,
    )

    def __post_init__(self) -> None:
        check_bounds(self)
        if self.limit.shape not in ((2,), (3,)):
            raise Invalid.of("pd.limit", value=str(self.limit.shape))

    def init(self) -> PdState:
        """Return the state before the first tick."""
        return PdState(-1, 0.0)

    def step(self, state: PdState, reference: Reference, estimate: Estimate) -> tuple[PdState, Command]:
        """Return the state and the command (n,) towards the reference.  (1), (2)"""
        e = pose_error(reference.eta, estimate.eta)
        dt_s = seconds(estimate.t_ns, state.t_ns)
        has_past = (state.t_ns >= 0) & (dt_s > 0.0)
        e_psi_dot = np.where(has_past, wrap(e[2] - state.e_psi) / np.where(has_past, dt_s, 1.0), 0.0)
        u_x = self.alpha * e[0]
        u_psi = self.beta * e[2] + self.gamma * e_psi_dot
        u = np.array([u_x, 0.0, u_psi]) if len(self.limit) == 3 else np.array([u_x, u_psi])
        return PdState(estimate.t_ns, e[2]), Command(estimate.t_ns, np.clip(u, -self.limit, self.limit))
