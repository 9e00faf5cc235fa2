"""Compare the two models of the paper, dynamic and kinematic, by their predictions of accelerations and velocities.

Both are fitted to the same run and evaluated on another run. One criterion is R, the covariance of μ_t − g(u,
μ_{t−1}) against the truth (one step ahead). The other criterion is the velocity estimate of the EKF with this model.
An IMU has almost no information on the kinematic V. So V is fitted to the true velocity, as in the paper ("the real
values provided to simulate the system").
"""

from dataclasses import dataclass

import numpy as np

from baqueano.compare.errors import rms
from baqueano.contracts.values import TableRow
from baqueano.drive import replay
from baqueano.identify import Fit, FitOptions, identify
from baqueano.identify.noise.covariances import measure_noise
from baqueano.messages.language import mark as N_, number, translate as _
from baqueano.messages.text_table import text_table
from baqueano.runs import Run
from baqueano.runs.interpolation import interpolate_rows
from baqueano.vehicle_file import VehicleFile, parse

KINEMATIC = """[model]
kind = "kinematic"
velocity_matrix = [[0.1, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.05]]

"""


@dataclass(frozen=True)
class ModelEvaluation:
    """A model with its fit, the covariance R of its one-step errors, and the EKF's errors on a held-out run."""

    model: str
    fit: Fit
    process_noise_cov: np.ndarray  # R (6, 6) of (ν, ν̇) per tick
    velocity_rmse: np.ndarray  # (3,) rms errors [m/s, m/s, rad/s]


def kinematic_file(vehicle: VehicleFile) -> VehicleFile:
    """Return the file of the same vehicle with the kinematic model."""
    a, b = vehicle.text.index("[model]"), vehicle.text.index("[sensors")
    return parse(vehicle.text[:a] + KINEMATIC + vehicle.text[b:], f"{vehicle.name}, kinematic")


def compare_models(
    dynamic: Fit, run: Run, validation_run: Run, backend: str = "auto"
) -> tuple[ModelEvaluation, ModelEvaluation]:
    """Return the evaluations of the model of `dynamic` and of the kinematic model, both fitted to `run`."""
    kinematic = identify(
        run, kinematic_file(dynamic.file), use=("truth",), options=FitOptions(backend=backend)
    )
    return tuple(
        _evaluate_model(name, fit, run, validation_run, backend)
        for name, fit in (("dynamic", dynamic), ("kinematic", kinematic))
    )  # type: ignore[return-value]


def _evaluate_model(model: str, fit: Fit, run: Run, validation_run: Run, backend: str) -> ModelEvaluation:
    noise = measure_noise(fit, run, source="truth", backend=backend)
    replay_run = replay(validation_run, noise.updated_file(fit.vehicle_file), backend=backend)
    log = replay_run.estimate
    assert log is not None
    assert validation_run.truth is not None
    error = log.nu - interpolate_rows(log.t_ns, validation_run.truth.t_ns, validation_run.truth.nu)
    return ModelEvaluation(model, fit, noise.process, np.array([rms(error[:, k]) for k in range(3)]))


def rows(models: tuple[ModelEvaluation, ...]) -> list[TableRow]:
    """Return a row per model: one-step errors (square roots of the diagonal of R) and the EKF's velocity errors."""
    return [
        {
            "model": j.model,
            "R: ν_x [m/s]": float(np.sqrt(j.process_noise_cov[0, 0])),
            "R: ν_ψ [rad/s]": float(np.sqrt(j.process_noise_cov[2, 2])),
            "R: ν̇_x [m/s²]": float(np.sqrt(j.process_noise_cov[3, 3])),
            "R: ν̇_ψ [rad/s²]": float(np.sqrt(j.process_noise_cov[5, 5])),
            N_("EKF: ν_x error [m/s]"): float(j.velocity_rmse[0]),
            N_("EKF: ν_ψ error [rad/s]"): float(j.velocity_rmse[2]),
        }
        for j in models
    ]


def table(models: tuple[ModelEvaluation, ...]) -> str:
    """Return the rows as a text table."""
    figures = rows(models)
    keys = list(figures[0])
    cells = (
        [_(row[key]) if isinstance(row[key], str) else format(number(row[key]), ".3g") for key in keys]
        for row in figures
    )
    lines = text_table(">" * len(keys), [_(key) for key in keys], *cells)
    return "\n".join(
        [_("Predictions of each model (one step ahead, and as the EKF's model on another run)"), *lines]
    )
