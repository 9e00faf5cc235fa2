"""Give the standard deviations of the scales and zeros of an IMU, from the vehicle file or a data sheet.

A tolerance ± a of a data sheet is a uniform distribution, σ = a/√3 (Guide to the expression of uncertainty in
measurement, 4.3.7).
"""

from collections.abc import Mapping
from datetime import date
from typing import TYPE_CHECKING

import numpy as np

from baqueano.contracts.optional import has_field
from baqueano.contracts.values import JsonObject, Tree
from baqueano.errors import UsageError
from baqueano.parameter import all_parameters, parameters
from baqueano.sensors.imu import SCALE_TOLERANCE
from baqueano.sensors.sampling import is_imu
from baqueano.symbolic import value_at_path

if TYPE_CHECKING:
    from baqueano.vehicle_file import VehicleFile

ZERO_RATE_RAD_S = np.radians(20.0)  # ±, the zero-rate output of the MPU-6050's data sheet
CHANNELS = (("accel_scale", 0), ("accel_scale", 1), ("gyro_scale", 0))


def tolerance_std(tolerance: float) -> float:
    """Return the standard deviation of a value that lies within ± `tolerance`."""
    return tolerance / np.sqrt(3.0)


def scale_stds(vehicle_file: "VehicleFile", imu: str) -> np.ndarray:
    """Return the relative standard deviations (3,) of the scales of an IMU.

    They come from the file if they were measured or stated, else from a data sheet.
    """
    sensor = getattr(vehicle_file.sensors, imu)
    scales = [(f"sensors.{imu}.{field}", entry) for field, entry in CHANNELS]
    values = [float(np.ravel(getattr(sensor, field))[entry]) for field, entry in CHANNELS]
    stds = [_declared_stds(vehicle_file, vehicle_file, path)[entry] for path, entry in scales]
    return np.array(stds) / np.abs(values)


def declared_covariance(
    vehicle_file: "VehicleFile", blocks: Tree, exact_names: set[str], with_zero: bool
) -> tuple[list[str], np.ndarray]:
    """Return the paths (K,) of the uncertain parameters of the model and the sensors, and their covariance (K, K).

    Their standard deviations are in the file, or in a data sheet. Parameters in `exact_names` are excluded, and so are
    biases, except the zeros of gyros if `with_zero`. The correlations come from an earlier fit.
    """
    blocks_by_name = {"model": blocks.model}
    blocks_by_name |= {f"sensors.{name}": sensor for name, sensor in blocks.sensors._asdict().items()}
    stds: dict[str, float] = {}
    for owner, block in blocks_by_name.items():
        for field, p in all_parameters(block, owner):
            if p.role != "noise" and not p.walk:
                names = entry_paths(field, np.shape(value_at_path(blocks, field)))
                stds |= zip(names, _declared_stds(vehicle_file, blocks, field).tolist(), strict=True)
        if with_zero and has_field(block, "gyro_bias"):
            stds[f"{owner}.gyro_bias"] = assumed_gyro_bias_std(vehicle_file, owner.removeprefix("sensors."))
    stds = {path: std for path, std in stds.items() if std > 0.0 and path not in exact_names}
    correlation, paths = np.eye(len(stds)), list(stds)
    if vehicle_file.parameter_cov is not None:
        names, cov = vehicle_file.parameter_cov[:2]
        root = np.sqrt(np.diagonal(cov))
        indices = [k for k, path in enumerate(paths) if path in names and root[names.index(path)] > 0.0]
        rows = [names.index(paths[k]) for k in indices]
        correlation[np.ix_(indices, indices)] = cov[np.ix_(rows, rows)] / np.outer(root[rows], root[rows])
    std = np.array(list(stds.values()))
    return paths, correlation * np.outer(std, std)


def entry_paths(path: str, shape: tuple[int, ...]) -> list[str]:
    """Return the path of each entry of a field, such as "model.actuator_matrix[0,2]"."""
    return [f"{path}[{','.join(map(str, index))}]" for index in np.ndindex(shape)] if shape else [path]


def _declared_stds(vehicle_file: "VehicleFile", tree: Tree, path: str) -> np.ndarray:
    """Return the standard deviations (n,) of the entries of a parameter of `tree`, 0 if they are unknown.

    They come from a measurement, else from the key of the sensor, else from a data sheet.
    """
    owner, _, field = path.rpartition(".")
    block, origin = value_at_path(tree, owner), vehicle_file.provenance.get(path)
    p, sizes = dict(parameters(block))[field], np.abs(np.ravel(np.asarray(getattr(block, field), float)))
    stds = np.zeros(len(sizes))
    if is_imu(block) and p.role == "scale" and (not p.std or p.std not in _table(vehicle_file, owner)):
        stds = sizes * tolerance_std(SCALE_TOLERANCE)
    elif p.std and not p.walk:
        stds = sizes * _entries(getattr(block, p.std), len(sizes))
    if origin is None or origin.std is None:
        return stds
    measured_stds = _entries(origin.std, len(sizes))
    return np.where(np.isfinite(measured_stds), measured_stds, stds)


def _entries(values: Tree, count: int) -> np.ndarray:
    """Return the first `count` entries of an array; the last one is repeated if it has fewer entries."""
    values_1d = np.ravel(np.asarray(values, float))
    return values_1d[np.minimum(np.arange(count), len(values_1d) - 1)]


def _table(vehicle_file: "VehicleFile", path: str) -> JsonObject:
    """Return the table of the file at a dotted path, as written."""
    table = vehicle_file.data
    for key in path.split("."):
        table = table.get(key, {})
    return table


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
            raise UsageError.of("tolerance.no-scale", path=path, vehicle=name, valid=scale_paths)
        if not 0.0 <= relative_tolerance < 1.0:
            raise UsageError.of("tolerance.no-part", path=path, part=relative_tolerance)
        value = np.asarray(value_at_path(vehicle_file, path), float)
        std = np.abs(value) * tolerance_std(relative_tolerance)
        values[path] = value.tolist()
        origins[path] = Provenance(f"stated, ± {100.0 * relative_tolerance:g} %", date.today(), std.tolist())
    return vehicle_file.with_values(values, origins) if values else vehicle_file


def assumed_gyro_bias_std(vehicle_file: "VehicleFile", imu: str) -> float:
    """Return the standard deviation of a gyro's zero [rad/s]: measured, else of the file, else of a data sheet."""
    std_rad_s = measured_gyro_bias_std(vehicle_file, imu)
    if std_rad_s is None and "gyro_bias_std" in _table(vehicle_file, f"sensors.{imu}"):
        return float(getattr(vehicle_file.sensors, imu).gyro_bias_std)
    return tolerance_std(ZERO_RATE_RAD_S) if std_rad_s is None else std_rad_s


def measured_gyro_bias_std(vehicle_file: "VehicleFile", imu: str) -> float | None:
    """Return the standard error of a gyro's zero [rad/s] in the file, or None if it was not measured."""
    origin = vehicle_file.provenance.get(f"sensors.{imu}.gyro_bias")
    std_rad_s = np.nan if origin is None or origin.std is None else float(np.ravel(origin.std)[0])
    return std_rad_s if np.isfinite(std_rad_s) else None
