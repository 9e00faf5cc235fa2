"""Find structure in the residuals of a fit, and estimate its effect on the parameters.

    share_c = √γ_c(1) / spread of the prediction of channel c                                             (1)
    excess_c = spread of r_c / spread of the second differences of r_c over √6                            (2)
    z = (mean rank of |ḣ| among readings beyond 4 σ − ½) √(12 n)                                          (3)

The tests are for the terms of unmodelled_terms.py, and for a change of each parameter between parts of the data. The
parts are the first 1/4 to 3/4 of the time, each run, and kinds of motion, such as forward, left or fast. A result needs
a p-value below 1/40,000, because there are some 250 tests (a low-pass of the IMU: 1/300). Also, a parameter must move
by over 2 of its errors and 2 %, or differ between parts by over 5 %. The shift, and half of the difference of parts,
are added to the error bars. γ(1), the covariance of neighbouring residuals, is motion outside the model. If it is above
5 % of the predicted motion, or 0.5 % with (2) above 1.3, parameters are not accurate to 5 %. Outliers during fast
changes of the prediction (3) mean that the model has a wrong delay or is too simple.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.identify.data.record import FittedBlocks
from baqueano.identify.diagnostics.score_test import (
    FitResiduals,
    ScoreTest,
    fit_residuals,
    score_test,
    score_test_parts,
)
from baqueano.identify.diagnostics.unmodelled_terms import (
    FittedMotion,
    LabelledTerm,
    fitted_motion,
    term_columns,
)
from baqueano.identify.parameters.free import DELAY
from baqueano.identify.residuals.noise_level import MAD
from baqueano.identify.residuals.simulation import Residuals

# of Student's t at 1.25e-5 on each side, by degrees of freedom
SURE = (
    (1, 2.5e4),
    (2, 200.0),
    (3, 44.5),
    (5, 14.9),
    (7, 9.8),
    (9, 7.9),
    (14, 6.2),
    (19, 5.5),
    (29, 5.0),
    (59, 4.6),
)
LIKELY = 3.0  # standard errors for a low-pass: nearly every IMU has one, so less evidence suffices
MOVES_SD, MOVES = 2.0, 0.02  # least shift: in standard errors, and relative to the parameter
DIFFERS = 0.05  # relative to the parameter
SHARE, EXCESS = 0.05, 1.3  # (1), (2)
ENOUGH = 20  # measurements of a channel
FAR, FEW, FAR_Z = 4.0, 8, 5.0  # (3): standard deviations, readings, standard errors
MOST_REPORTED = 2  # results that are reported, the most significant first
RUNS = 8  # up to this number, each run is compared with the others


def check_residuals(
    blocks: FittedBlocks,
    problem: Residuals,
    theta: np.ndarray,
    identifiable: np.ndarray,
    sd: np.ndarray,
) -> tuple[list[Diagnostic], dict[str, float]]:
    """Return findings at θ (p,), and the error of each parameter that they cause, by path.

    The `identifiable` (p,) entries have standard errors `sd` (p,); the problem is weighted with the estimated
    noise.
    """
    index = np.flatnonzero(identifiable[: problem.layout.shared])
    if not len(index):
        return _of_residuals(problem, problem.residuals(theta)), {}
    now = fitted_motion(blocks, problem, theta)
    candidates = list if now is None else term_columns(blocks, problem, now)
    fit = fit_residuals(problem, theta, identifiable)
    fit_evidence = _FitEvidence(fit, [problem.shape.shared[i] for i in index], theta[index], sd[index])
    messages, parts = _of_residuals(problem, fit.residuals), _parts(fit_evidence, now)
    answers = [pair for names, D in candidates() for pair in zip(names, score_test(fit, D), strict=True)]
    off: dict[str, float] = {}
    for clear in (missing := _missing(fit_evidence, answers)) + parts:
        for path, by in fit_evidence.widens(clear.by):
            off[path] = max(by, off.get(path, 0.0))
    return [*messages, *(clear.message for clear in (*missing[:MOST_REPORTED], *parts[:MOST_REPORTED]))], off


class _Clear(NamedTuple):
    """A significant result of a test."""

    z: float
    message: Diagnostic
    by: np.ndarray  # (k,) possible errors of the parameters


class _FitEvidence:
    """A fit, its residuals, and the standard errors of its parameters."""

    def __init__(
        self, residuals: FitResiduals, paths: Sequence[str], theta: np.ndarray, sd: np.ndarray
    ) -> None:
        self.residuals, self.paths, self.theta, self.sd = residuals, paths, theta, sd
        self.names = [path.removeprefix("model.") for path in paths]

    def clear(self, answer: ScoreTest) -> bool:
        """Return True if the result is significant."""
        if abs(answer.z) <= SURE[-1][1]:
            return False
        dof = [-1.0 / d for d, _ in SURE]
        sure = np.exp(np.interp(-1.0 / max(answer.freedom, 1.0), dof, np.log([t for _, t in SURE])))
        return bool(abs(answer.z) > sure)

    def widens(self, by: np.ndarray) -> tuple[tuple[str, float], ...]:
        """Return (path, error) for each parameter whose error in `by` (k,) is above 0."""
        return tuple((path, float(x)) for path, x in zip(self.paths, by, strict=True) if x > 0.0)

    def most_biased(self, answer: ScoreTest) -> int | None:
        """Return the index of the parameter with the largest shift, in standard errors, or None if all are small."""
        far = np.abs(answer.shift) / np.maximum(self.sd, 1e-300)
        counts = (far > MOVES_SD) & (np.abs(answer.shift) > MOVES * np.abs(self.theta))
        return int(np.argmax(np.where(counts, far, -1.0))) if counts.any() else None


def _missing(fit: _FitEvidence, answers: Sequence[tuple[LabelledTerm, ScoreTest]]) -> list[_Clear]:
    by_size = sorted(answers, key=lambda pair: -abs(pair[1].z))
    out = []
    for (code, term_note), answer in by_size:
        filtered = term_note.code == "term.low-pass"
        if not (abs(answer.z) > LIKELY if filtered else fit.clear(answer)):
            continue
        k, delay = fit.most_biased(answer), code == "delay"
        if delay and DELAY in fit.paths:
            continue  # the delay is in the model: this effect has another shape
        if k is not None:
            path = f"sensors.{term_note.subject}.low_pass_hz" if filtered else DELAY
            message = note(
                "residual.missing-free" if delay or filtered else "residual.missing", Severity.WARNING,
                f"--free +{path}" if delay or filtered else "", fit.paths[k], term=code, what=term_note,
                z=abs(answer.z), errors=abs(answer.shift[k]) / fit.sd[k],
            )  # fmt: skip
            out.append(_Clear(abs(answer.z), message, np.abs(answer.shift)))
    return out


def _parts(fit: _FitEvidence, now: FittedMotion | None) -> list[_Clear]:
    worst: list[_Clear] = []
    parts = list(_masks(fit.residuals, now))
    for (part, _), answers in zip(
        parts, score_test_parts(fit.residuals, [mask for _, mask in parts]), strict=True
    ):
        for k, answer in enumerate(answers):
            if abs(answer.size) > DIFFERS * abs(fit.theta[k]) and fit.clear(answer):
                message = note(
                    "residual.parts-differ", Severity.WARNING, subject=fit.paths[k], off=answer.size, part=part,
                    over_all=fit.theta[k], z=abs(answer.z),
                )  # fmt: skip
                half = 0.5 * abs(answer.size) * (np.arange(len(fit.theta)) == k)
                worst.append(_Clear(abs(answer.z), message, half))
    return sorted(worst, key=lambda clear: -clear.z)


def _masks(residuals: FitResiduals, now: FittedMotion | None) -> Iterator[tuple[Diagnostic, np.ndarray]]:
    n = len(residuals.run)
    for part in (0.25, 1 / 3, 0.5, 2 / 3, 0.75):
        yield note("part.first", percent=100.0 * part), np.arange(n) < part * n
    count = int(residuals.run.max()) + 1
    if 2 < count <= RUNS:
        for number in range(count):
            yield note("part.run", number=number + 1), residuals.run == number
    if now is None:
        return
    (x, _, w), (x_dot, _, w_dot) = now.nu.T, now.nu_dot.T
    yield note("part.forward"), x > 0.0
    yield note("part.left"), w > 0.0
    yield note("part.fast"), np.abs(x) > np.median(np.abs(x))
    yield note("part.in-turns"), np.abs(w) > np.median(np.abs(w))
    yield note("part.gaining-speed"), x * x_dot > 0.0
    yield note("part.turning-faster"), w * w_dot > 0.0


def _channels(
    problem: Residuals, residuals: Sequence[np.ndarray]
) -> Iterator[tuple[str, list[np.ndarray], list[np.ndarray]]]:
    """Yield for each channel its name, and per segment the residuals r and predictions h (n,) at its measurements,
    in standard deviations."""
    labels = [f"{name}[{i}]" for name, m in zip(problem.names, problem.sizes, strict=True) for i in range(m)]
    for c, label in enumerate(labels):
        has_samples = [has[:, c] > 0.0 for has in problem.has]
        r = [x[t, c] for x, t in zip(residuals, has_samples, strict=True)]
        z = [x[t, c] * w[t, c] for x, w, t in zip(problem.z, problem.weights, has_samples, strict=True)]
        yield label, r, [a - b for a, b in zip(z, r, strict=True)]


def _of_residuals(problem: Residuals, residuals: Sequence[np.ndarray]) -> list[Diagnostic]:
    """Return messages on autocorrelated residuals, and on outliers during fast changes."""
    out = []
    for label, r, h in _channels(problem, residuals):
        if sum(map(len, r)) >= ENOUGH:
            out += _autocorrelation_messages(label, r, h) + _late_outliers(label, r, h)
    return out


def _autocorrelation_messages(label: str, r: list[np.ndarray], h: list[np.ndarray]) -> list[Diagnostic]:
    """Return a message if the residuals are autocorrelated and large.  (1), (2)"""
    limited = [np.clip(x, -3.0, 3.0) for x in r]
    count = sum(max(0, len(x) - 1) for x in limited)
    gamma = sum(float(x[1:] @ x[:-1]) for x in limited) / max(count, 1)
    model = float(np.std(np.concatenate(h)))
    if not gamma > 5.0 / np.sqrt(max(count, 1)):
        return []
    share = np.sqrt(gamma) / model if model > 0.0 else np.inf
    rough = MAD * float(np.median(np.abs(np.concatenate([np.diff(x, 2) for x in r])))) / np.sqrt(6.0)
    excess = MAD * float(np.median(np.abs(np.concatenate(r)))) / max(rough, 1e-9)
    if not (share > SHARE or (share > 0.1 * SHARE and excess > EXCESS)):
        return []
    percent = 100.0 * float(share) if np.isfinite(share) else 100.0
    return [note("residual.autocorrelated", Severity.WARNING, subject=label, percent=percent, times=excess)]


def _late_outliers(label: str, r: list[np.ndarray], h: list[np.ndarray]) -> list[Diagnostic]:
    """Return a message if outliers occur during fast changes of the prediction.  (3)"""
    far = np.abs(np.concatenate(r)) > FAR
    n = int(far.sum())
    if n < FEW:
        return []
    speed = np.concatenate(
        [np.maximum(np.abs(np.diff(x, prepend=x[:1])), np.abs(np.diff(x, append=x[-1:]))) for x in h]
    )
    rank = np.empty(len(speed))
    rank[np.argsort(speed, kind="stable")] = np.arange(len(speed)) / len(speed)
    z = (float(rank[far].mean()) - 0.5) * np.sqrt(12.0 * n)
    if z < FAR_Z:
        return []
    return [note("residual.late", Severity.WARNING, subject=label, readings=n, beyond=FAR, z=float(z))]
