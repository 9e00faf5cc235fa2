"""Give the standard deviations of the scales and zeros of an IMU, from the vehicle file or a data sheet.

A tolerance ± a of a data sheet is a uniform distribution, σ = a/√3 (Guide to the expression of uncertainty in
measurement, 4.3.7).
"""

from collections.abc import Mapping
from datetime import date
from typing import TYPE_CHECKING

import numpy as np

from baqueano.contracts.optional import has_field
from baqueano.diagnostics import fault
from baqueano.errors import UsageError
from baqueano.sensors.imu import SCALE_TOLERANCE
from baqueano.symbolic import value_at_path

if TYPE_CHECKING:
    from baqueano.vehicle_file import VehicleFile

ZERO_RATE_RAD_S = np.radians(20.0)  # ±, the zero-rate output of the MPU-6050's data sheet
CHANNELS = (("accel_scale", 0), ("accel_scale", 1), ("gyro_scale", 0))


def std_of_tolerance(tolerance: float) -> float:
    """Return the standard deviation of a value that lies within ± `tolerance`."""
    return tolerance / np.sqrt(3.0)


def scale_stds(vehicle_file: "VehicleFile", imu: str) -> np.ndarray:
    """Return the relative standard deviations (3,) of the scales of an IMU.

    They are those of the file if they were measured or stated, else those of a data sheet.
    """
    stds = [
        _measured_relative_std(vehicle_file, f"sensors.{imu}.{field}", entry) for field, entry in CHANNELS
    ]
    return np.array([std_of_tolerance(SCALE_TOLERANCE) if std is None else std for std in stds])


def with_tolerance(vehicle_file: "VehicleFile", tolerance: Mapping[str, float]) -> "VehicleFile":
    """Return the file with standard deviations of scales: {"sensors.imu.gyro_scale": 0.01} means ± 1 % of the value,
    and 0 an exact value.
    Raise UsageError for a path that is not a scale of an IMU in the file, and for a tolerance outside 0 to 1."""
    from baqueano.vehicle_file import Provenance

    scale_paths = [
        f"sensors.{name}.{field}"
        for name, sensor in vehicle_file.sensors._asdict().items()
        for field in ("gyro_scale", "accel_scale")
        if has_field(sensor, field)
    ]
    values, origins = {}, {}
    for path, relative_tolerance in tolerance.items():
        if path not in scale_paths:
            name = vehicle_file.name
            raise UsageError(fault("tolerance.no-scale", path=path, vehicle=name, valid=scale_paths))
        if not 0.0 <= relative_tolerance < 1.0:
            raise UsageError(fault("tolerance.no-part", path=path, part=relative_tolerance))
        value = np.asarray(value_at_path(vehicle_file, path), float)
        std = np.abs(value) * std_of_tolerance(relative_tolerance)
        values[path] = value.tolist()
        origins[path] = Provenance(f"stated, ± {100.0 * relative_tolerance:g} %", date.today(), std.tolist())
    return vehicle_file.with_values(values, origins) if values else vehicle_file


def _measured_relative_std(vehicle_file: "VehicleFile", path: str, entry: int) -> float | None:
    """Return the relative standard error of a scale, or None if it was not measured."""
    origin = vehicle_file.provenance.get(path)
    if origin is None or origin.std is None:
        return None
    std, value = (np.ravel(np.asarray(x, float)) for x in (origin.std, value_at_path(vehicle_file, path)))
    relative = float(std[min(entry, len(std) - 1)] / abs(value[min(entry, len(value) - 1)]))
    return relative if np.isfinite(relative) else None


def std_of_gyro_bias(vehicle_file: "VehicleFile", imu: str) -> float:
    """Return the standard deviation of a gyro's zero [rad/s], from the file if measured, else from a data sheet."""
    std_rad_s = measured_std_of_gyro_bias(vehicle_file, imu)
    return std_of_tolerance(ZERO_RATE_RAD_S) if std_rad_s is None else std_rad_s


def measured_std_of_gyro_bias(vehicle_file: "VehicleFile", imu: str) -> float | None:
    """Return the standard error of a gyro's zero [rad/s] in the file, or None if it was not measured."""
    origin = vehicle_file.provenance.get(f"sensors.{imu}.gyro_bias")
    std_rad_s = np.nan if origin is None or origin.std is None else float(np.ravel(origin.std)[0])
    return std_rad_s if np.isfinite(std_rad_s) else None
