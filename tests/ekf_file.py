"""A vehicle file whose estimator is the EKF of the paper's state, (η, ν, ν̇), with R."""

import re

from baqueano.vehicle_file import VehicleFile, parse

R = (5e-7, 2e-7, 6e-6, 2e-4, 4e-4, 5e-3)  # of the small vehicle, per tick


def with_ekf(file: VehicleFile) -> VehicleFile:
    """The file with kind = "ekf" in [estimator]."""
    rows = ", ".join(str([x if i == j else 0.0 for j in range(6)]) for i, x in enumerate(R))
    table = f'[estimator]\nkind = "ekf"\nprocess_noise_cov = [{rows}]\n\n'
    text = re.sub(r"(?ms)^\[estimator\].*?(?=^\[|\Z)", "", file.text)
    return parse(re.sub(r"(?m)^\[controller\]", table + "[controller]", text, count=1), file.label)
