"""Compare gains and noise of a fit with the vehicle file.

    G = diag(1/m, 1/m, 1/I) T            accelerations of a command (V itself for a kinematic model)         (1)
    G_y = l_x G_ψ,   G_x = −l_y G_ψ      effect of an IMU at (l_x, l_y) if the command turns the vehicle     (2)

The file can be wrong. But if a command of the fit pushes backward, sideways or five times as hard, a wrong log is more
probable.
"""

from collections.abc import Sequence

import numpy as np

from baqueano.contracts.optional import has_field
from baqueano.contracts.values import JsonObject, Tree
from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.identify.data.record import FittedBlocks
from baqueano.identify.parameters.free import entries, value
from baqueano.parameter import all_parameters
from baqueano.runs.diagnostics.signal_map import nearest_ratio
from baqueano.symbolic import value_at_path

# times the value in the file: tolerances of data sheet and scale, or a guess of half or double
MAX_GAIN_RATIO = 2.0
MODEL_TOLERANCE = 0.1  # relative change of a gain by an imperfect model, in addition to its standard error
IMPLAUSIBLE_RATIO = 20.0  # times the value in the file: larger than for any wrong guess of a vehicle
SIGNIFICANT_SIGMA = 5.0  # standard errors
# times the noise of the file; below SILENT_RATIO the run is a simulation without noise
QUIET_RATIO, SILENT_RATIO = 0.2, 1e-4
UNITS = {
    57.29578: "guess.degrees", 9.80665: "guess.g", 255.0: "guess.pwm", 100.0: "guess.percent", 1000.0: "guess.milli",
}  # fmt: skip
AXIS_NAMES, TURNING_AXIS = ("forward", "sideways", "turning"), 2


def gain_findings(
    blocks: FittedBlocks, names: Sequence[str], estimate: np.ndarray, std: np.ndarray
) -> list[Diagnostic]:
    """Return findings on fitted gains that disagree with the gains in `blocks`."""
    estimates = {
        n: (float(e), float(s)) for n, e, s in zip(names, estimate, std, strict=True) if np.isfinite(e)
    }
    return _scalar_gain_findings(blocks, estimates) + _matrix_findings(blocks, estimates)


def noise_findings(file_sigma: np.ndarray, sigma: np.ndarray, labels: Sequence[str]) -> list[Diagnostic]:
    """Return findings on channels whose noise `sigma` (m,) is much less than `file_sigma` (m,), that of the file."""
    findings = []
    for label, was, now in zip(labels, file_sigma, sigma, strict=True):
        if was > 0.0 and SILENT_RATIO < now / was < QUIET_RATIO:
            figures: JsonObject = {"guess": _unit(was / now), "sigma": float(now), "times": float(now / was)}
            findings.append(note("file.quiet", Severity.WARNING, "", label, **figures))
    return findings


def _scalar_gain_findings(
    blocks: FittedBlocks, estimates: dict[str, tuple[float, float]]
) -> list[Diagnostic]:
    findings = []
    for path, p in all_parameters(blocks.model, "model"):
        is_matrix = np.ndim(value_at_path(blocks, path)) == 2
        for entry in entries(blocks, path) if p.role == "gain" and not is_matrix else ():
            if entry in estimates and value(blocks, entry) != 0.0:
                findings += _comparison(entry, value(blocks, entry), *estimates[entry])
    return findings


def _comparison(path: str, file_value: float, fitted: float, std: float) -> list[Diagnostic]:
    """Return findings on one gain compared with its value in the file."""
    if not abs(fitted - file_value) > SIGNIFICANT_SIGMA * std:
        return []
    ratio = fitted / file_value
    if ratio < 0.0:
        return [note("file.inverted", Severity.WARNING, subject=path, now=fitted, was=file_value)]
    factor = max(ratio, 1.0 / max(ratio, 1e-12))
    if factor * (1.0 - max(SIGNIFICANT_SIGMA * std / abs(fitted), MODEL_TOLERANCE)) < MAX_GAIN_RATIO:
        return []
    if factor > IMPLAUSIBLE_RATIO:
        return [note("file.far-gain", Severity.ERROR, subject=path, times=ratio, guess=_unit(factor))]
    return [note("file.gain", Severity.WARNING, subject=path, times=ratio, guess=_unit(factor))]


def _unit(off: float) -> Diagnostic | str:
    code = UNITS.get(nearest_ratio(off, 0.8, 1.25, UNITS))
    return note(code) if code else ""


def _matrix_findings(blocks: FittedBlocks, estimates: dict[str, tuple[float, float]]) -> list[Diagnostic]:
    """Return findings on each column of the gain matrix: the largest entry in the file must stay the largest, and its
    value must agree with the file. If a turning command moves the vehicle more along another axis, a lever arm is
    suggested. (1), (2)"""
    model = blocks.model
    path = next(
        (k for k, p in all_parameters(model, "model") if p.role == "gain" and p.shape == (3, 3)), None
    )
    if path is None:
        return []
    file_gains, scale, findings = np.asarray(value_at_path(blocks, path), float), _mass_and_inertia(model), []
    for j in range(file_gains.shape[1]):
        paths = [f"{path}[{i},{j}]" for i in range(3)]
        main_axis = int(np.argmax(np.abs(file_gains[:, j]) / scale))
        if file_gains[main_axis, j] == 0.0 or paths[main_axis] not in estimates:
            continue
        fitted_gains = np.array([estimates.get(p, (file_gains[i, j], 0.0))[0] for i, p in enumerate(paths)])
        sizes, file_sizes = (
            _comparable_magnitudes(gains / scale, file_gains, scale)
            for gains in (fitted_gains, file_gains[:, j])
        )
        second_axis = int(np.argmax(np.where(np.arange(3) == main_axis, 0.0, sizes)))
        is_second_larger = sizes[second_axis] > sizes[main_axis]
        if is_second_larger and MAX_GAIN_RATIO * sizes[main_axis] < file_sizes[main_axis]:
            axes = {
                k: note(f"axis.{AXIS_NAMES[i]}") for k, i in (("expected", main_axis), ("value", second_axis))
            }
            findings.append(note("file.swapped", Severity.WARNING, "", f"u[{j}]", **axes))
            continue
        offset = _offset_path(blocks)
        if is_second_larger and main_axis == TURNING_AXIS and offset:
            axis = note(f"axis.{AXIS_NAMES[second_axis]}")
            findings.append(
                note("file.lever-arm", Severity.WARNING, f"--free +{offset}", f"u[{j}]", axis=axis)
            )
        findings += _comparison(paths[main_axis], file_gains[main_axis, j], *estimates[paths[main_axis]])
    return findings


def _offset_path(blocks: FittedBlocks) -> str:
    """Return the path of the lever arm of a sensor, else of the centre of mass, else ""."""
    for name, sensor in blocks.sensors._asdict().items():
        if has_field(sensor, "lever_arm_m"):
            return f"sensors.{name}.lever_arm_m"
    return "model.centre_of_mass_x_m" if has_field(blocks.model, "centre_of_mass_x_m") else ""


def _comparable_magnitudes(fitted: np.ndarray, file_gains: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Return the comparable magnitudes (3,) of the accelerations `fitted` (3,) of a command. The turning entry is
    multiplied by the ratio of linear to turning gain in the file."""
    gains = np.max(np.abs(file_gains) / scale[:, None], axis=1)
    linear = max(gains[0], gains[1])
    ratio = linear / gains[2] if gains[2] > 0.0 and linear > 0.0 else 1.0
    return np.abs(fitted) * np.array([1.0, 1.0, ratio])


def _mass_and_inertia(model: Tree) -> np.ndarray:
    """Return (m, m, I) (3,), or ones for a kinematic model."""
    if has_field(model, "mass_kg"):
        return np.array([model.mass_kg, model.mass_kg, model.inertia_kg_m2])
    return np.ones(3)
