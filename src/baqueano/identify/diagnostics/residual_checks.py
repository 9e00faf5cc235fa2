"""Find structure in the residuals of a fit, and estimate its effect on the parameters.

    share_c = √γ_c(1) / spread of the prediction of channel c                                             (1)
    excess_c = spread of r_c / spread of the second differences of r_c over √6                            (2)
    z = (mean rank of |ḣ| among readings beyond 4 σ − ½) √(12 n)                                          (3)

The tests are for the terms of unmodelled_terms.py, and for a change of each parameter between parts of the data. The
parts are the first 1/4 to 3/4 of the time, each run, and kinds of motion, such as forward, left or fast. A result
needs a p-value below 1/40,000, because there are some 250 tests (a low-pass of the IMU: 1/300). Also, a parameter
must shift by more than 2 standard errors and 2 %, or differ between parts by more than 5 %. The covariance contains
the shifts, and for parts those to both values. A later drive has a value between both, so 1/√3 of these shifts is in
the error of the speed. γ(1), the covariance of neighbouring residuals, is motion outside the model. If it is above 5 %
of the predicted motion, or 0.5 % with (2) above 1.3, parameters are not accurate to 5 %. Outliers during fast changes
of the prediction (3) mean a wrong delay or a model that is too simple.
"""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple, TypeAlias

import numpy as np

from baqueano.calibration.tolerances import tolerance_std
from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.estimators.augmented.motion import MIN_SPEED_M_S
from baqueano.identify.data.record import FittedBlocks
from baqueano.identify.diagnostics.unmodelled_terms import Effect, FittedMotion, fitted_motion, term_columns
from baqueano.identify.identifiability import larger_bound
from baqueano.identify.parameters.free import BACK_EMF_PATH, DELAY_PATH, LAG_PATH, SERVO_LAG_PATH
from baqueano.identify.residuals.simulation import Residuals
from baqueano.numerics.parallel import dot
from baqueano.numerics.score_test import (
    FitResiduals,
    Nuisance,
    ScoreTest,
    bounded_test,
    nuisance_shift,
    score_test,
    score_test_parts,
    score_test_residuals,
)
from baqueano.numerics.statistics import MAD, largest_errors_cov, lines_by_sign, student_quantile, white_std
from baqueano.parameter import all_parameters
from baqueano.vehicles.freedoms import sign_speed_paths, tyre_paths
from baqueano.vehicles.state import DynamicVehicle

P_VALUE = 2.5e-5  # p-value below which a result is significant
LEAST_CRITICAL_Z = student_quantile(1.0 - 0.5 * P_VALUE, np.inf)
LOW_PASS_Z = 3.0  # standard errors for a low-pass: nearly every IMU has one, so less evidence is sufficient
MIN_SHIFT_STD, MIN_RELATIVE_SHIFT = 2.0, 0.02  # least shift: in standard errors, and of the parameter
MIN_RELATIVE_DIFFERENCE = 0.05  # relative to the parameter
MIN_SHARE, MIN_EXCESS = 0.05, 1.3  # (1), (2)
MIN_MEASUREMENTS = 20  # measurements of a channel
OUTLIER_SIGMA, MIN_OUTLIERS, LATE_Z = 4.0, 8, 5.0  # (3): standard deviations, readings, standard errors
DEAD_ZONES = "model.drivetrain.dead_zone_forward model.drivetrain.dead_zone_backward"
TERM_KEYS = {  # code of an effect → keys of the file that model it
    "term.delay": DELAY_PATH,
    "term.motor-lag": LAG_PATH,
    "term.servo-delay": SERVO_LAG_PATH,
    "term.back-emf": BACK_EMF_PATH,
    "term.sag": "model.drivetrain.sag",
    "term.low-pass": "sensors.{sensor}.low_pass_hz",
    "term.imu-turned": "sensors.{sensor}.heading_rad",
    "term.turning-about": "model.centre_of_mass_x_m",
    "term.dead-zone": DEAD_ZONES,
    "term.asymmetry": DEAD_ZONES,
    "term.slope": "model.slope_rad",
    "term.imu-ahead": "sensors.{sensor}.lever_arm_m",
    "term.imu-beside": "sensors.{sensor}.lever_arm_m",
}
# the direction of a slope of 0 does not matter, so the search for both starts at another value
SLOPE_START = " --free +model.slope_heading_rad --set model.slope_rad=0.02 --set model.slope_heading_rad={}"
UPHILL_RAD = {"slope, map x": (0.0, 3.1), "slope, map y": (1.6, -1.6)}  # start of χ by the sign of the effect
# the yaw rate of a car follows its curvature, so a drag about ψ is a curvature that falls with the speed
TYRE_TERMS = {f"{code}, psi" for code in ("drag", "steep drag", "cornering", "turning", "slip")}
HIDDEN_EFFECTS = {  # code of an effect that no sensor shows → variances of Δθ to subtract, more for a rare effect
    "term.friction-speed": 1.0, "term.backlash": 1.0, "term.slow-sag": 4.0, "term.servo-delay": 4.0,
}  # fmt: skip
TermTests: TypeAlias = Sequence[tuple[Effect, ScoreTest]]
MAX_REPORTED = 3  # results that are reported: those with a remedy first, then the most significant
MAX_COMPARED_RUNS = 8  # up to this number, each run is compared with the others


def check_residuals(
    blocks: FittedBlocks,
    problem: Residuals,
    theta: np.ndarray,
    identifiable: np.ndarray,
    std: np.ndarray,
    bounds: tuple[np.ndarray, np.ndarray],
) -> "Diagnosis":
    """Return findings at θ (p,), and their consequences for the s shared entries.

    The `identifiable` (p,) entries have standard errors `std` (p,), and `bounds`, low (p,) and high (p,).
    """
    s = problem.layout.shared_count
    index = np.flatnonzero(identifiable[:s])
    if not len(index):
        return Diagnosis.of(_residual_messages(problem, problem.residuals(theta)), s)
    motion = fitted_motion(blocks, problem, theta)
    candidates = list if motion is None else term_columns(blocks, problem, motion)
    fit = fit_residuals(problem, theta, identifiable)
    low, high = (bound[index] - theta[index] for bound in bounds)
    paths = [problem.shape.shared_paths[i] for i in index]
    xw = np.zeros((len(fit.run), 2)) if motion is None else motion.nu[:, ::2]
    is_run_entry = identifiable[s : problem.layout.first_start].reshape(problem.layout.run_count, -1)
    count = int(is_run_entry.any(axis=1).sum())
    free = dict(zip(problem.shape.shared_paths, bounds[1][:s].tolist(), strict=True))
    fit_evidence = _FitEvidence(fit, paths, theta[index], std[index], low, high, count, free)
    messages, differences = _residual_messages(problem, fit.residuals), _differing_parts(fit_evidence, motion)
    tests = [pair for names, D in candidates() for pair in zip(names, score_test(fit, D), strict=True)]
    missing_terms = _missing_terms(fit_evidence, tests, blocks.model)
    hidden_errors = [
        e for code, n in HIDDEN_EFFECTS.items() for e in _effect_errors(code, -n, fit_evidence, tests)
    ]
    by_fix: dict[str, Diagnostic] = {}  # one message of those with the same remedy
    for _, message, _ in missing_terms:
        by_fix.setdefault(message.fix.partition(" --set")[0] or message.figures["effect"].code, message)
    messages += sorted(by_fix.values(), key=lambda message: not message.fix)[:MAX_REPORTED]
    messages += [result.message for result in differences[:MAX_REPORTED]]
    diagnosis, entries = Diagnosis.of(messages, s), np.ix_(index, index)
    effects = hidden_errors + [e for result in missing_terms + differences for e in result.effects]
    shifts = np.array([np.zeros(len(index)), *(effect.shift for effect in effects)])
    diagnosis.unmodelled_cov[entries] = largest_errors_cov(shifts)
    lags = _effect_errors("term.low-pass", 1.0, fit_evidence, tests)
    diagnosis.lag_errors[index] = sum(lag.shift for lag in lags)
    all_shifts, speeds = np.zeros((len(shifts), s)), np.zeros((len(xw), len(shifts)))
    all_shifts[:, index] = shifts
    for k, effect in enumerate(effects, 1):
        speeds[:, k] = effect.speed
    lines = [line.B for line in lines_by_sign(xw, speeds, MIN_SPEED_M_S)]
    all_shifts[len(shifts) - sum(len(result.effects) for result in differences) :] *= tolerance_std(1.0)
    run_errors = np.zeros(is_run_entry.size)
    run_errors[is_run_entry.ravel()] = np.max([np.abs(effect.run) for effect in effects], axis=0, initial=0.0)
    return diagnosis._replace(
        shifts=all_shifts, speed_changes=np.moveaxis(np.array(lines), 2, 0), run_errors=run_errors
    )


def _effect_errors(code: str, variances: float, fit: "_FitEvidence", tests: TermTests) -> list["_FitChange"]:
    """Return the changes of the fit by each effect `code`, also if its test is not significant. The factor √(1 + n/z²)
    adds n `variances` of Δθ."""
    pairs = [pair for pair in tests if pair[0].description.code == code and pair[1].gain > 0.0]
    factors = [np.sqrt(max(1.0 + variances / (test.z**2 or test.gain), 0.0)) for _, test in pairs]
    changes = [fit.effect(test, term.speed) for term, test in pairs]
    return [_FitChange(*(f * x for x in change)) for f, change in zip(factors, changes, strict=True)]


def fit_residuals(problem: Residuals, theta: np.ndarray, identifiable: np.ndarray) -> FitResiduals:
    """Return the residuals at θ for score tests. `identifiable` (p,) masks the entries that the data determine."""
    layout, segments = problem.layout, problem.sensitivities(theta, last=True)
    s, o = layout.shared_count, layout.run_entry_count
    ends = np.cumsum([0, *(len(r) for r, _, _ in segments)])
    run = np.repeat(layout.runs, np.diff(ends))
    nuisances = [
        Nuisance(slice(a, b), s + o, identifiable[layout.start_slice(k)])
        for k, (a, b) in enumerate(pairwise(ends.tolist()))
    ]
    for k in range(layout.run_count):
        first, *_, last = np.flatnonzero(run == k).tolist()
        nuisances.append(Nuisance(slice(first, last + 1), s, identifiable[s + k * o : s + (k + 1) * o]))
    signal_std = problem.signal_std()
    signal = float(sum(np.sum((weight * signal_std) ** 2) for weight in problem.weights))
    mask = np.concatenate(problem.masks).ravel() > 0.0
    return score_test_residuals(
        [segment[:2] for segment in segments], mask, run, identifiable[:s], nuisances, signal
    )


class Diagnosis(NamedTuple):
    """Findings about a finished search, and their consequences for the s shared entries of θ."""

    messages: list[Diagnostic]
    unmodelled_cov: np.ndarray  # (s, s) covariance by effects that the model lacks
    lag_errors: np.ndarray  # (s,) errors of θ by a short lag that the file lacks
    shifts: np.ndarray  # (n, s) standard deviation of the change of θ by each of these effects
    speed_changes: np.ndarray  # (n, 2, 3) change of ν_x by the effect itself: `lines_by_sign`
    run_errors: np.ndarray | float = 0.0  # (runs q,) largest change of the entries of each run by an effect

    @classmethod
    def of(cls, messages: list[Diagnostic], s: int) -> "Diagnosis":
        """Return findings without consequences."""
        return cls(messages, np.zeros((s, s)), np.zeros(s), np.zeros((0, s)), np.zeros((0, 2, 3)))


class _FitChange(NamedTuple):
    """The change of a fit by an effect that the model lacks."""

    shift: np.ndarray  # (k,) of the parameters
    run: np.ndarray  # of the entries of each run, such as biases
    speed: np.ndarray | float  # (N,) of ν_x by the effect itself, without that by the shift
    size: float  # of the effect


class _SignificantResult(NamedTuple):
    """A significant result of a test."""

    z: float
    message: Diagnostic
    effects: list[_FitChange]


class _FitEvidence(NamedTuple):
    """A fit and its k identifiable parameters."""

    residuals: FitResiduals
    paths: Sequence[str]  # (k,)
    theta: np.ndarray  # (k,)
    std: np.ndarray  # (k,) standard errors
    low: np.ndarray  # (k,) distances to the bounds
    high: np.ndarray  # (k,)
    run_count: int  # runs with entries of their own, the last nuisances of `residuals`
    free: dict[str, float]  # path of each free parameter, also if it is not identifiable → its upper bound

    def effect(self, test: ScoreTest, speed: np.ndarray | float = 0.0) -> _FitChange:
        """Return the change of the fit by an effect, within the bounds of θ. `speed` is that of its term."""
        test = bounded_test(self.residuals, test, self.low, self.high)
        run = nuisance_shift(self.residuals, test, self.run_count)
        return _FitChange(test.shift, run, test.size * speed, test.size)

    def is_significant(self, test: ScoreTest) -> bool:
        """Return True if |z| of the test is above the critical value for its degrees of freedom."""
        z = abs(test.z)
        return z > LEAST_CRITICAL_Z and z > student_quantile(1.0 - 0.5 * P_VALUE, max(test.freedom, 1.0))

    def most_biased(self, shift: np.ndarray) -> int | None:
        """Return the index of the parameter with the largest shift in standard errors, or None if all are small."""
        shift = np.abs(shift)
        relative_shift = shift / np.maximum(self.std, 1e-300)
        is_large = (relative_shift > MIN_SHIFT_STD) & (shift > MIN_RELATIVE_SHIFT * np.abs(self.theta))
        return int(np.argmax(np.where(is_large, relative_shift, -1.0))) if is_large.any() else None


def _missing_terms(fit: _FitEvidence, tests: TermTests, model: DynamicVehicle) -> list[_SignificantResult]:
    results = []
    for term, test in sorted(tests, key=lambda pair: -pair[1].gain):
        code, term_note, speed = term
        is_filter = term_note.code == "term.low-pass"
        if not (abs(test.z) > LOW_PASS_Z if is_filter else fit.is_significant(test)):
            continue
        effect = fit.effect(test, speed)
        k, fix = fit.most_biased(effect.shift), _fix(term_note, fit, model)
        if code in UPHILL_RAD and fix:
            fix += SLOPE_START.format(UPHILL_RAD[code][int(test.size < 0.0)])
        tyre = next((path for path in tyre_paths(model) if path not in fit.free), "")
        if tyre and test.z < 0.0 and code in TYRE_TERMS:
            fix = f"--free +{tyre}"
        if code == "delay" and not fix:
            continue  # the delay is already in the model, so this effect is not a delay
        if k is not None:
            message = note(
                "residual.missing-free" if fix else "residual.missing", Severity.WARNING, fix, fit.paths[k],
                term=code, effect=term_note, region=_place_text(code), z=abs(test.z),
                errors=abs(effect.shift[k]) / fit.std[k],
            )  # fmt: skip
            results.append(_SignificantResult(abs(test.z), message, [effect]))
    return results


def _fix(term_note: Diagnostic, fit: _FitEvidence, model: DynamicVehicle) -> str:
    """Return the options that add an effect to the model; "" without such options, or if its key is already free. If
    the delay of the commands is fixed, a clock offset would replace it, so both are estimated. A free delay that is not
    identifiable needs a larger bound."""
    free_keys = {path.partition("[")[0] for path in fit.free}
    if term_note.code == "term.delay-of-sensor":
        return f"{'' if DELAY_PATH in free_keys else f'--free +{DELAY_PATH} '}--clock {term_note.subject}"
    keys = TERM_KEYS.get(term_note.code, "").format(sensor=term_note.subject).split()
    keys = keys if len(keys) < 2 or free_keys & {*keys} else []  # else other effects look like it
    if term_note.code in ("term.dry-friction", "term.friction-speed"):  # its magnitude is free
        keys = [speed for path, speed in sign_speed_paths(model).items() if path in free_keys][:1]
    model_keys = dict(all_parameters(model, "model"))
    new = [key for key in keys if key not in free_keys and (key in model_keys or key.startswith("sensors."))]
    bounds = [larger_bound(key, fit.free[key]) for key in keys if key in fit.free.keys() - {*fit.paths}]
    return " ".join([*(f"--free +{key}" for key in new), *filter(None, bounds)])


def _place_text(code: str) -> Diagnostic | str:
    """Return the axis at the end of a term's code, as a note; "" without one."""
    name = code.rpartition(", ")[2]
    return note(f"term.along-{name}") if name in ("x", "y", "psi") else ""


def _differing_parts(fit: _FitEvidence, motion: FittedMotion | None) -> list[_SignificantResult]:
    results: list[_SignificantResult] = []
    parts, masks = zip(*_part_masks(fit.residuals, motion), strict=True)
    for part, tests in zip(parts, score_test_parts(fit.residuals, masks), strict=True):
        for k, test in enumerate(tests):
            if abs(test.size) > MIN_RELATIVE_DIFFERENCE * abs(fit.theta[k]) and fit.is_significant(test):
                message = note(
                    "residual.parts-differ", Severity.WARNING, subject=fit.paths[k], difference=test.size, part=part,
                    overall_value=fit.theta[k], z=abs(test.z),
                )  # fmt: skip
                effect, is_k = fit.effect(test), np.arange(len(fit.theta)) == k
                effects = [effect, effect._replace(shift=effect.shift + effect.size * is_k)]
                results.append(_SignificantResult(abs(test.z), message, effects))
    return sorted(results, key=lambda result: -result.z)


def _part_masks(
    residuals: FitResiduals, motion: FittedMotion | None
) -> Iterator[tuple[Diagnostic, np.ndarray]]:
    n = len(residuals.run)
    for fraction in (0.25, 1 / 3, 0.5, 2 / 3, 0.75):
        yield note("part.first", percent=100.0 * fraction), np.arange(n) < fraction * n
    count = int(residuals.run.max()) + 1
    if 2 < count <= MAX_COMPARED_RUNS:
        for run_index in range(count):
            yield note("part.run", number=run_index + 1), residuals.run == run_index
    if motion is None:
        return
    (x, _, w), (x_dot, _, w_dot) = motion.nu.T, motion.nu_dot.T
    yield note("part.forward"), x > 0.0
    yield note("part.left"), w > 0.0
    yield note("part.fast"), np.abs(x) > np.median(np.abs(x))
    yield note("part.in-turns"), np.abs(w) > np.median(np.abs(w))
    yield note("part.gaining-speed"), x * x_dot > 0.0
    yield note("part.turning-faster"), w * w_dot > 0.0


def _channels(
    problem: Residuals, residuals: Sequence[np.ndarray]
) -> Iterator[tuple[str, list[np.ndarray], list[np.ndarray]]]:
    """Yield for each channel its name, and its residuals r and predictions h of each segment (n,), divided by σ."""
    for c, label in enumerate(problem.labels):
        is_present = [mask[:, c] > 0.0 for mask in problem.masks]
        r = [x[t, c] for x, t in zip(residuals, is_present, strict=True)]
        z = [x[t, c] * w[t, c] for x, w, t in zip(problem.z, problem.weights, is_present, strict=True)]
        yield label, r, [a - b for a, b in zip(z, r, strict=True)]


def _residual_messages(problem: Residuals, residuals: Sequence[np.ndarray]) -> list[Diagnostic]:
    """Return messages on autocorrelated residuals, and on outliers during fast changes."""
    messages, fix = [], "" if DELAY_PATH in problem.shape.shared_paths else f"--free +{DELAY_PATH}"
    for label, r, h in _channels(problem, residuals):
        if sum(map(len, r)) >= MIN_MEASUREMENTS:
            messages += _autocorrelation_messages(label, r, h) + _late_outliers(label, r, h, fix)
    return messages


def _autocorrelation_messages(label: str, r: list[np.ndarray], h: list[np.ndarray]) -> list[Diagnostic]:
    """Return a message if the residuals are autocorrelated and large.  (1), (2)"""
    clipped_residuals = [np.clip(x, -3.0, 3.0) for x in r]
    count = sum(max(0, len(x) - 1) for x in clipped_residuals)
    gamma = sum(dot(x[1:], x[:-1]) for x in clipped_residuals) / max(count, 1)
    prediction_std = float(np.std(np.concatenate(h)))
    if not gamma > 5.0 / np.sqrt(max(count, 1)):
        return []
    share = np.sqrt(gamma) / prediction_std if prediction_std > 0.0 else np.inf
    excess = MAD * float(np.median(np.abs(np.concatenate(r)))) / max(white_std(r), 1e-9)
    if not (share > MIN_SHARE or (share > 0.1 * MIN_SHARE and excess > MIN_EXCESS)):
        return []
    percent = float(f"{100.0 * share if np.isfinite(share) else 100.0:.2g}")
    return [note("residual.autocorrelated", Severity.WARNING, subject=label, percent=percent, ratio=excess)]


def _late_outliers(label: str, r: list[np.ndarray], h: list[np.ndarray], fix: str) -> list[Diagnostic]:
    """Return a message if outliers occur during fast changes of the prediction. `fix` frees a fixed delay.  (3)"""
    is_outlier = np.abs(np.concatenate(r)) > OUTLIER_SIGMA
    n = int(is_outlier.sum())
    if n < MIN_OUTLIERS:
        return []
    steps = [np.abs(np.diff(x, prepend=x[:1], append=x[-1:])) for x in h]
    speed = np.concatenate([np.maximum(step[:-1], step[1:]) for step in steps])
    rank = np.empty(len(speed))
    rank[np.argsort(speed, kind="stable")] = np.arange(len(speed)) / len(speed)
    z = (float(rank[is_outlier].mean()) - 0.5) * np.sqrt(12.0 * n)
    if z < LATE_Z:
        return []
    code = "residual.late-readings" if fix else "residual.fast"
    return [note(code, Severity.WARNING, fix, label, readings=n, limit=OUTLIER_SIGMA, z=float(z))]
