"""Measure the agreement of each sensor channel with the model and the estimator. findings.py describes the result.

A reading z disagrees if it is not finite, at the end of its range, missing (memory.py), or if

    |r| > GATE_SIGMA √(H P Hᵀ + F + Q + p),   r = z − h(x̂) − b   for a sensor of the motion                    (1)
    |y| > GATE_SIGMA √S                                      for a sensor of the pose                          (2)

x̂, P: state and covariance of the model, from the commands only (an estimator follows a wrong sensor). h, H: measurement
function and Jacobian. F: fit_errors.py. Q: noise. b, p: bias at rest, its variance. y, S: innovation of the estimator,
its covariance. D: disagreement in [0, DEGRADED_S]; δ: time, s: expected signal, σ: root in (1):

    D ← D + δ if z disagrees,  D − δ (SLOW_RATE + (FAST_RATE − SLOW_RATE) i) if z agrees                       (3)
    i = s²/(s² + (GATE_SIGMA σ)²),   s = h(x̂) − h(rest)                                                   (4)

In motion, p of an accelerometer contains the floor's slope too. log_odds.py decides what is wrong. Gertler 1998.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from baqueano.contracts.optional import is_dynamic
from baqueano.contracts.values import Tree, Value
from baqueano.estimators.augmented.correction import USABLE_RANGE, predict_measurement
from baqueano.estimators.augmented.state import SCALE_INDEX
from baqueano.estimators.augmented_ekf import MAX_REST_NU, MIN_REST_S, AugmentedBelief, AugmentedEkf
from baqueano.estimators.covariance import block_diagonal, mirror_upper
from baqueano.estimators.pauses import FilterRow, filter_row
from baqueano.estimators.readings.repetition import next_repetition
from baqueano.monitor.channel_properties import ChannelProperties, describe_channels, sensor_name
from baqueano.monitor.fit_errors import ModelMotion, advance_model, expected_cov
from baqueano.monitor.log_odds import MIN_LOG_ODDS, verdicts
from baqueano.monitor.memory import DEGRADED_S, FROZEN_S, REGULAR_S, SUMS, Memory, MonitorState, is_missing
from baqueano.sensors.sampling import difference
from baqueano.signals import Motion, Tick
from baqueano.symbolic import jacobian, tree_where
from baqueano.vehicles.state import tick_effort

GATE_SIGMA = 4.0
SLOW_RATE, FAST_RATE = 0.5, 2.0  # of (3)
MAX_STEP_S = 0.1  # longest time assigned to one reading: five readings of a slow sensor make an event
MIN_VARIANCE = 1e-300
FILE_BIAS_FACTOR = 5.0  # factor on the std of a bias in the file, before a rest: the file can be old
MAX_EVIDENCE = 20.0  # limit of the evidence
# rad: level floors (DIN 18202: 4 mm per m). A rest measures an accelerometer at one place
FLOOR_SLOPE_STD = 0.005
GRAVITY_M_S2 = 9.81
MEMORY_S = 2.0  # time constant of the ratio and of the evidence, which both begin with the disagreement


@dataclass(frozen=True, slots=True, eq=False)
class AgreementMonitor:
    """A monitor of the disagreement of each channel of `sensors`, in the order of a tick."""

    model: AugmentedEkf  # without sensors
    entries: tuple[int, ...] | None = None  # index of the channel of each innovation; None: not known
    alternatives: tuple[Tree, ...] = ()  # models of fit_errors.py

    @property
    def channels(self) -> ChannelProperties:
        """Return the properties of the channels of all sensors."""
        return describe_channels(self.model)

    def init(self, eta: np.ndarray | None = None, nu: np.ndarray | None = None) -> MonitorState:
        """Return the initial state at the pose `eta` (3,) with the velocity `nu` (3,). Every disagreement is 0."""
        zero = np.zeros(len(self.channels.names))
        rows = Memory(*[zero] * len(Memory._fields))
        rows = rows._replace(bias_var=(FILE_BIAS_FACTOR * self.channels.bias_std) ** 2)
        model = self.model.init(eta, nu)
        motions = tuple(
            ModelMotion(model.model_nu, vehicle.drivetrain.init()) for vehicle in self.alternatives
        )
        return MonitorState(model, np.stack(rows), motions)

    def step(
        self, state: MonitorState, tick: Tick, y: np.ndarray | None, S: np.ndarray | None
    ) -> tuple[MonitorState, np.ndarray]:
        """Return the state and the disagreement (m,) [s] after a tick; y, S: innovation and its covariance."""
        channels, previous, memory = self.channels, state.model, Memory(*state.memory)
        row = filter_row(previous.t_ns, tick, self.model.rate_hz)
        model, _ = self.model.row(previous, tick)
        predicted_reading, H, K = self._expectation(previous, model, row, tick)
        at_rest = (model.quiet_s >= MIN_REST_S) & np.all(np.abs(model.mean[3:6]) < MAX_REST_NU)
        reading = self._reading(tick)
        is_moving = np.any(np.abs(model.mean[3:6]) > MAX_REST_NU)
        memory_at_end, dt_s = self._with_durations(memory, reading, row.dt_s, is_moving)
        is_lost, was_lost = self._is_lost(memory_at_end), self._is_lost(memory)
        is_frozen = channels.is_inertial & (memory_at_end.constant_s >= FROZEN_S)

        p = memory.bias_var + channels.bias_walk**2 * row.dt_s
        motions, F = self._fit_errors(previous, model, state.motions, row, tick, at_rest)
        C, N = mirror_upper(H @ model.cov @ H.T) + F, self._noise_cov(p, at_rest)
        r = np.where(reading.is_usable, self._difference(reading.z, predicted_reading) - memory.bias, 0.0)
        variance = np.diag(C) + np.diag(N)
        is_evidence = reading.is_usable & ~channels.is_pose & ~is_frozen
        verdict = verdicts(
            r,
            C + N,
            self._causes(K, model.cov, r),
            np.where(is_evidence, 1.0, 0.0),
            channels.groups,
            GATE_SIGMA,
        )
        is_outlier = reading.is_usable & ~channels.is_pose & (r**2 > GATE_SIGMA**2 * variance)
        is_wrong = (memory.evidence > MIN_LOG_ODDS) & (memory.disagreement_s > 0.0)
        is_outlier = is_outlier | (verdict.is_contradicted & (is_wrong | _is_sole_suspect(is_wrong)))
        is_constant = channels.is_inertial & memory_at_end.repetition.is_stuck & ~at_rest
        is_suspect = reading.is_unusable | is_outlier | is_constant
        is_wrong_pose = self._is_rejected(y, S) & _is_sole_suspect(is_suspect | (memory.disagreement_s > 0.0))
        disagrees = reading.is_arrived & (is_suspect | is_wrong_pose)
        s = predicted_reading - channels.reading_at_rest
        signal_share = s**2 / (s**2 + GATE_SIGMA**2 * variance + MIN_VARIANCE)
        fading = np.where(is_frozen, 0.0, SLOW_RATE + (FAST_RATE - SLOW_RATE) * signal_share)
        change_s = np.where(is_lost, row.dt_s, dt_s * np.where(disagrees, 1.0, -fading))
        change_s = np.where(was_lost & reading.is_arrived & ~disagrees, -DEGRADED_S, change_s)  # it is back
        disagreement_s = np.clip(memory.disagreement_s + change_s, 0.0, DEGRADED_S)

        odds = np.where(is_outlier, dt_s, 0.0) * verdict.log_odds
        memory_factor = np.exp(-dt_s / MEMORY_S)
        evidence = np.clip(memory.evidence * memory_factor + odds, -MAX_EVIDENCE, MAX_EVIDENCE)

        is_calibrating = at_rest & reading.is_usable & ~disagrees & (channels.bias_std > 0.0)
        gain = np.where(is_calibrating, p / (p + np.diag(N) + MIN_VARIANCE), 0.0)
        shown_s, is_arrived = np.where(reading.is_usable, dt_s, 0.0), reading.is_arrived
        begun = np.where(disagreement_s > 0.0, 1.0, 0.0)
        next_memory = memory_at_end._replace(
            disagreement_s=disagreement_s,
            evidence=begun * evidence,
            is_unusable=np.where(is_arrived, np.where(reading.is_unusable, 1.0, 0.0), memory.is_unusable),
            bias=memory.bias + gain * r,
            bias_var=p * (1.0 - gain),
            predicted_reading=np.where(is_arrived, predicted_reading + memory.bias, memory.predicted_reading),
            **{
                name: begun * (memory_factor * getattr(memory, name) + shown_s * term)
                for name, term in zip(SUMS, (1.0, r, r * r, s * r, s * s), strict=True)
            },
        )
        state = tree_where(row.is_new, MonitorState(model, np.stack(next_memory), motions), state)
        return state, state.memory[0]

    def _reading(self, tick: Tick) -> "_Reading":
        """Return the readings of a tick. One that is not finite, or at the end of its range, is unusable."""
        slots = [getattr(tick.sensors, name) for name in self.channels.sensors]
        z = np.concatenate([slot.z for slot in slots])
        masks = [np.where(slot.is_new > 0.0, 1.0, 0.0) * np.ones(len(slot.z)) for slot in slots]
        is_arrived = np.concatenate(masks) > 0.0
        is_unusable = is_arrived & ~(np.isfinite(z) & (np.abs(z) < USABLE_RANGE * self.channels.limit))
        return _Reading(np.where(np.isfinite(z), z, 0.0), is_arrived, is_unusable)

    def _with_durations(
        self, memory: Memory, reading: "_Reading", dt_s: Value, is_moving: Value
    ) -> tuple[Memory, np.ndarray]:
        """Return the memory with its durations after a row of `dt_s`, and the time (m,) of each reading."""
        silent_s, is_arrived = memory.silent_s + dt_s, reading.is_arrived
        repetition = next_repetition(memory.repetition, reading.z, is_arrived)
        constant_s = np.where(repetition.repeat_count > 0.0, memory.constant_s + silent_s, 0.0)
        was_missing = is_missing(memory, self.channels.period_s)
        motion_s = memory.motion_s + np.where(was_missing | ~is_moving, 0.0, dt_s)
        memory_at_end = memory._replace(
            silent_s=np.where(is_arrived, 0.0, silent_s),
            interval_s=np.where(is_arrived, silent_s, memory.interval_s),
            motion_s=np.where(is_arrived & was_missing, 0.0, motion_s),
            constant_s=np.where(is_arrived, constant_s, memory.constant_s),
            **repetition._asdict(),
        )
        return memory_at_end, np.where(is_arrived, np.minimum(silent_s, MAX_STEP_S), 0.0)

    def _is_lost(self, memory: Memory) -> np.ndarray:
        """Return a mask (m,): True for the first channel of a used sensor whose reading is missing."""
        channels = self.channels
        motion_entries = np.flatnonzero(~channels.is_pose).tolist()
        indices = motion_entries if self.entries is None else list(self.entries)
        first_index = {sensor_name(channels.names[c]): c for c in sorted(indices, reverse=True)}
        is_first = np.isin(np.arange(len(channels.names)), list(first_index.values()))
        is_regular = ~channels.is_pose | (memory.motion_s >= REGULAR_S)
        return is_first & is_regular & is_missing(memory, channels.period_s)

    def _noise_cov(self, bias_var: np.ndarray, at_rest: Value) -> np.ndarray:
        """Return Q + p (m, m), with the slope of the floor while the vehicle moves."""
        slope_std = np.where(self.channels.measures_acceleration, FLOOR_SLOPE_STD * GRAVITY_M_S2, 0.0)
        Q = block_diagonal([getattr(self.model.sensors, name).cov for name in self.channels.sensors])
        return Q + np.diag(bias_var + np.where(at_rest, 0.0, slope_std**2))

    def _causes(self, K: np.ndarray, cov: np.ndarray, r: np.ndarray) -> list[np.ndarray]:
        """Return G (m, m) of log_odds.py for a wrong thrust and a wrong torque of the model."""
        is_accelerometer = self.channels.is_inertial & ~self.channels.measures_turn
        responses = [K @ cov[3:6, d] for d in range(6, SCALE_INDEX)]
        causes = [b[:, None] * (b * r / (b**2 + MIN_VARIANCE)) for b in responses]
        return [np.where(is_accelerometer, np.diag(r), cause) for cause in causes]

    def _expectation(
        self, previous: AugmentedBelief, model: AugmentedBelief, row: Value, tick: Tick
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return h (m,) of the model, ∂h/∂x (m, n), and ∂h/∂ν (m, 3) with constant ν̇."""
        vehicle = self.model.vehicle
        mean = previous.mean
        _, effort = tick_effort(vehicle, previous.drivetrain, mean[2], mean[3:6], row.u, row.predicted_s)
        eta, nu, nu_dot, constant_nu_dot = model.mean[:3], model.mean[3:6], None, np.zeros(3)
        if not is_dynamic(vehicle):
            nu_dot = constant_nu_dot = vehicle.advance(
                previous.mean[:3], previous.mean[3:6], effort, row.predicted_s
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

    def _fit_errors(
        self, previous: AugmentedBelief, model: AugmentedBelief, motions: tuple[ModelMotion, ...],
        row: FilterRow, tick: Tick, at_rest: Value,
    ) -> tuple[tuple[ModelMotion, ...], np.ndarray]:  # fmt: skip
        """Return the next motion of each alternative model, and F (m, m) of fit_errors.py."""
        vehicles = (self.model.vehicle, *self.alternatives)
        motions = (ModelMotion(previous.model_nu, previous.drivetrain), *motions)
        next_motions, readings = [], []
        for vehicle, motion in zip(vehicles, motions, strict=True):
            next_motion, effort, nu_dot = advance_model(vehicle, previous, motion, row, at_rest)
            mean = np.concatenate([model.mean[:3], next_motion.nu, model.mean[6:]])
            filter_ = replace(self.model, vehicle=vehicle)
            readings.append(np.concatenate([
                predict_measurement(filter_, mean, name, effort, nu_dot, getattr(tick.sensors, name))
                for name in self.channels.sensors
            ]))  # fmt: skip
            next_motions.append(next_motion)
        return tuple(next_motions[1:]), expected_cov(readings[1:], readings[0])

    def _difference(self, z: np.ndarray, predicted_reading: np.ndarray) -> np.ndarray:
        """Return z − predicted_reading (m,) with wrapped angles."""
        differences, k = [], 0
        for name in self.channels.sensors:
            sensor = getattr(self.model.sensors, name)
            entries = slice(k, k + sensor.size)
            differences.append(difference(sensor, z[entries], predicted_reading[entries]))
            k += sensor.size
        return np.concatenate(differences)

    def _is_rejected(self, y: Value, S: Value) -> Value:
        """Return a mask (m,): True for a pose whose innovation of the estimator is too large.  (2)"""
        is_outlier = [np.zeros(()) > 0.0] * len(self.channels.names)
        if self.entries is None or y is None or S is None:
            return np.array(is_outlier)
        for k, c in enumerate(self.entries):
            if self.channels.is_pose[c]:
                is_outlier[c] = np.where(np.isfinite(y[k]), y[k], 0.0) ** 2 > GATE_SIGMA**2 * S[k, k]
        return np.array(is_outlier)


class _Reading(NamedTuple):
    """The readings of one tick."""

    z: np.ndarray  # (m,) 0 for a reading that is not finite
    is_arrived: np.ndarray  # (m,)
    is_unusable: np.ndarray  # (m,)

    @property
    def is_usable(self) -> np.ndarray:
        """Return a mask (m,): True for a reading that arrived and is usable."""
        return self.is_arrived & ~self.is_unusable


def _is_sole_suspect(suspect_mask: np.ndarray) -> np.ndarray:
    """Return a mask (m,): True if no other channel is suspect.

    An estimator that follows a wrong channel rejects a correct pose, so (2) is used only without another suspect.
    """
    count = np.sum(np.where(suspect_mask, 1.0, 0.0))
    return count - np.where(suspect_mask, 1.0, 0.0) < 0.5
