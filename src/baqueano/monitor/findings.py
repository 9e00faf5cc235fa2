"""Describe a channel that disagrees with the model, and report if the sensor or the model is wrong.

A reading is SCALED if one factor explains most of it, and more of its residuals than one constant.
"""

from dataclasses import dataclass

import numpy as np

from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.monitor.channel_properties import ChannelProperties, sensor_name
from baqueano.monitor.log_odds import MIN_LOG_ODDS
from baqueano.monitor.memory import DEGRADED_S, FROZEN_S, Memory, is_missing

LOST, NO_NUMBER, SATURATED, FROZEN, ZERO, SLIPS, SCALED, AWAY, CONTRADICTED = (
    "lost", "no-number", "at-its-end", "frozen", "zero", "slips", "scaled", "away", "contradicted",
)  # fmt: skip
SENSOR, MODEL, UNKNOWN = "sensor", "model", "unknown"
# ratio below which a reading is zero; part of the signal that one factor explains
MIN_RATIO, MIN_EXPLAINED = 0.15, 0.7


@dataclass(frozen=True, slots=True)
class Finding:
    """A channel of a sensor that has disagreed with the model for at least 0.5 s.

    Attributes
    ----------
    name : str
        Name of the channel, such as "imu[2]", or of the sensor if it is LOST.
    t_ns : int
        Time of the finding.
    disagreement_s : float
        Duration of the disagreement, minus the weighted duration of later agreement.
    symptom : str
        Symptom: one of LOST, NO_NUMBER, SATURATED, FROZEN, ZERO, SLIPS, SCALED, AWAY,
        CONTRADICTED.
    faulty_part : str
        The wrong part: SENSOR, MODEL or UNKNOWN.
    reading : float
        The last reading [unit of the sensor].
    predicted_reading : float
        The reading that the model predicts from the commands [unit of the sensor].
    ratio : float
        Factor between readings and predictions [no unit], both minus the value at rest; NaN if unknown.

    Examples
    --------
    >>> Finding("imu[2]", 0, 3.0, SCALED, SENSOR, 0.5, 1.0, 0.5).is_degraded
    True
    """

    name: str
    t_ns: int
    disagreement_s: float
    symptom: str
    faulty_part: str
    reading: float
    predicted_reading: float
    ratio: float

    @property
    def is_degraded(self) -> bool:
        """Return True if `disagreement_s` has reached DEGRADED_S."""
        return self.disagreement_s >= DEGRADED_S

    @property
    def diagnostic(self) -> Diagnostic:
        """Return the finding as a message for the user."""
        cause = note(
            f"sensor.error-in-{self.faulty_part}",
            fix="baqueano identify last" if self.faulty_part == MODEL else "",
        )
        values = {
            "reading": self.reading,
            "expected": self.predicted_reading,
            "ratio": self.ratio,
            "consequence": cause,
        }
        symptom = note(f"sensor.{self.symptom}", subject=self.name, **values)
        if self.is_degraded:
            return note("sensor.degraded", Severity.WARNING, subject=self.name, cause=symptom)
        return symptom


def make_finding(
    channels: ChannelProperties, c: int, memory: Memory, t_ns: int, disagreement_s: float
) -> Finding:
    """Return the finding for channel `c` from the memory of the monitor."""
    z = float(memory.last_reading[c])
    h = float(memory.predicted_reading[c])
    rest_reading = float(channels.reading_at_rest[c])
    signal_squares = float(memory.signal_squares[c])
    ratio = 1.0 + float(memory.cross_products[c]) / signal_squares if signal_squares > 0.0 else float("nan")
    symptom = _find_symptom(channels, c, memory, ratio)
    evidence = float(memory.evidence[c])
    is_certain = bool(
        symptom in (LOST, NO_NUMBER, SATURATED) or (channels.is_inertial[c] and memory.repetition.is_stuck[c])
    )
    faulty_part = (
        SENSOR if is_certain or evidence > MIN_LOG_ODDS else MODEL if evidence < -MIN_LOG_ODDS else UNKNOWN
    )
    if (
        symptom == AWAY
        and faulty_part == SENSOR
        and channels.measures_speed[c]
        and abs(z - rest_reading) > abs(h - rest_reading)
    ):
        symptom = SLIPS
    name = sensor_name(channels.names[c]) if symptom == LOST else channels.names[c]
    return Finding(name, t_ns, disagreement_s, symptom, faulty_part, z, h, ratio)


def _find_symptom(n: ChannelProperties, c: int, memory: Memory, ratio: float) -> str:
    """Return the symptom of channel `c`, one of those of a Finding except SLIPS."""
    if is_missing(memory, n.period_s)[c]:
        return LOST
    if memory.is_unusable[c] > 0.0:
        return SATURATED if np.abs(memory.last_reading[c]) > 0.0 and np.isfinite(n.limit[c]) else NO_NUMBER
    is_constant = memory.constant_s[c] >= FROZEN_S
    is_near_zero = (
        abs(memory.last_reading[c]) <= n.noise_std[c]
        or abs(memory.last_reading[c] - n.reading_at_rest[c]) <= n.noise_std[c]
    )
    if is_constant:
        return ZERO if is_near_zero else FROZEN
    if n.is_pose[c] or not np.isfinite(ratio):
        return AWAY
    signal, cross = memory.signal_squares[c], memory.cross_products[c]
    measured = signal + 2.0 * cross + memory.residual_squares[c]
    if abs(ratio) < MIN_RATIO and measured <= (1.0 - MIN_EXPLAINED) * signal:
        return ZERO
    is_factor = (signal + cross) ** 2 >= MIN_EXPLAINED * signal * measured and abs(ratio - 1.0) > MIN_RATIO
    if is_factor and cross**2 / signal > memory.residuals[c] ** 2 / memory.duration_s[c]:  # no constant
        return SCALED
    is_as_predicted = abs(memory.last_reading[c] - memory.predicted_reading[c]) <= n.noise_std[c]
    return CONTRADICTED if is_as_predicted else AWAY
