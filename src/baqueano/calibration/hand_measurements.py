"""Read measurements that were made by hand: how far from its start a vehicle is, and how far it has turned.

    d = √(x² + y²),   (x, y) = (0, 0) back on the mark,   (cos ψ, sin ψ)                                  (1)

Each kind of measurement has a sensor block with this h. Measurements by hand determine the scales of the speed and of
the gyro, which the sensors on board do not show.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from baqueano.calibration.hand_turns import ANGLE_STD_RAD
from baqueano.errors import UsageError
from baqueano.runs.run import Run
from baqueano.signals import NANOSECONDS, Motion

LENGTH_STD_M = 0.01  # accuracy of a tape
LENGTHS = {"m": 1.0, "cm": 0.01, "mm": 0.001}
ANGLES = {"deg": np.pi / 180.0, "°": np.pi / 180.0, "rad": 1.0, "turn": 2.0 * np.pi, "turns": 2.0 * np.pi}
SMOOTHING_M = 1e-3  # keeps the root of (1) smooth at the mark
LINE_PATTERN = re.compile(
    r"^\s*(?:(?P<run>\S.*?)\s+)?(?:0(?:\.0*)?\s*s?\s*\.\.\s*)?(?P<t>end|[\d.]+\s*s)\s*:(?P<what>.+)$"
)
NUMBER_PATTERN = re.compile(
    r"^\s*(?P<x>[+-]?[\d.]+(?:e[+-]?\d+)?)\s*(?:(?:±|\+-|\+/-)\s*(?P<std>[\d.]+)\s*)?(?P<unit>[a-z°]+)\s*$"
)


class HandMeasurement(NamedTuple):
    """One measurement by hand."""

    kind: str  # a key of HAND_SENSORS
    t_ns: int
    z: np.ndarray  # (m,)
    std: float


@dataclass(frozen=True, slots=True, eq=False)
class HandSensor:
    """The sensor block of a measurement by hand. `h` returns z (size,): a distance [m], a position [m], or a direction
    without a jump at half a turn, whose standard deviation is that of the angle [rad].  (1)"""

    size: int
    std: float
    h: Callable[[Motion], np.ndarray]

    @property
    def cov(self) -> np.ndarray:
        """Return the covariance Q (m, m)."""
        return np.eye(self.size) * self.std**2


def _distance(motion: Motion) -> np.ndarray:
    return np.sqrt(np.array([motion.eta[0] ** 2 + motion.eta[1] ** 2 + SMOOTHING_M**2]))


HAND_SENSORS = {
    "tape": HandSensor(1, LENGTH_STD_M, _distance),
    "back_on_mark": HandSensor(2, LENGTH_STD_M, lambda motion: motion.eta[:2]),
    "turned": HandSensor(
        2, ANGLE_STD_RAD, lambda motion: np.array([np.cos(motion.eta[2]), np.sin(motion.eta[2])])
    ),
}
EXAMPLE = '--measured "12.4 s: 2.31 m" --measured "end: 0 m, 720 deg"'


def read_line(line: str, runs: Sequence[Run]) -> tuple[int, list[HandMeasurement]]:
    """Return the index of the run that `line` names, and the measurements in the line. Raise UsageError for a line that
    cannot be parsed, an unknown run, or a time outside the run."""
    match = LINE_PATTERN.match(line.replace(",", ", "))
    if match is None:
        raise UsageError.of("tape.unreadable", EXAMPLE, line=line)
    run_index = _run_index(match["run"], line, runs)
    run = runs[run_index]
    t_s = run.duration_s if match["t"] == "end" else float(match["t"].rstrip("s "))
    if not 0.0 < t_s <= run.duration_s:
        raise UsageError.of("tape.after-the-end", line=line, run=run.name, duration_s=run.duration_s, t_s=t_s)
    t_ns = int(run.t_ns[0]) + round(t_s * NANOSECONDS)
    return run_index, [_measurement(part, line, t_ns) for part in match["what"].split(",")]


def _run_index(name: str | None, line: str, runs: Sequence[Run]) -> int:
    names = [run.name for run in runs]
    if name is None and len(runs) == 1:
        return 0
    if name not in names:
        if name is None:
            raise UsageError.of("tape.run-missing", line=line, valid=names)
        raise UsageError.of("tape.of-another-run", line=line, value=name, valid=names)
    return names.index(name)


def _measurement(text: str, line: str, t_ns: int) -> HandMeasurement:
    number = NUMBER_PATTERN.match(text)
    unit = number["unit"] if number else ""
    if number is None or unit not in {**LENGTHS, **ANGLES}:
        raise UsageError.of(
            "tape.no-length", EXAMPLE, line=line, part=text.strip(), units=(*LENGTHS, *ANGLES)
        )
    factor = {**LENGTHS, **ANGLES}[unit]
    x, std = float(number["x"]) * factor, float(number["std"] or 0.0) * factor
    if x < 0.0 and unit in LENGTHS:
        raise UsageError.of("tape.negative", line=line, length_m=x)
    kind, z = ("tape", [x]) if x > 0.0 else ("back_on_mark", [0.0, 0.0])
    if unit in ANGLES:
        kind, z = "turned", [np.cos(x), np.sin(x)]
    return HandMeasurement(kind, t_ns, np.array(z), std or HAND_SENSORS[kind].std)
