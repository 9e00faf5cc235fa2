"""Measure the agreement of each sensor channel with the model and the estimator. findings.py describes the result.

A reading z disagrees if it is not finite, if it is at the end of its range, or if

    |r| > GATE_SIGMA √(H P Hᵀ + Q + p),   r = z − h(x̂) − b                                                     (1)
    |y| > GATE_SIGMA √S                                                                                        (2)

x̂, P: state and covariance of the model, from the commands only (an estimator follows a wrong sensor). h, H: measurement
function and Jacobian. Q: noise. b, p: bias at rest, its variance. y, S: innovation and its covariance of the estimator.
Readings change the doubt in [0, DEGRADED_S]; δ: time, s: expected signal, σ: root in (1):

    doubt ← doubt + δ if z disagrees,  doubt − δ (SLOW_RATE + (FAST_RATE − SLOW_RATE) i) if z agrees           (3)
    i = s²/(s² + (GATE_SIGMA σ)²),   s = h(x̂) − h(rest)                                                   (4)

In motion, p of an accelerometer contains the floor's slope too. log_odds.py decides what is wrong. Gertler 1998.
"""

from dataclasses import dataclass

import numpy as np

from baqueano.contracts.optional import is_dynamic
from baqueano.contracts.values import Value
from baqueano.estimators.augmented.correction import USABLE_RANGE, predict_measurement
from baqueano.estimators.augmented.state import SCALE_INDEX
from baqueano.estimators.augmented_ekf import MAX_REST_NU, MIN_REST_S, AugmentedBelief, AugmentedEkf
from baqueano.estimators.covariance import block_diagonal, mirror_upper
from baqueano.estimators.pauses import filter_row
from baqueano.monitor.channel_properties import ChannelProperties, channels_of
from baqueano.monitor.log_odds import log_odds
from baqueano.monitor.memory import DEGRADED_S, FROZEN_S, Memory, MonitorState, is_stuck
from baqueano.sensors.sampling import difference
from baqueano.signals import Motion, Tick
from baqueano.symbolic import jacobian, tree_where

GATE_SIGMA = 4.0
SLOW_RATE, FAST_RATE = 0.5, 2.0  # of (3)
MAX_STEP_S = 0.1  # longest time assigned to one reading: five readings of a slow sensor make an event
MIN_VARIANCE = 1e-300
FILE_BIAS_FACTOR = 5.0  # factor on the std of a bias in the file, before a rest: the file can be old
MAX_EVIDENCE = 20.0  # limit of the evidence
FLOOR_SLOPE_STD = (
    0.005  # rad: level floors (DIN 18202: 4 mm per m). A rest measures an accelerometer at one place
)
GRAVITY_M_S2 = 9.81
MEMORY_S = 2.0  # time constant of the ratio and of the evidence


@dataclass(frozen=True, slots=True, eq=False)
class AgreementMonitor:
    """A monitor of the doubt about each channel of `sensors`, in the order of a tick."""

    model: AugmentedEkf  # without sensors
    entries: tuple[int, ...] | None = None  # index of the channel of each innovation; None: not known

    @property
    def channels(self) -> ChannelProperties:
        """Return the properties of the channels of all sensors."""
        return channels_of(self.model)

    def init(self, eta: np.ndarray | None = None, nu: np.ndarray | None = None) -> MonitorState:
        """Return the initial state at the pose `eta` (3,) with the velocity `nu` (3,). Every doubt is 0."""
        zero = np.zeros(len(self.channels.names))
        rows = Memory(*[zero] * len(Memory._fields))
        rows = rows._replace(bias_var=(FILE_BIAS_FACTOR * self.channels.bias_std) ** 2)
        return MonitorState(self.model.init(eta, nu), np.stack(rows))

    def step(
        self, state: MonitorState, tick: Tick, y: np.ndarray | None, S: np.ndarray | None
    ) -> tuple[MonitorState, np.ndarray]:
        """Return the state and the doubt (m,) [s] after a tick; y, S are innovation and covariance of the estimator."""
        channels, previous, memory = self.channels, state.model, Memory(*state.memory)
        row = filter_row(previous.t_ns, tick, self.model.rate_hz)
        model, _ = self.model.row(previous, tick)
        predicted_reading, H, K = self._expectation(previous, model, row, tick)
        slots = [getattr(tick.sensors, name) for name in channels.sensors]
        z = np.concatenate([slot.z for slot in slots])
        is_arrived = (
            np.concatenate([np.where(slot.has > 0.0, 1.0, 0.0) * np.ones(len(slot.z)) for slot in slots])
            > 0.0
        )
        is_unusable = is_arrived & ~(np.isfinite(z) & (np.abs(z) < USABLE_RANGE * channels.limit))
        is_good, z = is_arrived & ~is_unusable, np.where(np.isfinite(z), z, 0.0)
        at_rest = (model.quiet_s >= MIN_REST_S) & np.all(np.abs(model.mean[3:6]) < MAX_REST_NU)

        silent_s = memory.silent_s + row.dt_s
        dt_s = np.where(is_arrived, np.minimum(silent_s, MAX_STEP_S), 0.0)
        is_unchanged = is_arrived & (z == memory.last_reading)
        unchanged_s = np.where(
            is_unchanged, memory.unchanged_s + silent_s, np.where(is_arrived, 0.0, memory.unchanged_s)
        )
        longest_s = np.where(
            is_arrived & ~is_unchanged,
            np.maximum(memory.longest_unchanged_s, memory.unchanged_s),
            memory.longest_unchanged_s,
        )
        is_constant = (
            channels.is_inertial
            & is_stuck(memory._replace(unchanged_s=unchanged_s, longest_unchanged_s=longest_s))
            & ~at_rest
        )

        C = mirror_upper(H @ model.cov @ H.T)
        p = memory.bias_var + channels.bias_walk**2 * row.dt_s
        slope_std = np.where(channels.measures_acceleration, FLOOR_SLOPE_STD * GRAVITY_M_S2, 0.0)
        N = block_diagonal([getattr(self.model.sensors, name).cov for name in channels.sensors])
        N = N + np.diag(p + np.where(at_rest, 0.0, slope_std**2))
        r = np.where(is_good, self._difference(z, predicted_reading) - memory.bias, 0.0)
        variance = np.diag(C) + np.diag(N)
        is_outlier = is_good & ~channels.is_pose & (r**2 > GATE_SIGMA**2 * variance)
        is_suspect = is_unusable | is_outlier | is_constant
        is_off = is_arrived & (
            is_suspect | (self._is_rejected(y, S) & _is_only_suspect(is_suspect | (memory.doubt_s > 0.0)))
        )
        s = predicted_reading - channels.reading_at_rest
        signal_share = s**2 / (s**2 + GATE_SIGMA**2 * variance + MIN_VARIANCE)
        fading = np.where(
            channels.is_inertial & (unchanged_s >= FROZEN_S),
            0.0,
            SLOW_RATE + (FAST_RATE - SLOW_RATE) * signal_share,
        )
        doubt_s = np.clip(memory.doubt_s + dt_s * np.where(is_off, 1.0, -fading), 0.0, DEGRADED_S)

        is_accelerometer = channels.is_inertial & ~channels.measures_turn
        causes = [
            np.where(
                is_accelerometer,
                np.diag(r),
                response[:, None] * (response * r / (response**2 + MIN_VARIANCE)),
            )
            for response in (K @ model.cov[3:6, d] for d in range(6, SCALE_INDEX))
        ]
        usable = np.where(
            is_good & ~channels.is_pose & ~(channels.is_inertial & (unchanged_s >= FROZEN_S)), 1.0, 0.0
        )
        memory_factor = np.exp(-dt_s / MEMORY_S)
        evidence = memory.evidence * memory_factor + np.where(is_outlier, dt_s, 0.0) * log_odds(
            r, C + N, causes, usable, channels.groups
        )
        evidence = np.where(doubt_s > 0.0, np.clip(evidence, -MAX_EVIDENCE, MAX_EVIDENCE), 0.0)

        gain = np.where(
            at_rest & is_good & ~is_off & (channels.bias_std > 0.0), p / (p + np.diag(N) + MIN_VARIANCE), 0.0
        )
        shown_s = np.where(is_good, dt_s, 0.0)
        new_memory = Memory(
            doubt_s, evidence, np.where(is_arrived, 0.0, silent_s), np.where(is_arrived, z, memory.last_reading),
            unchanged_s, longest_s,
            memory.change_count + np.where(is_arrived & ~is_unchanged, 1.0, 0.0), np.where(is_arrived,
            np.where(is_unusable, 1.0, 0.0), memory.is_broken),
            memory.bias + gain * r, p * (1.0 - gain),
            np.where(is_arrived, predicted_reading + memory.bias, memory.predicted_reading),
            memory_factor * memory.expected_squares + shown_s * s * s,
            memory_factor * memory.cross_products + shown_s * s * (s + r),
            memory_factor * memory.measured_squares + shown_s * (s + r) * (s + r),
        )  # fmt: skip
        state = tree_where(row.is_new, MonitorState(model, np.stack(new_memory)), state)
        return state, state.memory[0]

    def _expectation(
        self, previous: AugmentedBelief, model: AugmentedBelief, row: Value, tick: Tick
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return h (m,) of the model, ∂h/∂x (m, n), and ∂h/∂ν (m, 3) with constant ν̇."""
        vehicle = self.model.vehicle
        _, effort = vehicle.drivetrain.step(previous.drivetrain, row.u, row.moved_s)
        eta, nu, nu_dot, constant_nu_dot = model.mean[:3], model.mean[3:6], None, np.zeros(3)
        if not is_dynamic(vehicle):
            nu_dot = constant_nu_dot = vehicle.advance(
                previous.mean[:3], previous.mean[3:6], effort, row.moved_s
            )[2]
        values, jacobians, velocity_jacobians = [], [], []
        for name in self.channels.sensors:
            sensor = getattr(self.model.sensors, name)

            def h(mean: np.ndarray, name: str = name) -> np.ndarray:
                return predict_measurement(
                    self.model, mean, name, effort, nu_dot, getattr(tick.sensors, name)
                )

            values.append(h(model.mean))
            jacobians.append(jacobian(h)(model.mean))
            velocity_jacobians.append(
                jacobian(lambda nu, sensor=sensor: sensor.h(Motion(eta, nu, constant_nu_dot, np.zeros(2))))(
                    nu
                )
            )
        return np.concatenate(values), np.concatenate(jacobians), np.concatenate(velocity_jacobians)

    def _difference(self, z: np.ndarray, predicted_reading: np.ndarray) -> np.ndarray:
        """Return z − predicted_reading (m,) with wrapped angles."""
        differences, k = [], 0
        for name in self.channels.sensors:
            sensor = getattr(self.model.sensors, name)
            differences.append(
                difference(sensor, z[k : k + sensor.size], predicted_reading[k : k + sensor.size])
            )
            k += sensor.size
        return np.concatenate(differences)

    def _is_rejected(self, y: Value, S: Value) -> Value:
        """Return a mask (m,): True if the innovation of the estimator is too large.  (2)"""
        is_outlier = [np.zeros(()) > 0.0] * len(self.channels.names)
        if self.entries is None or y is None or S is None:
            return np.array(is_outlier)
        for k, c in enumerate(self.entries):
            is_outlier[c] = np.where(np.isfinite(y[k]), y[k], 0.0) ** 2 > GATE_SIGMA**2 * S[k, k]
        return np.array(is_outlier)


def _is_only_suspect(suspect: np.ndarray) -> np.ndarray:
    """Return a mask (m,): True if no other channel is suspect.

    An estimator that follows a wrong channel rejects the correct channels, so (2) is used only without another suspect.
    """
    count = np.sum(np.where(suspect, 1.0, 0.0))
    return count - np.where(suspect, 1.0, 0.0) < 0.5
