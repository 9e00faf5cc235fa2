"""Measure the agreement of each sensor channel with the model and the estimator. findings.py names the result.

A reading z disagrees if it is not finite, if it is at the end of its range, or if

    |r| > SIGMA √(H P Hᵀ + Q + p),   r = z − h(x̂) − b                                                     (1)
    |y| > SIGMA √S                                                                                        (2)

x̂, P: state and covariance of the model, from the commands only (an estimator that follows a wrong sensor agrees with
it). h, H: measurement function and Jacobian. Q: noise. b, p: bias at rest and its variance. y, S: innovation of the
estimator and its covariance. Readings change the doubt in [0, DEGRADED_S]. δ: time, s: expected signal, σ: root in (1):

    doubt ← doubt + δ while it disagrees;   doubt − δ (SLOW + (FAST − SLOW) i) while it agrees            (3)
    i = s²/(s² + (SIGMA σ)²),   s = h(x̂) − h(rest)                                                        (4)

For i = 0 a stuck sensor also agrees. Method: Gertler 1998 (analytical redundancy). witness.py decides which is wrong.
"""

from dataclasses import dataclass

import numpy as np

from baqueano.contracts.optional import is_dynamic
from baqueano.contracts.values import Value
from baqueano.estimators.augmented.correction import WITHIN, predict_measurement
from baqueano.estimators.augmented_ekf import REST_S, STILL, AugmentedBelief, AugmentedEkf
from baqueano.estimators.covariance import block_diagonal, mirror_upper
from baqueano.estimators.pauses import row_of, tree_where
from baqueano.monitor.memory import DEGRADED_S, FROZEN_S, Memory, MonitorState, stuck
from baqueano.monitor.numbers import ChannelProperties, numbers_of
from baqueano.monitor.witness import log_odds
from baqueano.sensors.sampling import difference
from baqueano.signals import Motion, Tick
from baqueano.symbolic import jacobian

SIGMA = 4.0
SLOW, FAST = 0.5, 2.0  # of (3)
STEP_S = 0.1  # longest time that one reading counts for: five readings of a slow sensor make an event
TINY = 1e-300
BEFORE_REST = 5.0  # factor on the std of a bias in the file, before a rest: the file may be old
LARGEST = 20.0  # limit of the evidence
MEMORY_S = 2.0  # time constant of the ratio and of the evidence


@dataclass(frozen=True, slots=True, eq=False)
class Agreement:
    """A monitor of the doubt about each channel of `sensors`, in the order of a tick."""

    model: AugmentedEkf  # without sensors
    entries: tuple[int, ...] | None = None  # index of the number of each innovation; None: not known

    @property
    def numbers(self) -> ChannelProperties:
        """Return the properties of the channels of all sensors."""
        return numbers_of(self.model)

    def init(self, eta: np.ndarray | None = None, nu: np.ndarray | None = None) -> MonitorState:
        """Return the initial state, in which every doubt is 0."""
        zero = np.zeros(len(self.numbers.names))
        rows = Memory(*[zero] * len(Memory._fields))
        rows = rows._replace(bias_var=(BEFORE_REST * self.numbers.bias_std) ** 2)
        return MonitorState(self.model.init(eta, nu), np.stack(rows))

    def step(
        self, state: MonitorState, tick: Tick, y: np.ndarray | None, S: np.ndarray | None
    ) -> tuple[MonitorState, np.ndarray]:
        """Return the state and the doubt (m,) [s] after a tick; y, S are innovation and covariance of the estimator."""
        its, before, was = self.numbers, state.model, Memory(*state.memory)
        row = row_of(before.t_ns, tick, self.model.rate_hz)
        model, _ = self.model.row(before, tick)
        expected, H, K = self._expectation(before, model, row, tick)
        slots = [getattr(tick.sensors, name) for name in its.sensors]
        z = np.concatenate([slot.z for slot in slots])
        has = (
            np.concatenate([np.where(slot.has > 0.0, 1.0, 0.0) * np.ones(len(slot.z)) for slot in slots])
            > 0.0
        )
        unusable = has & ~(np.isfinite(z) & (np.abs(z) < WITHIN * its.limit))
        good, z = has & ~unusable, np.where(np.isfinite(z), z, 0.0)
        at_rest = (model.quiet_s >= REST_S) & np.all(np.abs(model.mean[3:6]) < STILL)

        silent_s = was.silent_s + row.dt_s
        dt_s = np.where(has, np.minimum(silent_s, STEP_S), 0.0)
        same = has & (z == was.last)
        same_s = np.where(same, was.same_s + silent_s, np.where(has, 0.0, was.same_s))
        longest_s = np.where(has & ~same, np.maximum(was.longest_s, was.same_s), was.longest_s)
        is_constant = its.inertial & stuck(was._replace(same_s=same_s, longest_s=longest_s)) & ~at_rest

        C = mirror_upper(H @ model.cov @ H.T)
        p = was.bias_var + its.walk**2 * row.dt_s
        N = block_diagonal([getattr(self.model.sensors, name).cov for name in its.sensors]) + np.diag(p)
        r = np.where(good, self._difference(z, expected) - was.bias, 0.0)
        variance = np.diag(C) + np.diag(N)
        far = good & ~its.pose & (r**2 > SIGMA**2 * variance)
        suspect = unusable | far | is_constant
        off = has & (suspect | (self._is_refused(y, S) & _only_suspect(suspect | (was.doubt_s > 0.0))))
        s = expected - its.rest
        signal_share = s**2 / (s**2 + SIGMA**2 * variance + TINY)
        fading = np.where(its.inertial & (same_s >= FROZEN_S), 0.0, SLOW + (FAST - SLOW) * signal_share)
        doubt_s = np.clip(was.doubt_s + dt_s * np.where(off, 1.0, -fading), 0.0, DEGRADED_S)

        G = mirror_upper(K @ model.cov[3:6, 3:6] @ K.T)
        G = np.where(its.inertial & ~its.turning, np.diag(r), G * r / (np.diag(G) + TINY))
        usable = np.where(good & ~its.pose & ~(its.inertial & (same_s >= FROZEN_S)), 1.0, 0.0)
        memory_factor = np.exp(-dt_s / MEMORY_S)
        evidence = was.evidence * memory_factor + np.where(far, dt_s, 0.0) * log_odds(
            r, C + N, G, usable, its.groups
        )
        evidence = np.where(doubt_s > 0.0, np.clip(evidence, -LARGEST, LARGEST), 0.0)

        gain = np.where(at_rest & good & ~off & (its.bias_std > 0.0), p / (p + np.diag(N) + TINY), 0.0)
        shown_s = np.where(good, dt_s, 0.0)
        after = Memory(
            doubt_s, evidence, np.where(has, 0.0, silent_s), np.where(has, z, was.last), same_s, longest_s,
            was.changes + np.where(has & ~same, 1.0, 0.0), np.where(has, np.where(unusable, 1.0, 0.0), was.broken),
            was.bias + gain * r, p * (1.0 - gain), np.where(has, expected + was.bias, was.expected),
            memory_factor * was.ss + shown_s * s * s, memory_factor * was.sz + shown_s * s * (s + r),
            memory_factor * was.zz + shown_s * (s + r) * (s + r),
        )  # fmt: skip
        state = tree_where(row.new, MonitorState(model, np.stack(after)), state)
        return state, state.memory[0]

    def _expectation(
        self, previous: AugmentedBelief, model: AugmentedBelief, row: Value, tick: Tick
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return h (m,) of the model, ∂h/∂x (m, n), and ∂h/∂ν (m, 3) with constant ν̇."""
        vehicle = self.model.vehicle
        _, effort = vehicle.drivetrain.step(previous.drivetrain, row.u, row.moved_s)
        eta, nu, nu_dot, constant = model.mean[:3], model.mean[3:6], None, np.zeros(3)
        if not is_dynamic(vehicle):
            nu_dot = constant = vehicle.advance(previous.mean[:3], previous.mean[3:6], effort, row.moved_s)[2]
        values, slopes, kinematic = [], [], []
        for name in self.numbers.sensors:
            sensor = getattr(self.model.sensors, name)

            def h(mean: np.ndarray, name: str = name) -> np.ndarray:
                return predict_measurement(
                    self.model, mean, name, effort, nu_dot, getattr(tick.sensors, name)
                )

            values.append(h(model.mean))
            slopes.append(jacobian(h)(model.mean))
            kinematic.append(
                jacobian(lambda nu, sensor=sensor: sensor.h(Motion(eta, nu, constant, np.zeros(2))))(nu)
            )
        return np.concatenate(values), np.concatenate(slopes), np.concatenate(kinematic)

    def _difference(self, z: np.ndarray, expected: np.ndarray) -> np.ndarray:
        """Return z − expected (m,) with wrapped angles."""
        out, k = [], 0
        for name in self.numbers.sensors:
            sensor = getattr(self.model.sensors, name)
            out.append(difference(sensor, z[k : k + sensor.size], expected[k : k + sensor.size]))
            k += sensor.size
        return np.concatenate(out)

    def _is_refused(self, y: Value, S: Value) -> Value:
        """Return a mask (m,): True if the innovation of the estimator is too large.  (2)"""
        far = [np.zeros(()) > 0.0] * len(self.numbers.names)
        if self.entries is None or y is None or S is None:
            return np.array(far)
        for k, c in enumerate(self.entries):
            far[c] = np.where(np.isfinite(y[k]), y[k], 0.0) ** 2 > SIGMA**2 * S[k, k]
        return np.array(far)


def _only_suspect(suspect: np.ndarray) -> np.ndarray:
    """Return a mask (m,): True if no other channel is suspect.

    An estimator that follows a wrong channel refuses the correct channels, so (2) counts only without another suspect.
    """
    count = np.sum(np.where(suspect, 1.0, 0.0))
    return count - np.where(suspect, 1.0, 0.0) < 0.5
