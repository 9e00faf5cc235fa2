"""Fit DART's JetRacer (TU Delft) to throttle steps from rest on two floors, with every second run held out.

On each floor the 1st, 3rd, 5th … run are fitted together. The other runs are simulated from the throttle only, from
rest, and compared with the encoder. The vehicle file (jetracer.toml) contains guesses. The free parameters are the
drive of a car: gain, viscous and dry friction, drag of the driven motor, dead zone, delay. The dead zone is rounded to
two digits, like its criterion.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from baqueano.contracts.values import TableRow
from baqueano.identify import Fit, FitOptions, identify
from baqueano.messages.language import mark as N_, number, translate as _
from baqueano.runs import Run
from baqueano.runs.importing import import_runs
from baqueano.study.recorded.criteria import criterion_row, maximum_row
from baqueano.study.recorded.simulated import measured_and_simulated
from baqueano.study.recordings import recorded_path
from baqueano.vehicle_file import load

MAP = "dart_jetracer"
FLOORS = {
    N_("rubbery floor"): "throttle_step_input_rubbery_floor_*",
    N_("hard floor"): "29_step_input_data_*",
}
FREE = (
    "model.throttle_gain",
    "model.linear_drag",
    "model.coulomb_m_s2",
    "model.motor_drag",
    "model.drivetrain.dead_zone_forward[0]",
    "model.drivetrain.delay_s",
)
RMSE_M_S, MIN_DEAD_ZONE, MAX_DEAD_ZONE = 0.092, 0.14, 0.17


def files() -> list[str]:
    """Return the names of the files that this study reads."""
    return [f"dart_jetracer/{pattern}.csv.gz" for pattern in FLOORS.values()]


def rows(progress: Callable[[str], None] = lambda text: None, backend: str = "auto") -> list[TableRow]:
    """Return the rows of the study, with recording, quantity, value, criterion and ok."""
    study_rows = []
    for floor, pattern in FLOORS.items():
        runs = load_runs(pattern)
        progress(
            _(
                "DART, {floor}: fitting {steps} throttle steps, testing on {others} others",
                floor=_(floor),
                steps=len(runs[0::2]),
                others=len(runs[1::2]),
            )
        )
        fit, error = fit_and_validate(runs, backend)
        zone = float(fit.vehicle_file.vehicle.drivetrain.dead_zone_forward[0])
        name = f"dart, {_(floor)}"
        criterion = f"{number(MIN_DEAD_ZONE)} … {number(MAX_DEAD_ZONE)}"
        is_within = MIN_DEAD_ZONE <= round(zone, 2) <= MAX_DEAD_ZONE
        study_rows.append(maximum_row(name, _("held-out speed error [m/s rms]"), error, RMSE_M_S))
        study_rows.append(criterion_row(name, _("dead zone"), zone, criterion, is_within))
    return study_rows


def load_runs(pattern: str) -> list[Run]:
    """Return the throttle steps of a floor, in the order of the drives."""
    paths = str(recorded_path(MAP) / f"{pattern}.csv.gz")
    return [imported_run.run for imported_run in import_runs(MAP, [paths])]


def fit_and_validate(runs: list[Run], backend: str = "auto") -> tuple[Fit, float]:
    """Return the fit to the 1st, 3rd, 5th … run, and the rms speed error of the other runs [m/s]."""
    vehicle_file = load(Path(__file__).parent / "jetracer.toml")
    fit = identify(
        runs[0::2], vehicle_file, FREE, use=("odometer",), options=FitOptions(at_rest=True, backend=backend)
    )
    errors = [
        np.subtract(*measured_and_simulated(fit.vehicle_file, run, "odometer", backend)) for run in runs[1::2]
    ]
    return fit, float(np.sqrt(np.mean(np.concatenate(errors) ** 2)))
