"""Extended Kalman filter with an augmented state: what model and sensors do not know is estimated with the motion.

    x = (η, ν, d, κ, b):  pose, velocity, disturbance, error of the scales of ν, biases of the sensors     (1)
    dynamic model      ν̇ = f(ν, e) + D,      D = (d_x, 0, d_ψ) [m/s², rad/s²],   η̇ = J(ψ) (1 + K) ν        (2)
    kinematic model    ν = V e + D,           D = (d_x, 0, d_ψ) [m/s, rad/s],     K = diag(κ_v, κ_v, κ_ψ)  (3)
    ḋ = −d/T + w   (Ornstein-Uhlenbeck, variance σ_d²),    κ̇ = 0,    ḃ = w_b                               (4)

The misfit of the model (σ_d, T) and the noise of a sensor (Q) are two numbers: where the model turns wrongly, d_ψ takes
it and the gyro leads. A model that was identified with a gyro has the scale of that gyro: no innovation shows κ, and
it acts on the way to the pose alone. What a number may correct is decided in augmented_state.py.
A number beyond `gate_sigma` loses its weight, and only that number, unless the one before was as far off: a spike is
alone, a turn that the model did not foresee is not. At rest (no command for REST_S, predicted speed below STILL) ν and
d are known to be 0; a refused number ends the rest, for somebody may carry the vehicle.
Sources: Jazwinski 1970, section 8.4; Schmidt 1966; Skog et al. 2010 for the rest.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from baqueano.estimators.augmented_state import BIASES, FORWARD, SCALES, Bias, layout, scale_std, split
from baqueano.estimators.covariance import block_diagonal, mirrored
from baqueano.estimators.kalman import Gaussian, correct, moved, predict
from baqueano.estimators.pauses import Row, bounded, chosen, in_rows, row_of, rows_before, unmoved_cov
from baqueano.geometry import map_from_body, wrap
from baqueano.parameter import INF, parameter
from baqueano.sensors.sampling import difference, low_pass_s
from baqueano.signals import Estimate, Motion, Tick
from baqueano.symbolic import get, jacobian, put
from baqueano.vehicles.effort import Effort

REST_S = 0.5  # without a command; what rolls has come to rest by then, if its predicted speed says so too
STILL = np.array([0.01, 0.01, 0.03])  # m/s, m/s, rad/s
ABSURD = 1.5  # times the gate: nothing so far off is ever followed, whatever the reading before it said
WITHIN = 0.9999  # of a sensor's range: what stands at its end is no measurement
AT_REST_STD = np.array([1e-3, 1e-3, 1e-3, 1e-2, 1e-2])  # of ν and d at rest


class AugmentedBelief(NamedTuple):
    """What the filter carries from tick to tick."""

    t_ns: int  # of the last tick; -1 before the first
    mean: np.ndarray  # (n,) of (1); biases and scales as differences from the file's
    cov: np.ndarray  # (n, n)
    model_nu: np.ndarray  # (3,) of the model by the commands alone
    gap: np.ndarray  # (m,) the last innovation of each number
    quiet_s: Any  # since the last command, or the last number that was refused
    drivetrain: Any


class Innovations(NamedTuple):
    """The numbers of a tick against the prediction."""

    gap: np.ndarray  # (m,) the last innovations, in order of use
    refused: Any  # how many lost their weight
    y: np.ndarray  # (m,) innovations; NaN for what did not arrive
    S: np.ndarray  # (m, m)


@dataclass(frozen=True, slots=True, eq=False)
class AugmentedEkf:
    """EKF that estimates disturbances and biases, and considers scales: the recommended estimator."""

    has_kalman_gains: ClassVar[bool] = False  # a number corrects what it shows, not all that it bears on

    vehicle: Any  # a block of vehicles/
    sensors: Any  # NamedTuple of sensor blocks, by name
    rate_hz: float = parameter("Hz", "the rate of the ticks", low=1e-3, default=100.0)
    use: tuple[str, ...] = ("imu",)  # sensors that correct, or single numbers of them: "imu[2]"
    speed_from: tuple[str, ...] = ()  # inertial numbers that may correct the speed: "imu[1]"
    gate_sigma: float = parameter(
        "1", "a number further off than this loses its weight", low=1.0, default=4.0
    )
    disturbance_std: np.ndarray = parameter(
        "m/s², rad/s² (kinematic: m/s, rad/s)", "σ_d of what the model does not explain, forward and turning",
        low=0.0, default=(0.3, 3.0), shape=(2,),
    )  # fmt: skip
    disturbance_fade_s: np.ndarray = parameter(
        "s", "T, over which each of them fades", low=1e-3, default=(1.0, 0.2), shape=(2,)
    )
    velocity_walk_std: np.ndarray = parameter(
        "m/s^1.5, m/s^1.5, rad/s^1.5", "random walk of ν in 1 s: the floor", low=0.0,
        default=(0.03, 0.01, 0.1), shape=(3,),
    )  # fmt: skip
    initial_std: np.ndarray = parameter(
        "m, m, rad, m/s, m/s, rad/s", "standard deviations of (η, ν) at the start", low=0.0,
        default=(1e-3, 1e-3, 1e-3, 1e-2, 1e-2, 1e-2), shape=(6,),
    )  # fmt: skip

    def __post_init__(self) -> None:
        known = getattr(self.sensors, "_fields", ())
        for use in (*self.use, *self.speed_from):
            if split(use)[0] not in known:
                raise ValueError(
                    f'use = "{use}": the vehicle has no such sensor; it has {", ".join(known) or "none"}.'
                )

    def init(self, eta: np.ndarray | None = None, nu: np.ndarray | None = None) -> AugmentedBelief:
        """At rest at the origin, unless told otherwise."""
        eta, nu = (np.zeros(3) if x is None else np.array(x, dtype=float) for x in (eta, nu))
        its = layout(self)
        std = [np.array([self._of(one, one.std)]) for one in its.biases]
        std = np.concatenate([self.initial_std, self.disturbance_std, scale_std(self), *std])
        mean = np.concatenate([eta, nu, np.zeros(its.size - 6)])
        return AugmentedBelief(
            -1,
            mean,
            np.diag(std**2),
            nu,
            np.zeros(len(its.moving)),
            0.0,
            self.vehicle.drivetrain.init(),
        )

    def step(self, belief: AugmentedBelief, tick: Tick) -> tuple[AugmentedBelief, Estimate]:
        """Predict, then correct with what came. A tick that is not newer changes nothing."""
        return in_rows(self, belief, tick)

    def pause(self, belief: AugmentedBelief, tick: Tick) -> Sequence[Tick]:
        """The silent rows that come before this tick.  pauses.py"""
        return rows_before(belief.t_ns, tick, self.rate_hz)

    def row(self, belief: AugmentedBelief, tick: Tick) -> tuple[AugmentedBelief, Estimate]:
        """One row, finite and positive definite whatever its length."""
        row = row_of(belief.t_ns, tick, self.rate_hz)
        drivetrain, effort = self.vehicle.drivetrain.step(belief.drivetrain, row.u, row.moved_s)
        x, nu_dot = self._predict(belief, effort, row)
        quiet_s = np.where(np.sum(np.abs(row.u)) > 0.0, 0.0, belief.quiet_s + row.dt_s)
        still = (quiet_s >= REST_S) & np.all(np.abs(x.mean[3:6]) < STILL)
        x = _at_rest(x, still)
        model_nu = self.vehicle.advance(belief.mean[:3], belief.model_nu, effort, row.moved_s)[1]
        model_nu = np.where(still, 0.0, model_nu)
        if not np.any(layout(self).moving[:, FORWARD[0]]):
            x = x._replace(mean=np.concatenate([x.mean[:3], model_nu[:1], x.mean[4:]]))
        x, innovations = self._correct(x, belief, effort, nu_dot, tick, still)
        quiet_s = np.where(innovations.refused > 0.0, 0.0, quiet_s)
        after = AugmentedBelief(tick.t_ns, *x, model_nu, innovations.gap, quiet_s, drivetrain)
        after = chosen(row.new, after, belief)
        shown = _pose_and_velocity(after.mean)
        out = jacobian(_pose_and_velocity)(after.mean)
        cov = mirrored(out @ after.cov @ out.T)
        return after, Estimate(
            tick.t_ns, shown[:3], shown[3:], cov, *(innovations[2:] if len(innovations.gap) else (None, None))
        )

    @property
    def process_noise_cov(self) -> np.ndarray:
        """R (6, 6) of (ν, ν̇) per tick that says roughly the same to a filter with white noise alone."""
        dt_s, d = 1.0 / self.rate_hz, self.disturbance_std[[0, 0, 1]]
        fading = 1.0 - np.exp(-2.0 * dt_s / self.disturbance_fade_s[[0, 0, 1]])
        return np.diag(np.concatenate([self.velocity_walk_std**2 * dt_s, np.maximum(d**2 * fading, 1e-9)]))

    @property
    def _dynamic(self) -> bool:
        return hasattr(self.vehicle, "nu_dot")

    def _of(self, one: Bias, path: str) -> Any:
        return get(getattr(self.sensors, one.sensor), path)

    def _predict(self, belief: AugmentedBelief, effort: Effort, row: Row) -> tuple[Gaussian, Any]:
        """(x, P) one row on, and ν̇ of a kinematic model.  (2)-(4)"""
        n, before = len(belief.mean), Gaussian(belief.mean, belief.cov)
        x = predict(before, lambda x: self._move(x, effort, row.moved_s), np.zeros((n, n)))
        walks = [np.array([self._of(one, one.walk) ** 2 * row.dt_s]) for one in layout(self).biases]
        B, unsure = self._kick(x.mean[2], row), unmoved_cov(row, x.mean, belief.cov)
        R = block_diagonal([B @ B.T, np.diag(np.concatenate([np.zeros(2), *walks]))])
        x = Gaussian(x.mean, bounded(x.cov + R + block_diagonal([unsure, np.zeros((n - 3, n - 3))])))
        if self._dynamic:
            return x, None
        return x, self.vehicle.advance(belief.mean[:3], belief.mean[3:6], effort, row.moved_s)[2]

    def _kick(self, psi: Any, row: Row) -> np.ndarray:
        """B (8, 5): what unit normals of the walk of ν (3) and of d (2) do to (η, ν, d) in a row. They grow along it,
        so that half of what ν gained went into the way, and what d gained into ν."""
        J, ahead = map_from_body(psi), np.array([[1.0, 0.0], [0.0, 0.0], [0.0, 1.0]])
        walk = np.diag(self.velocity_walk_std * np.sqrt(row.dt_s))
        d = np.diag(self.disturbance_std * np.sqrt(1.0 - np.exp(-2.0 * row.dt_s / self.disturbance_fade_s)))
        of_nu = 0.5 * row.moved_s * ahead @ d if self._dynamic else ahead @ d
        of_eta = J @ of_nu * (row.moved_s / 3.0 if self._dynamic else 0.5 * row.moved_s)
        rows = [(0.5 * row.moved_s * J @ walk, of_eta), (walk, of_nu), (np.zeros((2, 3)), d)]
        return np.concatenate([np.concatenate(row, axis=1) for row in rows])

    def _move(self, mean: np.ndarray, effort: Effort, dt_s: Any) -> np.ndarray:
        """x after a row, (n,).  (2)-(4)"""
        d, nu = mean[6:SCALES], mean[3:6]
        D = np.array([d[0], 0.0, d[1]])
        step, way = (dt_s, 0.5 * dt_s**2) if self._dynamic else (1.0, dt_s)
        eta, ahead, _ = self.vehicle.advance(mean[:3], nu, effort, dt_s)
        ahead = ahead + step * D
        scaled = 0.5 * dt_s * _scaled(mean[SCALES:BIASES], nu + ahead)
        eta = eta + map_from_body(eta[2]) @ (way * D + scaled)
        fading = d * np.exp(-dt_s / self.disturbance_fade_s)
        return np.concatenate([eta[:2], np.array([wrap(eta[2])]), ahead, fading, mean[SCALES:]])

    def _correct(
        self,
        x: Gaussian,
        belief: AugmentedBelief,
        effort: Effort,
        nu_dot: Any,
        tick: Tick,
        still: Any,
    ) -> tuple[Gaussian, "Innovations"]:
        """The state after what arrived, and what it said."""
        its = layout(self)
        if not len(its.moving):
            return x, Innovations(belief.gap, 0.0, belief.gap, np.zeros((0, 0)))
        gaps, slopes, noise, arrived = [], [], [], []
        for name, rows in zip(its.names, its.at, strict=True):
            sensor, slot, at = getattr(self.sensors, name), getattr(tick.sensors, name), np.array(rows)

            def h(mean: np.ndarray, name: str = name) -> np.ndarray:
                return self._h(mean, name, effort, nu_dot, getattr(tick.sensors, name).age_s)

            within = np.abs(slot.z) < WITHIN * getattr(sensor, "limit", INF)
            expected, has = h(x.mean), (slot.has > 0.0) & np.isfinite(slot.z) & within
            gaps.append(difference(sensor, np.where(has, slot.z, expected), expected)[at])
            slopes.append(jacobian(h)(x.mean)[at])
            noise.append(sensor.cov[at][:, at])
            arrived.append(np.where(has, 1.0, 0.0)[at])
        y, H, has = (np.concatenate(one) for one in (gaps, slopes, arrived))
        Q = block_diagonal(noise)

        def weight(c: int, e: Any, s: Any) -> Any:
            limit = self.gate_sigma * np.sqrt((Q[c, c] + its.patience[c] ** 2 * (s - Q[c, c])) / s)
            alone = np.minimum(np.abs(e), np.abs(e - belief.gap[c] / np.sqrt(s)) / np.sqrt(2.0))
            return 1.0 / (1.0 + (np.maximum(alone, np.abs(e) / ABSURD) / limit) ** 8)

        E = np.where(still, its.resting, its.moving)
        found = correct(x.cov, y * has, H * has[:, None], Q, E, weight)
        refused = sum(np.where(weight(c, found.e[c], found.s[c]) < 0.5, 1.0, 0.0) for c in range(len(y)))
        gap = np.where(has > 0.0, found.e * np.sqrt(found.s), belief.gap)
        S = mirrored(H @ x.cov @ H.T + Q)
        x = Gaussian(moved(x.mean, found.move), found.cov)
        return x, Innovations(gap, refused, np.where(has > 0.0, y, np.nan), S)

    def _h(self, mean: np.ndarray, name: str, effort: Effort, nu_dot: Any, age_s: Any) -> np.ndarray:
        """What a sensor would show with its biases as believed, (m,); to first order what it showed `age_s` ago."""
        sensor, eta, nu, d = getattr(self.sensors, name), mean[:3], mean[3:6], mean[6:SCALES]
        for k, one in enumerate(layout(self).biases):
            if one.sensor == name:
                sensor = put(sensor, one.path, get(sensor, one.path) + mean[BIASES + k])
        if nu_dot is None:
            nu_dot = self.vehicle.nu_dot(nu, effort.last, eta[2]) + np.array([d[0], 0.0, d[1]])
        age_s = age_s + (sensor.delay_s if getattr(sensor, "delay_slots", 0) else 0.0) + low_pass_s(sensor)
        turned = age_s * nu[2]
        way = map_from_body(eta[2] - 0.5 * turned) @ (age_s * nu)
        eta = np.array([eta[0] - way[0], eta[1] - way[1], eta[2] - turned])
        return sensor.h(Motion(eta, nu - age_s * nu_dot, nu_dot, self.vehicle.gravity(eta[2])))


def _at_rest(x: Gaussian, still: Any) -> Gaussian:
    """The state with ν = 0 and d = 0 where it is still."""
    motion, rest = np.zeros(len(x.mean)), np.zeros(len(x.mean))
    motion[3:SCALES], rest[3:SCALES] = 1.0, AT_REST_STD**2
    keep = 1.0 - np.where(still, motion, 0.0)
    return Gaussian(
        x.mean * keep, x.cov * keep[:, None] * keep[None, :] + np.diag(np.where(still, rest, 0.0))
    )


def _scaled(kappa: np.ndarray, nu: np.ndarray) -> np.ndarray:
    """K ν (3,)."""
    return np.array([kappa[0] * nu[0], kappa[0] * nu[1], kappa[1] * nu[2]])


def _pose_and_velocity(x: np.ndarray) -> np.ndarray:
    """(η, (1 + K) ν) (6,)."""
    return np.concatenate([x[:3], x[3:6] + _scaled(x[SCALES:BIASES], x[3:6])])
