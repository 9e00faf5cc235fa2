"""Find the axes of an IMU from gravity in the columns of a recording.

Over a drive the mean of a horizontal accelerometer is small, and the mean of the vertical one is ±g: above twice the
others and three times its own deviation. With the axis v upward (s = 1) or downward (s = −1) a right-handed IMU has

    forward = n(v),   left = s n(n(v)),   turning left = s ω_v,      n: x → y → z → x                     (1)

The direction of `forward` in the plane is a guess. A log of gravity itself, instead of the reading at rest, has the
opposite sign on all three axes. The size of the mean shows the unit.
"""

import re
from collections.abc import Collection
from typing import NamedTuple

import numpy as np

from baqueano.diagnostics import note
from baqueano.errors import FileError
from baqueano.numerics.statistics import MAD
from baqueano.runs.diagnostics.finding import ImportFinding
from baqueano.runs.importing.column_names import plain_name
from baqueano.runs.maps.columns import ColumnSignal
from baqueano.runs.maps.units import UNITS
from baqueano.runs.tables.table import LogTable
from baqueano.signals import STANDARD_GRAVITY

NEXT_AXIS = {"x": "y", "y": "z", "z": "x"}
DIRECTIONS = {  # words for an axis of the body
    "x": "fwd|forward|long(itudinal)?|avance|adelante", "y": "lat(eral)?|left|izq(uierda)?", "z": "vert(ical)?|up",
}  # fmt: skip
YAW_PATTERN = (  # also of a gyro with one axis
    r"(gyro?|giro?)(scop[a-z]*)?(?!_?[xy](_|$))_?z?(_|$)"
    r"|(^|_)(gz|wz|omega(_z)?|yaw_rate|angular_velocity_z)(_|$)"
)
GRAVITY_TOLERANCE = 0.08  # bias and scale of small accelerometers
WORDS_PER_G = (16384, 8192, 4096, 2048, 1024, 256)
MIN_AXIS_RATIO, MIN_DEVIATIONS, MIN_ROWS = 2.0, 3.0, 20


class SignedColumn(NamedTuple):
    """A column, "" if it is missing, and the sign with which it measures an entry."""

    name: str
    sign: int

    def __str__(self) -> str:
        return "-" * (self.sign < 0) + self.name


class ImuColumns(NamedTuple):
    """The columns of an IMU by (1), and the vertical accelerometer; "" without one."""

    entries: tuple[SignedColumn, SignedColumn, SignedColumn]
    vertical_axis: str
    mean: float  # of the vertical accelerometer

    @property
    def accel_unit(self) -> tuple[str, float]:
        """Return the unit in which the vertical accelerometer is ± g, and the scale of "raw"; ("", 1) if unknown."""
        size = abs(self.mean)
        for name in ("m/s^2", "g", "mg", "cm/s^2"):
            if abs(size * UNITS[name].si_factor / STANDARD_GRAVITY - 1.0) < GRAVITY_TOLERANCE:
                return name, 1.0
        word = next((w for w in WORDS_PER_G if abs(size / w - 1.0) < GRAVITY_TOLERANCE), 0)
        return ("raw", STANDARD_GRAVITY / word) if word else ("", 1.0)

    @property
    def is_level(self) -> bool:
        """Return True if z points up, or if the vertical axis is unknown."""
        name = plain_name(self.vertical_axis)
        return name == "" or (self.mean > 0.0 and re.search(_accel_pattern("z"), name) is not None)


def imu_columns(table: LogTable, names: Collection[str]) -> ImuColumns:
    """Return the columns of an IMU among `names`. Without gravity in three accelerometers z points up."""
    accels = {axis: _first(names, _accel_pattern(axis)) for axis in NEXT_AXIS}
    axis, mean = _vertical_axis({axis: _numbers(table, name) for axis, name in accels.items()})
    sign, forward = 1 if mean >= 0.0 else -1, NEXT_AXIS[axis]
    gyro = _first(names, YAW_PATTERN if axis == "z" else _gyro_pattern(axis))
    entries = ((accels[forward], 1), (accels[NEXT_AXIS[forward]], sign), (gyro, sign))
    x, y, z = (SignedColumn(*entry) for entry in entries)
    return ImuColumns((x, y, z), accels[axis] if mean else "", mean)


def axis_names(names: Collection[str]) -> set[str]:
    """Return the columns among `names` that the axes of an IMU need."""
    patterns = [
        YAW_PATTERN,
        *(pattern(axis) for pattern in (_accel_pattern, _gyro_pattern) for axis in NEXT_AXIS),
    ]
    return {_first(names, pattern) for pattern in patterns} - {""}


def axis_findings(signal: ColumnSignal, table: LogTable) -> list[ImportFinding]:
    """Return at most one finding, if the map reads the gyro along another axis than the vertical one that gravity
    shows."""
    if signal.kind != "imu" or signal.entries[2].column is None:
        return []
    columns, gyro = imu_columns(table, table.columns), signal.entries[2]
    gyro_column = SignedColumn(gyro.column or "", -1 if gyro.scale < 0.0 else 1)
    if not columns.vertical_axis or not columns.entries[2].name or gyro_column == columns.entries[2]:
        return []
    figures = {"key": gyro.key, "column": columns.vertical_axis, "mean": columns.mean}
    reason = note("recording.not-level", **figures, gyro=str(columns.entries[2]))
    line = note(
        "recording.write-axes", axes=", ".join(map(str, columns.entries)), column=columns.vertical_axis
    )
    return [ImportFinding("axes", "warning", reason, line)]


def _first(names: Collection[str], pattern: str) -> str:
    return next((name for name in names if re.search(pattern, plain_name(name))), "")


def _accel_pattern(axis: str) -> str:
    return rf"(^|_)(a(c+(el[a-z]*)?)?_?{axis}|ac+(el[a-z]*)?_({DIRECTIONS[axis]}))(_|$)"


def _gyro_pattern(axis: str) -> str:
    return rf"(gyro?|giro?)(scop[a-z]*)?_?{axis}(_|$)|(^|_)([gw]|omega_|angular_velocity_){axis}(_|$)"


def _numbers(table: LogTable, name: str) -> np.ndarray:
    """Return the finite numbers of a column; none for a missing column or one of text."""
    try:
        x = table.numbers(name) if name else np.zeros(0)
    except FileError:
        x = np.zeros(0)
    return x[np.isfinite(x)]


def _vertical_axis(accels: dict[str, np.ndarray]) -> tuple[str, float]:
    """Return the axis along gravity and the median of its accelerometer; ("z", 0) if gravity is not measured."""
    if min(map(len, accels.values())) < MIN_ROWS:
        return "z", 0.0
    medians = {axis: float(np.median(x)) for axis, x in accels.items()}
    *horizontal_axes, vertical_axis = sorted(medians, key=lambda axis: abs(medians[axis]))
    deviation = MAD * float(np.median(np.abs(accels[vertical_axis] - medians[vertical_axis])))
    min_mean = max(MIN_AXIS_RATIO * abs(medians[horizontal_axes[-1]]), MIN_DEVIATIONS * deviation)
    return (vertical_axis, medians[vertical_axis]) if abs(medians[vertical_axis]) > min_mean else ("z", 0.0)
