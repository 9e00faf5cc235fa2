"""The unscented Kalman filter: it evaluates g and h at points around the mean, and does not need derivatives.

The state is x = (η, ν, ν̇): pose, velocity and acceleration. ekf.py defines g and h, in its default mode.

sigma_points.py returns the mean m of a function, its linear part o and its even part ē. With x = x̄ ⊞ L ξ, L Lᵀ = P,
kalman.py corrects the standard normal ξ, and ē is added to the noise. R is the process noise, Q the noise of z:

    x̄ = g(x) ⊞ m,   P̄ = o oᵀ + ē ēᵀ + R                                                                  (1)
    y = z ⊟ (h(x̄) ⊞ m),   H = o,   noise Q + ē ēᵀ,   x̄ ← x̄ ⊞ L Δ,   P ← L P_ξ Lᵀ                         (2)

(2) is the standard correction with P_xz = L oᵀ (Julier and Uhlmann 1997), in Joseph's form.
"""

from dataclasses import dataclass

import numpy as np

from baqueano.contracts.blocks import SensorBlocks
from baqueano.contracts.optional import is_dynamic
from baqueano.errors import Invalid
from baqueano.estimators.covariance import block_diagonal, covariance, mirror_upper
from baqueano.estimators.ekf import Belief, move_by_model
from baqueano.estimators.kalman import Gaussian, boxplus, correct
from baqueano.estimators.pauses import (
    FilterRow,
    filter_row,
    row_effort,
    rows_before,
    step_rows,
    unpredicted_cov,
)
from baqueano.estimators.readings.gate import is_within_gate
from baqueano.estimators.readings.sensor_numbers import age_s, check_use, measured_channels, past_motion
from baqueano.estimators.sigma_points import propagate
from baqueano.geometry import wrap
from baqueano.parameter import document, parameter
from baqueano.sensors.sampling import difference
from baqueano.signals import Estimate, Slot, Tick
from baqueano.symbolic import tree_where
from baqueano.vehicles.bounds import check_bounds
from baqueano.vehicles.effort import Effort
from baqueano.vehicles.state import DynamicVehicle


@document
@dataclass(frozen=True, slots=True, eq=False)
class Unscented:
    """Kalman filter without derivatives, for a model that is nonlinear within its uncertainty.

    `AugmentedEkf` is usually better.

    Parameters
    ----------
    vehicle : DynamicVehicle
        The model with nu_dot: a block of vehicles/.
    sensors : NamedTuple of Sensor
        The sensors, by name.
    use : tuple of str
        Sensors that correct the state; the others are only recorded.

    References
    ----------
    Julier and Uhlmann 1997: equations (1), (2) of the module.

    Examples
    --------
    >>> from baqueano.signals import Tick, empty_slots
    >>> robot = bq.load("small")
    >>> ukf = Unscented(robot.vehicle, robot.sensors, 1e-4 * np.eye(6))
    >>> belief, estimate = ukf.step(ukf.init(), Tick(10_000_000, np.zeros(3), empty_slots({"imu": 3})))
    >>> estimate.cov.shape
    (6, 6)
    """

    vehicle: DynamicVehicle
    sensors: SensorBlocks
    process_noise_cov: np.ndarray = parameter(
        "(m/s, m/s, rad/s, m/s², m/s², rad/s²)²", "R of (ν, ν̇) per tick at rate_hz, (6, 6)", shape=(6, 6)
    )
    rate_hz: float = parameter("Hz", "the rate for which process_noise_cov is given", low=1e-3, default=100.0)
    gate_sigma: float = parameter(
        "1", "a measurement further from its prediction than this is excluded", low=0.0, default=4.0
    )
    use: tuple[str, ...] = ("imu",)
    disturbance_time_s: float = parameter(
        "s", "T_d, time constant with which an unexplained acceleration decays", low=1e-6, default=0.5
    )
    initial_std: np.ndarray = parameter(
        "m, m, rad, m/s, m/s, rad/s, m/s², m/s², rad/s²", "standard deviations of (η, ν, ν̇) at the start", low=0.0,
        default=(1e-3, 1e-3, 1e-3, 1e-2, 1e-2, 1e-2, 0.1, 0.1, 0.1), shape=(9,),
    )  # fmt: skip

    def __post_init__(self) -> None:
        check_bounds(self)
        check_use(self.sensors, self.use)
        if not is_dynamic(self.vehicle):
            raise Invalid.of("unscented.no-acceleration", vehicle=type(self.vehicle).__name__)
        R = covariance(self.process_noise_cov, 6, "process_noise_cov")
        object.__setattr__(self, "process_noise_cov", R)

    def init(self, eta: np.ndarray | None = None, nu: np.ndarray | None = None) -> Belief:
        """Return the belief at `eta` (3,) in the map with `nu` (3,) in the body; by default at rest at the origin."""
        eta, nu = (np.zeros(3) if x is None else np.array(x, dtype=float) for x in (eta, nu))
        effort = np.zeros(self.vehicle.commands)
        mean = np.concatenate([eta, nu, self.vehicle.nu_dot(nu, effort, eta[2])])
        return Belief(-1, mean, np.diag(self.initial_std**2), effort, self.vehicle.drivetrain.init())

    step, rows_before = step_rows, rows_before  # `row` for a tick, and for the parts of a long tick

    def row(self, belief: Belief, tick: Tick) -> tuple[Belief, Estimate]:
        """Return the belief and the estimate after a row. Beyond the longest row only the covariance is predicted."""
        row = filter_row(belief.t_ns, tick, self.rate_hz)
        drivetrain, effort = row_effort(self.vehicle, belief, row)
        x, y, s, w = self._predict(belief, effort, row), [], [], []
        for name in self.use:
            x, innovation, S, weight = self._correct(name, x, getattr(tick.sensors, name))
            y, s, w = [*y, innovation], [*s, S], [*w, weight]
        belief = tree_where(row.is_new, Belief(tick.t_ns, *x, effort.last, drivetrain), belief)
        innovations = (np.concatenate(y), block_diagonal(s), np.concatenate(w)) if y else ()
        mean, cov = belief.mean, belief.cov
        return belief, Estimate(tick.t_ns, mean[:3], mean[3:6], cov[:6, :6], *innovations)

    def _predict(self, belief: Belief, effort: Effort, row: FilterRow) -> Gaussian:
        """Return the mean and the covariance of the state one row later.  (1)"""

        def g(x: np.ndarray) -> np.ndarray:
            return move_by_model(self, x, belief.effort, effort, row.predicted_s)

        centre = g(belief.mean)
        spread_points = propagate(lambda x: _difference(g(x), centre), Gaussian(belief.mean, belief.cov))
        R = self.process_noise_cov * (row.dt_s * self.rate_hz)
        noise = [unpredicted_cov(row, belief.mean, belief.cov), R]
        cov = mirror_upper(
            spread_points.odd_part @ spread_points.odd_part.T
            + spread_points.even_part @ spread_points.even_part.T
        )
        return Gaussian(boxplus(centre, spread_points.mean), cov + block_diagonal(noise))

    def _correct(
        self, name: str, x: Gaussian, slot: Slot
    ) -> tuple[Gaussian, np.ndarray, np.ndarray, np.ndarray]:
        """Return the state, the innovation (m,), its covariance (m, m) and the weight of each channel (m,).  (2)"""
        sensor = getattr(self.sensors, name)
        elapsed_s = age_s(sensor, slot)

        def h(x: np.ndarray) -> np.ndarray:
            return sensor.h(past_motion(self.vehicle, x[:3], x[3:6], x[6:], elapsed_s))

        centre = h(x.mean)
        spread_points = propagate(lambda x: difference(sensor, h(x), centre), x)
        mask = measured_channels(sensor, slot)
        y = difference(sensor, np.where(mask > 0.0, slot.z, centre), centre) - spread_points.mean
        Q = mirror_upper(sensor.cov + spread_points.even_part @ spread_points.even_part.T)
        update = correct(np.eye(9), y, spread_points.odd_part, Q, mask=mask)
        is_accepted = is_within_gate(update.e, mask, self.gate_sigma)
        mean = np.where(is_accepted, boxplus(x.mean, spread_points.root @ update.mean_change), x.mean)
        cov = np.where(
            is_accepted, mirror_upper(spread_points.root @ update.cov @ spread_points.root.T), x.cov
        )
        y, w = (np.where(mask > 0.0, x, np.nan) for x in (y, np.where(is_accepted, 1.0, 0.0)))
        return Gaussian(mean, cov), y, mirror_upper(spread_points.odd_part @ spread_points.odd_part.T + Q), w


def _difference(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return x ⊟ y (n,): the difference with its heading wrapped."""
    d = x - y
    return np.concatenate([d[:2], np.array([wrap(d[2])]), d[3:]])
