"""Predict poses from wheel speeds for skid-steered vehicles: Warthog and Husky (norlab-ulaval/DRIVE).

Each window of 2 s is a run. The two wheel radii, the effective track and the outward slide in a curve are fitted to the
windows of the first half. The lidar's poses are the measurements. For each window of the second half, the final pose is
predicted from the initial pose and the wheel speeds only. The vehicle file (warthog.toml) contains the nominal radius
and track as initial values. The Husky has other nominal values, and is a check on another vehicle.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from baqueano.contracts.values import TableRow
from baqueano.geometry import wrap
from baqueano.identify import Fit, FitOptions, identify
from baqueano.messages.language import translate as _
from baqueano.runs import Run
from baqueano.runs.importing import import_runs
from baqueano.study.recorded.criteria import maximum_row
from baqueano.study.recorded.simulated import final_poses
from baqueano.study.recordings import recorded_path
from baqueano.vehicle_file import VehicleFile, load

MAP = "drive_windows"
FILES = {
    "warthog": "drive_warthog_husky/warthog_windows_train.csv.gz",
    "husky": "drive_warthog_husky/husky_windows.csv.gz",
}
NOMINAL_SIZES = {"warthog": (0.30, 1.08), "husky": (0.165, 0.55)}  # radius, track [m]
FREE = ("model.drivetrain.gain", "model.velocity_matrix[2,2]", "model.slide_s")
MAX_ERROR_M, MAX_ERROR_RAD = 0.50, np.radians(12.0)


def files() -> list[str]:
    """Return the names of the files that this study reads."""
    return list(FILES.values())


def rows(progress: Callable[[str], None] = lambda text: None, backend: str = "auto") -> list[TableRow]:
    """Return the rows of the study, with recording, quantity, value, criterion and ok."""
    study_rows = []
    for name in FILES:
        runs = load_runs(name)
        half_count = len(runs) // 2
        progress(
            _(
                "{name}: fitting {fitted} windows of 2 s, testing on {others} others",
                name=name,
                fitted=half_count,
                others=len(runs) - half_count,
            )
        )
        fit = fit_windows(runs[:half_count], name, backend)
        error_m, error_rad = median_errors(fit.vehicle_file, runs[half_count:], backend)
        error_deg, max_deg = np.degrees([error_rad, MAX_ERROR_RAD]).tolist()
        study_rows.append(maximum_row(name, "2 s ahead, position [m, median]", error_m, MAX_ERROR_M, " m"))
        study_rows.append(maximum_row(name, "2 s ahead, heading [°, median]", error_deg, max_deg, "°"))
        progress(f"{name}: {fit_sentence(fit, name)}")
    return study_rows


def load_runs(name: str) -> list[Run]:
    """Return the windows of a vehicle as runs, in the order of the file."""
    return [imported_run.run for imported_run in import_runs(MAP, [recorded_path(FILES[name])])]


def nominal_file(name: str) -> VehicleFile:
    """Return the vehicle file with its nominal radius and track."""
    radius, track = NOMINAL_SIZES[name]
    return load(Path(__file__).parent / "warthog.toml").with_values(
        {"model.velocity_matrix[0,0]": radius, "model.velocity_matrix[2,2]": 2.0 * radius / track}
    )


def fit_windows(runs: list[Run], name: str, backend: str = "auto") -> Fit:
    """Return the fit of radii, effective track and slide to the windows `runs`."""
    return identify(runs, nominal_file(name), FREE, use=("truth",), options=FitOptions(backend=backend))


def median_errors(vehicle_file: VehicleFile, runs: list[Run], backend: str = "auto") -> tuple[float, float]:
    """Return the median errors of position [m] and heading [rad] at the ends of the windows."""
    ends = np.array([np.subtract(*final_poses(vehicle_file, run, backend)) for run in runs])
    return float(np.median(np.hypot(ends[:, 0], ends[:, 1]))), float(np.median(np.abs(wrap(ends[:, 2]))))


def fit_sentence(fit: Fit, name: str) -> str:
    """Return a sentence with the fitted radii, effective track and slide."""
    model = fit.vehicle_file.vehicle
    radius = model.velocity_matrix[0, 0]
    left, right = radius * model.drivetrain.gain
    track = 2.0 * radius / model.velocity_matrix[2, 2]
    return _(
        "radii {left:.3f} m and {right:.3f} m (nominal {radius:g}), effective track {track:.2f} m (nominal "
        "{width:g}), slides outward by {slide_s:.2f} s · ν_x ν_ψ",
        left=left,
        right=right,
        radius=NOMINAL_SIZES[name][0],
        track=track,
        width=NOMINAL_SIZES[name][1],
        slide_s=float(model.slide_s),
    )
