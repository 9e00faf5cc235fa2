"""Compare the gains and the noise of a fit with their values in the vehicle file.

    G = diag(1/m, 1/m, 1/I) T            accelerations of a command (V itself for a kinematic model)      (1)
    G_y = l_x G_ψ,   G_x = −l_y G_ψ      what an IMU at (l_x, l_y) adds if the command turns the vehicle    (2)

The file may be wrong. But a command of the fit may push backward, sideways or five times as hard. Then the log is the
more likely reason: a swapped, inverted or differently scaled column. A scale that all commands and readings share does
not show in the residuals, so only the file can reveal it. Noise is compared with the file too, as it changes with the
unit and not with the vehicle.
"""

from collections.abc import Sequence

import numpy as np

from baqueano.contracts.optional import has_field
from baqueano.contracts.values import JsonObject, Tree
from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.identify.data.record import FittedBlocks
from baqueano.identify.parameters.free import entries, value
from baqueano.parameter import all_parameters
from baqueano.symbolic import get

GAIN = 2.0  # times the file's: the tolerances of data sheet and scale together, or a guess of half or double
TENTH = 0.1  # relative change of a gain by an imperfect model, beyond chance
WHOLE = 20.0  # times the file's: beyond any wrong guess of a vehicle
CLEAR = 5.0  # standard errors
QUIET, SILENT = 0.2, 1e-4  # times the noise of the file; below SILENT it is a simulation without noise
UNITS = {
    57.29578: "guess.degrees", 9.80665: "guess.g", 255.0: "guess.pwm", 100.0: "guess.percent", 1000.0: "guess.milli",
}  # fmt: skip
AXES, TURNING = ("forward", "sideways", "turning"), 2


def check_gain_changes(
    file: FittedBlocks,
    names: Sequence[str],
    estimate: np.ndarray,
    sd: np.ndarray,
    file_sigma: np.ndarray,
    sigma: np.ndarray,
    labels: Sequence[str],
) -> list[Diagnostic]:
    """Return messages on gains and noise that differ from the file before the fit.

    `estimate` and `sd` (p,) belong to `names`. `file_sigma` (m,) is the noise of the channels `labels` in the file,
    0 if the file does not contain it. `sigma` (m,) is the estimated noise.
    """  # fmt: skip
    return gains(file, names, estimate, sd) + _noise(file_sigma, sigma, labels)


def gains(file: FittedBlocks, names: Sequence[str], estimate: np.ndarray, sd: np.ndarray) -> list[Diagnostic]:
    """Return findings on fitted gains that disagree with the gains in `file`."""
    numbers = {n: (float(e), float(s)) for n, e, s in zip(names, estimate, sd, strict=True) if np.isfinite(e)}
    return _gains(file, numbers) + _matrix(file, numbers)


def _noise(file_sigma: np.ndarray, sigma: np.ndarray, labels: Sequence[str]) -> list[Diagnostic]:
    out = []
    for label, of_file, estimate in zip(labels, file_sigma, sigma, strict=True):
        if of_file > 0.0 and SILENT < estimate / of_file < QUIET:
            figures: JsonObject = {"sigma": float(estimate), "times": float(estimate / of_file)}
            out.append(
                note(
                    "file.quiet", Severity.WARNING, subject=label, guess=_unit(of_file / estimate), **figures
                )
            )
    return out


def _gains(file: FittedBlocks, numbers: dict[str, tuple[float, float]]) -> list[Diagnostic]:
    out = []
    for path, p in all_parameters(file.model, "model"):
        matrix = np.ndim(get(file, path)) == 2
        for entry in entries(file, path) if p.role == "gain" and not matrix else ():
            if entry in numbers and value(file, entry) != 0.0:
                out += _comparison(entry, value(file, entry), *numbers[entry])
    return out


def _comparison(path: str, was: float, now: float, sd: float) -> list[Diagnostic]:
    """Return findings on one gain compared with its value in the file."""
    if not abs(now - was) > CLEAR * sd:
        return []
    ratio = now / was
    if ratio < 0.0:
        return [note("file.inverted", Severity.WARNING, subject=path, now=now, was=was)]
    off = max(ratio, 1.0 / max(ratio, 1e-12))
    if off * (1.0 - max(CLEAR * sd / abs(now), TENTH)) < GAIN:
        return []
    if off > WHOLE:
        return [note("file.far-gain", Severity.ERROR, subject=path, times=ratio, guess=_unit(off))]
    return [note("file.gain", Severity.WARNING, subject=path, times=ratio, guess=_unit(off))]


def _unit(off: float) -> Diagnostic | str:
    for factor, code in UNITS.items():
        if 0.8 < off / factor < 1.25:
            return note(code)
    return ""


def _matrix(file: FittedBlocks, numbers: dict[str, tuple[float, float]]) -> list[Diagnostic]:
    """Return findings on the gain matrix by column: the largest entry in the file must stay the largest.  (1)"""
    model = file.model
    path = next(
        (k for k, p in all_parameters(model, "model") if p.role == "gain" and p.shape == (3, 3)), None
    )
    if path is None:
        return []
    was, scale, out = np.asarray(get(file, path), float), _inertia(model), []
    for j in range(was.shape[1]):
        paths = [f"{path}[{i},{j}]" for i in range(3)]
        main = int(np.argmax(np.abs(was[:, j]) / scale))
        if was[main, j] == 0.0 or paths[main] not in numbers:
            continue
        now = np.array([numbers.get(p, (was[i, j], 0.0))[0] for i, p in enumerate(paths)]) / scale
        size, before = _size(now, was, scale), _size(was[:, j] / scale, was, scale)
        second_axis = int(np.argmax(np.where(np.arange(3) == main, 0.0, size)))
        if size[second_axis] > size[main] and GAIN * size[main] < before[main]:
            out.append(
                note(
                    "file.swapped",
                    Severity.WARNING,
                    subject=f"u[{j}]",
                    expected=note(f"axis.{AXES[main]}"),
                    found=note(f"axis.{AXES[second_axis]}"),
                )
            )
            continue
        if size[second_axis] > size[main] and main == TURNING:
            lever = "--free +sensors.imu.lever_arm_m"
            axis = note(f"axis.{AXES[second_axis]}")
            out.append(note("file.lever-arm", Severity.WARNING, lever, f"u[{j}]", axis=axis))
        out += _comparison(paths[main], was[main, j], *numbers[paths[main]])
    return out


def _size(now: np.ndarray, was: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Return the size (3,) of the accelerations of a command. The turning entry is multiplied by the ratio of linear
    to turning gain in the file."""
    gains = np.max(np.abs(was) / scale[:, None], axis=1)
    linear = max(gains[0], gains[1])
    ratio = linear / gains[2] if gains[2] > 0.0 and linear > 0.0 else 1.0
    return np.abs(now) * np.array([1.0, 1.0, ratio])


def _inertia(model: Tree) -> np.ndarray:
    """Return (m, m, I) (3,), or ones for a kinematic model."""
    if has_field(model, "mass_kg"):
        return np.array([model.mass_kg, model.mass_kg, model.inertia_kg_m2])
    return np.ones(3)
