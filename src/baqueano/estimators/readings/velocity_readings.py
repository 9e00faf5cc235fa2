"""The velocity that each sensor measures, derived from its h, even for your own sensors.

Rows of z = h(η, ν, ν̇) that depend only on ν are readings of a velocity. A sensor with a row that depends only on ν_ψ
is a gyro, and is used first. Wheels and odometers follow, each for the entries u of ν that no earlier sensor measures:

    z = h(0) + H ν,    L H_u = I,   L = (H_uᵀ H_u)⁻¹ H_uᵀ                                                 (1)

H is the derivative ∂h/∂ν, H_u its columns u. So ν + L (z − h(ν)) is the measured velocity, with the calibration of
the sensor's block.
"""

from typing import NamedTuple

import numpy as np

from baqueano.contracts.blocks import Sensor, SensorBlocks
from baqueano.contracts.values import Value
from baqueano.estimators.readings.sensor_numbers import (
    REST_MOTION,
    check_use,
    measured_channels,
    measurement_jacobian,
)
from baqueano.signals import ByName, Slot

SIDEWAYS_INDEX, TURNING_INDEX = 1, 2


class Reading(NamedTuple):
    """The entries of ν that a sensor measures, with the derivatives of its h."""

    name: str  # of the sensor
    rows: tuple[int, ...]  # of its z
    entries: tuple[int, ...]  # entries of ν that it measures
    at_rest: np.ndarray  # h(0) (m,)
    jacobian: np.ndarray  # H (m, 3)
    inverse: np.ndarray  # L (3, m); rows of zeros for the entries that it does not measure

    @property
    def is_gyro(self) -> bool:
        """Return True if the sensor measures only the yaw rate."""
        return self.entries == (TURNING_INDEX,)


def velocity_readings(sensors: SensorBlocks, use: tuple[str, ...] = ()) -> tuple[Reading, ...]:
    """Return the readings of the sensors named in `use`, or of all sensors if it is empty; gyros are first."""
    check_use(sensors, use)
    jacobians = {
        name: velocity_rows(getattr(sensors, name)) for name in use or getattr(sensors, "_fields", ())
    }
    gyros = [name for name, rows in jacobians.items() if any(is_turning(row) for row in rows.values())]
    readings: list[Reading] = []
    for name in [*gyros, *(name for name in jacobians if name not in gyros)]:
        rows = {k: row for k, row in jacobians[name].items() if name not in gyros or is_turning(row)}
        measured_entries = {i for reading in readings for i in reading.entries}
        entries = [
            i for i in range(3) if i not in measured_entries and any(row[i] != 0.0 for row in rows.values())
        ]
        if len(entries) > len(rows):
            entries = [i for i in entries if i != SIDEWAYS_INDEX]  # ν_y follows from the model
        if entries and len(entries) <= len(rows):
            H, at_rest = np.array(list(rows.values())), getattr(sensors, name).h(REST_MOTION)[list(rows)]
            readings.append(Reading(name, tuple(rows), tuple(entries), at_rest, H, left_inverse(H, entries)))
    return tuple(readings)


def velocity_rows(sensor: Sensor) -> dict[int, np.ndarray]:
    """Return ∂h/∂ν (3,) of each row of h that depends only on ν."""
    return {
        k: row[3:6]
        for k, row in enumerate(measurement_jacobian(sensor))
        if np.any(row[3:6]) and not np.any(row[[0, 1, 2, 6, 7, 8]])
    }


def measured_velocity(
    readings: tuple[Reading, ...], sensors: SensorBlocks, slots: ByName[Slot], nu: np.ndarray
) -> Value:
    """Return ν (3,), in which each reading that arrived replaces the entries that it measures."""
    for reading in readings:
        nu = replace_velocity(reading, getattr(sensors, reading.name), getattr(slots, reading.name), nu)
    return nu


def pose_sensors(sensors: SensorBlocks) -> tuple[str, ...]:
    """Return the names of the sensors that measure the pose: their h depends on η."""
    return tuple(
        name for name, sensor in sensors._asdict().items() if np.any(measurement_jacobian(sensor)[:, :3])
    )


def is_turning(row: np.ndarray) -> bool:
    """Return True for a row of ∂h/∂ν (3,) that depends only on the yaw rate, as for a gyro."""
    return not np.any(row[:TURNING_INDEX])


def left_inverse(H: np.ndarray, entries: list[int]) -> np.ndarray:
    """Return L (3, m); its rows are zero for the entries of ν that are not in `entries`.  (1)"""
    columns, L = H[:, entries], np.zeros((3, len(H)))
    L[entries] = np.linalg.solve(columns.T @ columns, columns.T)
    return L


def replace_velocity(
    reading: Reading, sensor: Sensor, slot: Slot, nu: np.ndarray, bias: Value = 0.0, scale: Value = 0.0
) -> Value:
    """Return ν (3,) with the reading, after removal of `bias` and `scale`; `nu` if no reading arrived.  (1)"""
    mask = measured_rows(reading, sensor, slot)
    L = reading.inverse * mask[None, :]
    if len(reading.entries) == 1:  # the rows that arrived determine the entry: L H = I for them
        share = np.sum(L[reading.entries[0]] * reading.jacobian[:, reading.entries[0]])
        L = L / np.where(share > 0.0, share, 1.0)
    z = np.where(mask > 0.0, slot.z[list(reading.rows)], reading.at_rest)
    return nu + L @ ((z - reading.at_rest - bias) / (1.0 + scale) - reading.jacobian @ nu)


def measured_rows(reading: Reading, sensor: Sensor, slot: Slot) -> np.ndarray:
    """Return 1 (m,) for each row that arrived and is used, else 0. Rows that measure several entries are used only
    together; of several rows that measure one entry, a missing one does not exclude the others.
    """
    mask = measured_channels(sensor, slot)[list(reading.rows)]
    entry, *other_entries = reading.entries
    if other_entries:
        return mask * np.where(np.sum(mask) == len(reading.rows), 1.0, 0.0)
    return mask * np.where(reading.jacobian[:, entry] != 0.0, 1.0, 0.0)


def has_reading(reading: Reading, sensor: Sensor, slot: Slot) -> Value:
    """Return True if the reading arrived, at least in part."""
    return np.sum(measured_rows(reading, sensor, slot)) > 0.0
