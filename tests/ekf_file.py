"""A vehicle file whose estimator is the EKF of the paper's state, (η, ν, ν̇), with R."""

import re

from baqueano.vehicle_file import VehicleFile, parse

R = {  # per tick
    "small": (5e-7, 2e-7, 6e-6, 2e-4, 4e-4, 5e-3),
    "car": (1e-4, 1e-5, 1e-3, 2e-2, 2e-2, 1e-1),
}


def with_ekf(file: VehicleFile, name: str = "small") -> VehicleFile:
    """Return the file of a vehicle of the garage with kind = "ekf" in [estimator], and R."""
    rows = ", ".join(str([x if i == j else 0.0 for j in range(6)]) for i, x in enumerate(R[name]))
    use = ", ".join(f'"{sensor}"' for sensor in file.estimator().use)
    table = f'[estimator]\nkind = "ekf"\nuse = [{use}]\nprocess_noise_cov = [{rows}]\n\n'
    text = re.sub(r"(?ms)^\[estimator\].*?(?=^\[|\Z)", "", file.text)
    return parse(re.sub(r"(?m)^\[controller\]", table + "[controller]", text, count=1), file.label)
