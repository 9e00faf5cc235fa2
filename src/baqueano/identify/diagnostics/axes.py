"""Does each channel of a sensor follow its own prediction, another's, or the opposite of its own?

The signal map (runs/diagnostics/signal_map.py) of what was measured and what the model says, of any scale. The gains of
a fit bend to what was measured, so that an inverted sensor shows here only where another one contradicts it; else it is
the file that does (against_file.py); and where no fit is left to compare with, the model as the search began with it is
asked. Readings are clipped at 4 standard deviations of their own about the median.
"""

import numpy as np

from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.identify.residuals.noise_level import MAD
from baqueano.identify.residuals.simulation import Residuals
from baqueano.runs.diagnostics.signal_map import MappedChannel, signal_map

MOST = 2000  # samples that are looked at, evenly
FAR = 4.0
RAN_AWAY = 1e6  # SI units, of a model


def checked(problem: Residuals, theta: np.ndarray) -> list[Diagnostic]:
    """Swapped and inverted channels."""
    out = []
    for name, size in zip(problem.names, problem.sizes, strict=True):
        found = signal_map(*of_sensor(problem, theta, name), [MappedChannel()] * size)
        for i, one in enumerate(found):
            rho, channel = one.relation.correlation, f"{name}[{i}]"
            if one.code == "inverted":
                out.append(note("axes.inverted", Severity.ERROR, subject=channel, correlation=rho))
            elif one.code == "swapped" and (j := one.of) < i:
                both = {"other": channel, "first": found[j].relation.correlation, "second": rho}
                out.append(note("axes.swapped", Severity.ERROR, subject=f"{name}[{j}]", **both))
    return out


def of_sensor(problem: Residuals, theta: np.ndarray, name: str) -> tuple[np.ndarray, np.ndarray]:
    """What the channels of a sensor measured, and what the model says of them (n, m)."""
    k = problem.names.index(name)
    span = slice(sum(problem.sizes[:k]), sum(problem.sizes[: k + 1]))
    z, h = measured(problem)[:, span], predicted(problem, theta)[:, span]
    rows = np.flatnonzero(np.isfinite(z).any(axis=1))
    rows = rows[:: max(1, len(rows) // MOST)]
    return clipped(z[rows]), clipped(h[rows])


def measured(problem: Residuals) -> np.ndarray:
    """What was measured in all pieces (N, m), NaN where nothing was."""
    return np.where(np.concatenate(problem.has) > 0.0, np.concatenate(problem.z), np.nan)


def predicted(problem: Residuals, theta: np.ndarray) -> np.ndarray:
    """What the model says of all pieces (N, m), NaN where it ran away."""
    h = np.concatenate(problem.predictions(theta))
    return np.where(np.abs(h) < RAN_AWAY, h, np.nan)


def clipped(x: np.ndarray) -> np.ndarray:
    """The columns of x (n, m), drawn to FAR standard deviations about the median, told by the median too."""
    x = x.copy()
    for column in x.T:
        if len(known := column[np.isfinite(column)]):
            middle = float(np.median(known))
            size = FAR * max(MAD * float(np.median(np.abs(known - middle))), 0.1 * float(np.std(known)))
            np.clip(column, middle - size, middle + size, out=column)
    return x
