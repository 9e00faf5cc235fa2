"""Choose the terms that a model needs, by simulation error on held-out data: `choose`.

    M ← the least model of the kind                                         terms.py                      (1)
    forward: fit M with each of n more terms; its held-out error must be significantly lower than the error
             of M, t > t_{1 − α/n}. The first term not worse than the best, t ≤ t_{1 − α}, joins M        (2)
    until no term is good; then backward: a term stays if M without it is worse, t > t_{1 − α}            (3);
    if a term was dropped, forward and backward again without it

cross_validation.py defines error, folds and t; α = 5 %. A term at its bound, or collinear with M, is rejected.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from baqueano.calibration.rest import begins_at_rest, with_rest_gyro_bias
from baqueano.contracts.values import JsonObject
from baqueano.diagnostics import Diagnostic, note
from baqueano.errors import UsageError
from baqueano.identify.battery import separation_problem
from baqueano.identify.data.added_channels import BATTERY_CHANNEL
from baqueano.identify.data.record import FittedBlocks
from baqueano.identify.dataset import select_sensors
from baqueano.identify.estimation.search import Task, search
from baqueano.identify.fit import identify
from baqueano.identify.options import FitOptions
from baqueano.identify.parameters.free import (
    BATTERY_EFFECT,
    LAG_PATH,
    MIN_LAG,
    SERVO_LAG_PATH,
    free_parameters,
    has_offset,
)
from baqueano.identify.parameters.theta import fit_parameters
from baqueano.identify.residuals.informative_rows import min_sigma
from baqueano.identify.result.fit_result import Fit
from baqueano.identify.result.verdict import active_bound
from baqueano.messages import text
from baqueano.messages.language import translate as _
from baqueano.numerics.least_squares import Solution
from baqueano.numerics.normal_equations import dense, marginal_information, marginal_std
from baqueano.runs.run import Run
from baqueano.selection.choice import Choice, Decision, TermResult, channel_labels
from baqueano.selection.cross_validation import (
    GAP_S,
    HeldOutFolds,
    PairedComparison,
    Score,
    check_only_held_out,
    jackknife,
    paired_comparison,
)
from baqueano.selection.terms import (
    MIN_LAG_S,
    Term,
    candidate_terms,
    minimal_free,
    with_term_slots,
    with_terms,
    without_terms,
)
from baqueano.sensors.sampling import measures_pose
from baqueano.vehicle_file import VehicleFile

ALPHA = 0.05
ACCEPTED_OPTIONS = ("fixed", "bounds", "at_rest", "backend")  # options of a fit that `choose` accepts
MIN_INDEPENDENT = 1e-6  # least part of a term's information that is independent of the other parameters
MIN_COST_FALL = 2.0  # least fall of the cost per parameter: four times the mean fall by fitting pure noise
START_EVALUATIONS = 6  # evaluations to find the best start
MAX_ERROR_SHARE = 0.5  # of the largest start of a term: with a larger standard error it is not identifiable


class Model(NamedTuple):
    """A model while terms are added."""

    terms: tuple[Term, ...]
    theta: np.ndarray  # (p,)
    sigma: np.ndarray  # (m,)
    score: Score


class TermTrial(NamedTuple):
    """Trial of a term in a model."""

    result: TermResult
    theta: np.ndarray  # (p,)
    score: Score | None  # None: not tested on the folds


def choose(
    runs: Run | Sequence[Run], vehicle_file: VehicleFile, candidates: Sequence[str | Term] | None = None, *,
    use: Sequence[str] | None = None, free: Sequence[str] | None = None,
    options: FitOptions = FitOptions(),  # noqa: B008  it is frozen
    held_out: Sequence[Run] = (), progress: Callable[[str], object] | None = None,
) -> Choice:  # fmt: skip
    """Return the model of the kind of `vehicle_file` with the terms that the runs support, and its fit. `candidates`
    are names of terms (terms.py) or paths; default: all terms of the kind. `free` and `use` are as in `identify`; so
    are the `options` fixed, bounds, at_rest and backend. If given, the runs `held_out` decide the terms. Raise
    UsageError for an unknown name, for other options, or without a command."""
    option_names = [name for name in options.non_defaults if name not in ACCEPTED_OPTIONS]
    if option_names:
        raise UsageError.of("choose.options", options=option_names)
    runs, report = [runs] if isinstance(runs, Run) else list(runs), progress or (lambda text: None)
    check_only_held_out(held_out, runs)
    commands = [run.applied_commands[np.isfinite(run.applied_commands).all(axis=1)] for run in runs]
    if not sum(map(len, commands)):
        raise UsageError.of("choose.no-command")
    u, setup = np.concatenate(commands), FitSetup(runs, use, options, tuple(held_out))
    battery = any(BATTERY_CHANNEL in run.sensors for run in runs)
    blocks = FittedBlocks(vehicle_file.vehicle, vehicle_file.sensors)
    all_commands = np.concatenate([np.eye(u.shape[1]), -np.eye(u.shape[1])])
    core_file = without_terms(vehicle_file, candidate_terms(blocks, candidates, all_commands, battery))
    minimal = [
        path for path in minimal_free(core_file, free, u) if path.partition("[")[0] not in options.fixed
    ]
    report(_("fitting the smallest model"))
    base = setup.fit(core_file, minimal)
    terms = candidate_terms(base.blocks._replace(sensors=core_file.sensors), candidates, u, battery)
    terms = [t for t in terms if {path.partition("[")[0] for path in t.paths}.isdisjoint(options.fixed)]
    final_selection = _ModelSelection(setup, core_file, base, minimal, terms, report)
    model, results = final_selection.add_significant_terms()
    report(_("fitting the selected model"))
    return Choice(tuple(results), final_selection.fit_model(model, core_file), final_selection.rule)


class FitSetup(NamedTuple):
    """Runs and options that all fits of one choice share."""

    runs: list[Run]
    use: Sequence[str] | None
    options: FitOptions
    held_out: tuple[Run, ...]

    def fit(
        self, vehicle_file: VehicleFile, free: list[str], start: Mapping[str, float] | None = None
    ) -> Fit:
        """Return the fit of `free`, within the bounds of the user."""
        limits = {k: b for k, b in self.options.bounds.items() if any(path.startswith(k) for path in free)}
        options = replace(self.options, fixed=(), bounds=limits, start=start or {}, gyro_leads=False)
        return identify(self.runs, vehicle_file, free, use=self.use, options=options)


class _ModelSelection:
    """The problem with all terms in it, and the models that are fitted to it."""

    def __init__(
        self, setup: FitSetup, core_file: VehicleFile, base: Fit, least_paths: list[str], terms: list[Term],
        progress: Callable[[str], object],
    ) -> None:  # fmt: skip
        runs, use, options, validation_runs = setup
        self.how, self.least_paths, self.terms, self.progress = setup, least_paths, terms, progress
        self.ended: dict[str, tuple[tuple[float, ...], ...]] = {}  # the result of the last trial of each term
        base_file = with_rest_gyro_bias(core_file, runs)[0] if has_offset(core_file.vehicle) else core_file
        blocks, runs, channels = select_sensors(base_file, [*runs, *validation_runs], use)
        if any(measures_pose(sensor) for sensor in blocks.sensors):
            raise UsageError.of("choose.pose")
        blocks = with_term_slots(blocks, terms)
        paths = list(dict.fromkeys([*least_paths, *(path for term in terms for path in term.paths)]))
        bounds = {path: limits for path, limits in options.bounds.items() if path in paths}
        candidates, flags = free_parameters(blocks, paths, (), bounds), FitOptions(at_rest=options.at_rest)
        parameters = fit_parameters(blocks, candidates, runs, channels, base_file.rate_hz, flags)
        blocks, shape = parameters.blocks, parameters.shape
        self.paths = list(shape.shared_paths)
        at_rest = [begins_at_rest(run, blocks.sensors) for run in runs]
        held_out = HeldOutFolds(
            blocks, shape, parameters.records, at_rest, len(validation_runs), setup.options.backend
        )
        theta, held_out.low, held_out.high = parameters.start, parameters.low, parameters.high
        floor = min_sigma(blocks.sensors, held_out.all_residuals.z, held_out.all_residuals.masks)
        self.min_differences = np.zeros(len(theta))  # differences from neutral that are treated as 0
        for lag in (k for k, path in enumerate(self.paths) if path in (LAG_PATH, SERVO_LAG_PATH)):
            held_out.low[lag], self.min_differences[lag] = MIN_LAG_S, MIN_LAG / base_file.rate_hz
        self.held_out, self.channels, self.blocks = held_out, channel_labels(blocks), blocks
        for path, x in zip(base.names, base.estimate, strict=True):
            theta[self.paths.index(path)] = x if np.isfinite(x) else theta[self.paths.index(path)]
        for term in terms:
            theta[self._entries(term)] = term.neutral
        self.start = np.clip(theta, held_out.low, held_out.high)
        self.least = np.ones(len(theta), bool)
        self.least[len(least_paths) : len(paths)] = False
        self.task = Task(held_out.all_residuals, self.start, held_out.low, held_out.high, floor, None)

    @property
    def rule(self) -> str:
        """Return the sentences on the held-out data and on the condition for a term."""
        h = self.held_out
        if h.block_s:
            block_text = _("{count} blocks of about {block_s:.1f} s", count=h.count, block_s=h.block_s)
        else:
            block_text = _("{count} runs, each one a block", count=h.count)
        gap = _("whole runs") if h.whole_runs else _("{gap_s:g} s on each side were not used", gap_s=GAP_S)
        sentence = _(
            "Each model was fitted without a fifth of the data, and tested by its simulation of "
            "that fifth ({how}; {size}).",
            how=gap, size=block_text,
        )  # fmt: skip
        if h.unseen:
            sentence = _(
                "Each model was fitted to the runs, and tested by its simulation of the {unidentified} "
                "held-out runs ({size}).",
                unidentified=h.unseen, size=block_text,
            )  # fmt: skip
        criterion = _(
            "The fall of the mean error is divided by its standard error. A term is added if the ratio is "
            "above the {percent:g} % quantile of Student's t, shared by all terms. This limits how often a "
            "vehicle without such terms gets one.",
            percent=100 * ALPHA,
        )
        return f"{sentence} {criterion}"

    def add_significant_terms(self) -> tuple[Model, list[TermResult]]:
        """Return the model, and the last result for each term."""
        model, results, excluded_names = self.model((), self.start), {}, set()
        while True:
            model = self.add_terms(model, results, excluded_names)
            has_dropped = False
            while (trial := self.superfluous_term(model, results)) is not None:
                has_dropped = True
                excluded_names.add(trial.result.term.name)
                results[trial.result.term.name] = trial.result
                other_terms = tuple(term for term in model.terms if term.name not in excluded_names)
                model = self.model(other_terms, trial.theta)
            if not has_dropped:
                break
        have = {path for term in model.terms for path in term.paths}
        other_terms = [term for term in self.terms if not have.intersection(term.paths)]
        return model, [results[term.name] for term in (*model.terms, *other_terms) if term.name in results]

    def fit_model(self, model: Model, core_file: VehicleFile) -> Fit:
        """Return the fit of a model with its error bars, from its θ."""
        values = {path: float(x) for path, x in zip(self.paths, model.theta, strict=False)}
        paths = [path for term in model.terms for path in term.paths]
        vehicle_file = with_terms(core_file, self.terms, {path: values[path] for path in paths})
        start = {p: values[p] for p in self.least_paths}
        return self.how.fit(vehicle_file, [*self.least_paths, *paths], start)

    def model(self, terms: tuple[Term, ...], theta: np.ndarray) -> Model:
        """Return the model with `terms`, with its noise estimated again."""
        mask = self._mask(terms)
        end = search(self.task, np.where(mask, theta, self.start), ~mask)
        return Model(terms, end.solution.theta, end.sigma, self._score(end.solution.theta, mask, end.sigma))

    def add_terms(self, model: Model, last_results: dict[str, TermResult], excluded_names: set[str]) -> Model:
        """Add a term per round until none improves the model significantly; exclude the `excluded_names` terms.  (2)"""
        while True:
            have = {path for term in model.terms for path in term.paths}
            fields = {path.partition("[")[0] for path in have} | {""}
            open_ = [t for t in self.terms if t.name not in excluded_names and t.requires in fields]
            open_ = [term for term in open_ if not have.intersection(term.paths)]
            tries = []
            for term in open_:
                self.progress(_("{terms} terms: trying {term}", terms=len(model.terms), term=_(term.name)))
                tries.append(self.try_term(model, term, ALPHA / len(open_)))
                last_results[term.name] = tries[-1].result
            accepted_trials = [trial for trial in tries if trial.result.verdict == Decision.ADDED]
            if not accepted_trials:
                return model
            best_trial = _select_simplest(accepted_trials)
            for trial in accepted_trials:
                if trial is not best_trial:
                    last_results.pop(trial.result.term.name)
            self.progress(text(best_trial.result.message))
            model = self.model((*model.terms, best_trial.result.term), best_trial.theta)

    def try_term(self, model: Model, term: Term, alpha: float) -> TermTrial:
        """Return the trial of a term in a model: fitted to all data, then without the held-out data."""
        index, mask = self._entries(term), self._mask((*model.terms, term))
        base_cost = self.held_out.all_residuals.weight(model.sigma).evaluate(model.theta).cost
        end = self._best_start_fit(model, term, mask)
        if ban := self._exclusion(term, end.theta, end.bound, dense(end.evaluation.hessian), mask):
            return TermTrial(self._result(term, ban[0], ban[1], model, None, end.theta, 0.0), end.theta, None)
        if not base_cost - end.evaluation.cost > MIN_COST_FALL * len(index):
            gain = max(0.0, float((base_cost - end.evaluation.cost) / max(base_cost, 1e-300)))
            reason = note("term.brings-little", percent=100 * gain)
            result = self._result(term, Decision.EXCLUDED, reason, model, None, end.theta, 0.0)
            return TermTrial(result, end.theta, None)
        score = self._score(end.theta, mask, model.sigma)
        test = paired_comparison(model.score, score)
        verdict = Decision.ADDED if test.errors > test.critical_value(alpha) else Decision.EXCLUDED
        hessian_std = marginal_std(dense(end.evaluation.hessian), index, mask)
        std = np.fmax(jackknife(score, index.tolist()), hessian_std)
        reason = None
        if verdict == Decision.ADDED and term.paths == (BATTERY_EFFECT,):
            nominal_v = self.blocks.model.drivetrain.battery_nominal_v
            reason = separation_problem(float(end.theta[index][0]), float(std[0]), nominal_v)
        verdict = Decision.REFUSED if reason else verdict
        limit = test.critical_value(alpha)
        result = self._result(term, verdict, reason, model, (score, test), end.theta, limit)
        return TermTrial(result, end.theta, score)

    def _best_start_fit(self, model: Model, term: Term, is_free: np.ndarray) -> Solution:
        """Return the best fit with a term. A few steps from each start, and from the last result, select the start."""
        ends = []
        for start in self.ended.get(term.name, term.starts):
            theta = model.theta.copy()
            theta[self._entries(term)] = start
            ends.append(self.held_out.fit(theta, is_free, model.sigma, max_evaluations=START_EVALUATIONS))
        lowest = min(ends, key=lambda e: e.evaluation.cost if np.isfinite(e.evaluation.cost) else np.inf)
        end = self.held_out.fit(lowest.theta, is_free, model.sigma)
        entries = self._entries(term)
        if np.any(end.theta[entries] != self.start[entries]):
            self.ended[term.name] = (tuple(end.theta[entries].tolist()),)
        return end

    def superfluous_term(self, model: Model, last_results: dict[str, TermResult]) -> TermTrial | None:
        """Return the trial of the least needed of several terms if the model does not need it, else None.  (3)"""
        weakest_trial: TermTrial | None = None
        for term in model.terms if len(model.terms) > 1 else ():
            self.progress(_("testing if {term} is still needed", term=_(term.name)))
            remaining_terms = tuple(model_term for model_term in model.terms if model_term is not term)
            is_free, theta = self._mask(remaining_terms), model.theta.copy()
            theta[self._entries(term)] = self.start[self._entries(term)]
            end = self.held_out.fit(theta, is_free, model.sigma)
            score = self._score(end.theta, is_free, model.sigma)
            test = paired_comparison(score, model.score)
            limit = test.critical_value(ALPHA)
            verdict = Decision.ADDED if test.errors > limit else Decision.DROPPED
            smaller_model = model._replace(score=score)
            result = self._result(term, verdict, None, smaller_model, (model.score, test), model.theta, limit)
            if verdict == Decision.DROPPED and (
                weakest_trial is None or test.errors < weakest_trial.result.errors
            ):
                weakest_trial = TermTrial(result, end.theta, score)
            elif verdict == Decision.ADDED:
                last_results[term.name] = result
        return weakest_trial

    def _exclusion(
        self, term: Term, theta: np.ndarray, bound: np.ndarray, A: np.ndarray, is_free: np.ndarray
    ) -> tuple[Decision, Diagnostic] | None:
        """Return the decision (EXCLUDED or REFUSED) and its reason if a term is excluded, else None."""
        entries = self._entries(term)
        neutral = np.abs(theta[entries] - self.start[entries]) <= self.min_differences[entries]
        if neutral.all():
            return Decision.EXCLUDED, note("term.best-without")
        for k in entries[(bound[entries] != 0) & ~neutral]:
            return Decision.REFUSED, active_bound(self.paths[k], float(theta[k]), bool(bound[k] < 0))
        free_entries = np.flatnonzero(
            is_free & (np.diagonal(A) > 0.0) & ~np.isin(np.arange(len(is_free)), entries) & (bound == 0)
        )
        own_share = marginal_information(A, entries[~neutral], free_entries)
        if own_share < MIN_INDEPENDENT:
            return Decision.REFUSED, note("term.same-as-others")
        return None

    def _result(
        self, term: Term, verdict: Decision, reason: Diagnostic | None, model: Model, pair: tuple[Score, PairedComparison] | None,  # noqa: E501
        theta: np.ndarray, limit: float,
    ) -> TermResult:  # fmt: skip
        """Return the result of a term compared with `model`. `pair` is the score with the term, and its comparison."""
        entries = self._entries(term)
        score, test = pair or (model.score, PairedComparison(0.0, 0.0, 0.0, 0, model.score.loss.shape[0]))
        c = test.channel
        std = jackknife(score, entries.tolist()) if pair else np.full(len(entries), np.nan)
        largest_start = max(float(np.max(np.abs(np.subtract(start, term.neutral)))) for start in term.starts)
        if verdict == Decision.EXCLUDED and pair and float(np.max(std)) > MAX_ERROR_SHARE * largest_start:
            fall: JsonObject = {"percent": 100 * test.gain, "percent_std": 100 * test.std}
            reason = note("term.not-identifiable", value=theta[entries[0]], std=std[0], **fall)
        return TermResult(
            term, verdict, reason, self.channels[c], float(model.score.error[c]), float(score.error[c]),
            test.gain, test.std, test.errors, limit, tuple(map(float, theta[entries])), tuple(map(float, std)),
            float(model.score.one_step[c]), float(score.one_step[c]),
        )  # fmt: skip

    def _score(self, theta: np.ndarray, is_free: np.ndarray, sigma: np.ndarray) -> Score:
        return self.held_out.score(theta, is_free, sigma)

    def _entries(self, term: Term) -> np.ndarray:
        return np.array([self.paths.index(path) for path in term.paths])

    def _mask(self, terms: Sequence[Term]) -> np.ndarray:
        is_free = self.least.copy()
        for term in terms:
            is_free[self._entries(term)] = True
        return is_free


def _select_simplest(trials: list[TermTrial]) -> TermTrial:
    """Return the trial of the first term that is not significantly worse than the best."""
    best_trial = max(trials, key=lambda trial: trial.result.gain)
    for trial in trials:
        assert trial.score is not None
        assert best_trial.score is not None
        comparison = paired_comparison(trial.score, best_trial.score)
        if trial is best_trial or not comparison.errors > comparison.critical_value(ALPHA):
            return trial
    return best_trial
