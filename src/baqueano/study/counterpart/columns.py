"""Link each parameter path of a vehicle file to a column of an array of the truth."""

import numpy as np

NO_COLUMN = -1  # an array without columns
BIASES = {  # path → field of Imus, column
    "sensors.imu.accel_bias[0]": ("bias", 0),
    "sensors.imu.accel_bias[1]": ("bias", 1),
    "sensors.imu.gyro_bias": ("bias", 2),
}


def column(values: np.ndarray, k: int) -> np.ndarray:
    """Return column k (n,) of an array of the truth, or the whole array for NO_COLUMN."""
    return (values if k == NO_COLUMN else values[:, k]).copy()


def add_change(
    new_fields: dict[str, np.ndarray], owner: object, entry: tuple[str, int], change: np.ndarray
) -> None:
    """Add `change` (n,) to the field and column `entry` of `owner`; collect the changed fields in `new_fields`."""
    name, k = entry
    new_fields.setdefault(name, getattr(owner, name).copy())
    new_fields[name][... if k == NO_COLUMN else (slice(None), k)] += change
