"""Fit and evaluate robots and cars of the independent truth like recordings, with physics that the model excludes.

    slip            wheels that slip, of a robot beyond 0.4 to 0.8 N; soft tyres of a car, steered up to full lock
    backlash        gears with 1 to 5 mm of play at the rim
    slope           a floor that rises by 2 to 6°
    second lag      motors of the second order, with another lag of 40 to 120 ms before the first one

Each effect is a parameter of the vehicle (study/truth), the same in both runs. A vehicle is fitted to 40 s of random
steps, with the free parameters that a user would choose. It is evaluated on 40 s of other steps. An odometer measures
the rotation of the wheels, with noise of 0.02 m/s. "Not worse" means a ratio of at most ALONE. A refused fit is not
written, and its vehicle is not evaluated.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from baqueano.contracts.values import TableRow
from baqueano.diagnostics import Verdict
from baqueano.errors import BaqueanoError
from baqueano.messages.language import mark as N_, translate as _
from baqueano.study.counterpart import drive_runs
from baqueano.study.estimation.errors import QUANTITIES
from baqueano.study.estimation.evaluation import EstimateEvaluation, evaluate
from baqueano.study.estimation.subjects import SENSOR_SETS, Subject
from baqueano.study.faults.subject import VEHICLES, FaultSubject as Driven, subject
from baqueano.study.truth import Cars, Robots
from baqueano.sweep.workers import run_in_processes
from baqueano.vehicle_file import parse

DURATION_S = 40.0
SHARE, ALONE = 0.95, 1.10
BATCH_SIZE = 8  # vehicles that are simulated together
TEST_SEED_OFFSET = 10_000  # added to a seed, for the signal and the noise of the evaluation run
FULL_LOCK = {"command.limit": [0.6, 0.8]}
ODOMETER = '\n[sensors.odometer]\nkind = "odometer"\nrate_hz = 100.0\nnoise_std = 0.02\n'


class EstimationJob(NamedTuple):
    """Vehicles of one kind that are simulated together."""

    vehicle: str
    seeds: tuple[int, ...]
    kinds: tuple[str, ...]  # of estimators
    backend: str


class SimulatedOutcome(NamedTuple):
    """The evaluation of one simulated vehicle."""

    seed: int
    unmodelled_effect: str
    estimates: tuple[EstimateEvaluation, ...]  # each set of sensors, each estimator
    error: str  # the error that prevented an evaluation, or ""


def with_slip(q: Robots | Cars, draw: np.random.Generator) -> Robots | Cars:
    """Return the vehicle with wheels that slip; a car also has soft tyres."""
    if isinstance(q, Robots):
        return q.with_parameters(
            transmission=q.transmission.with_parameters(grip_n=draw.uniform(0.4, 0.8, 1))
        )
    tyres = {"tyre_n_rad": np.array([[15.0, 22.0]]), "grip_n": np.full((1, 2), 2.2)}
    return q.with_parameters(
        **tyres, transmission=q.transmission.with_parameters(grip_n=draw.uniform(1.2, 2.0, 1))
    )


def with_backlash(q: Robots | Cars, draw: np.random.Generator) -> Robots | Cars:
    """Return the vehicle with gears that have 1 to 5 mm of play."""
    return q.with_parameters(
        transmission=q.transmission.with_parameters(play_m=draw.uniform(0.001, 0.005, 1))
    )


def with_slope(q: Robots | Cars, draw: np.random.Generator) -> Robots | Cars:
    """Return the vehicle on a floor that rises by 2 to 6° in a random direction."""
    rise, direction = np.radians(draw.uniform(2.0, 6.0, 1)), draw.uniform(-np.pi, np.pi, 1)
    return q.with_parameters(slope_rad=rise, slope_heading_rad=direction)


def with_second_lag(q: Robots | Cars, draw: np.random.Generator) -> Robots | Cars:
    """Return the vehicle with motors of the second order."""
    return q.with_parameters(
        transmission=q.transmission.with_parameters(second_lag_s=draw.uniform(0.04, 0.12, 1))
    )


UNMODELLED_EFFECTS = {
    N_("slip"): with_slip,
    N_("backlash"): with_backlash,
    N_("slope"): with_slope,
    N_("second lag"): with_second_lag,
}


def unmodelled_effect(seed: int) -> tuple[str, str]:
    """Return the effect that the model of that seed does not include, and its kind of vehicle."""
    cycle, effect = divmod(seed, len(UNMODELLED_EFFECTS))
    return list(UNMODELLED_EFFECTS)[effect], VEHICLES[cycle % len(VEHICLES)]


def simulate_outcomes(
    seeds: int, kinds: Sequence[str], backend: str, processes: int
) -> list[SimulatedOutcome]:
    """Return the evaluations of vehicles with seeds 0 … `seeds` − 1."""
    jobs = []
    for vehicle in VEHICLES:
        vehicle_seeds = [seed for seed in range(seeds) if unmodelled_effect(seed)[1] == vehicle]
        jobs += [
            EstimationJob(vehicle, tuple(vehicle_seeds[k : k + BATCH_SIZE]), tuple(kinds), backend)
            for k in range(0, len(vehicle_seeds), BATCH_SIZE)
        ]
    return [outcome for batch in run_in_processes(evaluate_job, jobs, processes) for outcome in batch]


def evaluate_job(job: EstimationJob) -> list[SimulatedOutcome]:
    """Return the evaluations of the vehicles of a job."""
    evaluations = []
    for seed, test_subject in zip(job.seeds, make_subjects(job), strict=True):
        estimates, failure = [], ""
        for sensors in SENSOR_SETS:
            try:
                estimates += evaluate(test_subject, sensors, job.kinds, job.backend)
            except BaqueanoError as error:
                failure = f"{test_subject.name}, {sensors}: {error}"
        evaluations.append(SimulatedOutcome(seed, unmodelled_effect(seed)[0], tuple(estimates), failure))
    return evaluations


def rows(outcomes: Sequence[SimulatedOutcome]) -> list[TableRow]:
    """Return the share of vehicles that are not worse: a row per set of sensors, estimator, effect and quantity."""
    share_rows = []
    named_estimates = [
        (outcome.unmodelled_effect, j)
        for outcome in outcomes
        for j in outcome.estimates
        if j.fit != Verdict.REFUSED
    ]
    for sensors, estimator in dict.fromkeys((j.sensors, j.estimator) for _name, j in named_estimates):
        estimator_rows = [
            (name, j) for name, j in named_estimates if (j.sensors, j.estimator) == (sensors, estimator)
        ]
        for name in (*UNMODELLED_EFFECTS, N_("all")):
            cell_outcomes = [j for lack, j in estimator_rows if name in (lack, "all")]
            for quantity in QUANTITIES if cell_outcomes else ():
                ratios = np.array([j.errors[quantity].ratio[0] for j in cell_outcomes])
                share = float(np.mean(ratios <= ALONE))
                share_rows.append({
                    "recording": _("simulated, {name} ({count}), {sensors}", name=_(name), count=len(cell_outcomes),
                                   sensors=sensors),
                    "estimator": estimator, "value": share, "reference": SHARE,
                    "quantity": _("{quantity}, not worse", quantity=_(quantity).partition(" [")[0]),
                    "ok": share >= SHARE if name == "all" else None, "ratio": float(np.median(ratios)),
                })  # fmt: skip
    return share_rows


def vehicle_rows(outcomes: Sequence[SimulatedOutcome]) -> list[TableRow]:
    """Return a row per vehicle, set of sensors, estimator and quantity: both errors and their ratio."""
    rows = []
    for j in (j for outcome in outcomes for j in outcome.estimates):
        for quantity, errors in j.errors.items():
            (value, reference), ratio = errors.rms, errors.ratio[0]
            rows.append({
                "recording": j.recording, "estimator": j.estimator, "quantity": quantity, "value": value,
                "reference": reference, "ok": None if j.fit == Verdict.REFUSED else ratio <= ALONE, "ratio": ratio,
            })  # fmt: skip
    return rows


def count_sentence(outcomes: Sequence[SimulatedOutcome]) -> str:
    """Return a sentence with the numbers of vehicles, refused fits and failures."""
    refusals = sum(j.fit == Verdict.REFUSED for outcome in outcomes for j in outcome.estimates)
    failures = [outcome.error for outcome in outcomes if outcome.error]
    details = f": {'; '.join(failures[:2])}" if failures else ""
    return _(
        "{vehicles} simulated vehicles, {refused} fits refused, {failed} failed{why}.",
        vehicles=len(outcomes),
        refused=refusals,
        failed=len(failures),
        why=details,
    )


def make_subjects(job: EstimationJob) -> list[Subject]:
    """Return the vehicles of a job with both runs; all vehicles are simulated together."""
    vehicles, signals, files = [], [], []
    for seed in job.seeds:
        case_subject = subject(job.vehicle, seed)
        case_subject = case_subject._replace(vehicle_file=_file(case_subject, seed))
        signals += [
            case_subject._replace(seed=run_seed).signal(DURATION_S)
            for run_seed in (seed, seed + TEST_SEED_OFFSET)
        ]
        vehicles += 2 * [
            UNMODELLED_EFFECTS[unmodelled_effect(seed)[0]](
                case_subject.vehicle, np.random.default_rng([seed, 50])
            )
        ]
        files += 2 * [case_subject.vehicle_file]
    seeds = [run_seed for seed in job.seeds for run_seed in (seed, seed + TEST_SEED_OFFSET)]
    runs = drive_runs(vehicles, signals, seeds, files)
    free, subjects = subject(job.vehicle, job.seeds[0]).free, []
    for seed, vehicle_file, first, second in zip(job.seeds, files[::2], runs[::2], runs[1::2], strict=True):
        first = replace(first, truth=None)  # a real fit does not have a truth
        subjects.append(
            Subject(f"{unmodelled_effect(seed)[0]}, {job.vehicle} {seed}", vehicle_file, first, second, free)
        )
    return subjects


def _file(drive: Driven, seed: int) -> Any:
    """Return the subject's file with an odometer; a car with slipping tyres has its full steering range."""
    if "odometer" not in drive.vehicle_file.sensors._fields:
        return parse(drive.vehicle_file.text + ODOMETER, drive.vehicle_file.name)
    if unmodelled_effect(seed)[0] == "slip":
        return drive.vehicle_file.with_values(FULL_LOCK)
    return drive.vehicle_file
