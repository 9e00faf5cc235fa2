"""Robots and cars of the independent truth, with physics that the model lacks, fitted and judged like recordings.

    slip            a robot: one wheel slips for 5 s; a car: tyres that slip and saturate, at full lock
    backlash        no force for 50 to 200 ms after a change of sign
    slope           a robot on a floor that rises by 2 to 6°
    second lag      motors of the second order: a low-pass of 40 to 120 ms comes before the lag

Each vehicle is fitted to 40 s of random steps, all free that a user would free, and judged on 40 s of other ones.
An odometer reads with 0.02 m/s. Not worse: a ratio of at most ALONE. A fit that is refused is not written, and its
vehicle not judged.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from baqueano.errors import BaqueanoError
from baqueano.runs.run import Run
from baqueano.simulate.open_loop import times
from baqueano.study.counterpart import car_file, driven, recorded
from baqueano.study.estimation.errors import QUANTITIES
from baqueano.study.estimation.judging import Judged, judged
from baqueano.study.estimation.subjects import SETUPS, Subject
from baqueano.study.faults.structures import Plan, Structure, backlash, slipping, tilted_floor
from baqueano.study.faults.subject import Subject as Driven
from baqueano.study.faults.subject import subject
from baqueano.study.identification.trials import car
from baqueano.study.workers import spread_over
from baqueano.vehicle_file import parse

SECONDS = 40.0
SHARE, ALONE = 0.95, 1.10
TOGETHER = 8  # vehicles that are simulated side by side
OTHER = 10_000  # added to a seed, for the signal and the noise of the run that is judged
FULL_LOCK = {"command.limit": [0.6, 0.8]}
ODOMETER = '\n[sensors.odometer]\nkind = "odometer"\nrate_hz = 100.0\nnoise_std = 0.02\n'


class Job(NamedTuple):
    """Vehicles of one kind that are simulated side by side."""

    vehicle: str
    seeds: tuple[int, ...]
    kinds: tuple[str, ...]  # of estimators
    backend: str


class Outcome(NamedTuple):
    """One vehicle."""

    seed: int
    lacking: str
    judged: tuple[Judged, ...]  # each set of sensors, each estimator
    failed: str  # why there is nothing to judge


def second_lag(of: Driven, u: np.ndarray, sound: Run, rng: np.random.Generator) -> Plan:
    """Commands behind a low-pass of 40 to 120 ms."""
    keep, felt = np.exp(-1.0 / (rng.uniform(0.04, 0.12) * of.file.rate_hz)), u.copy()
    for k in range(1, len(u)):
        felt[k] = keep * felt[k - 1] + (1.0 - keep) * u[k]
    return Plan(of.vehicle, felt, of.file)


def tyres(of: Driven, u: np.ndarray, sound: Run, rng: np.random.Generator) -> Plan:
    """Tyres that slip."""
    return Plan(car(of.seed % OTHER, "understeer"), u, of.file)


LACKING: dict[str, dict[str, Structure]] = {
    "slip": {"robot": slipping, "car": tyres},
    "backlash": {"robot": backlash, "car": backlash},
    "slope": {"robot": tilted_floor},
    "second lag": {"robot": second_lag, "car": second_lag},
}


def lacking(seed: int) -> tuple[str, str]:
    """Return what the model of that seed lacks, and its vehicle."""
    name = list(LACKING)[seed % len(LACKING)]
    vehicles = list(LACKING[name])
    return name, vehicles[seed // len(LACKING) % len(vehicles)]


def simulated(
    seeds: int, kinds: Sequence[str], backend: str, processes: int, each: Callable[[int], None] | None = None
) -> list[Outcome]:
    """Return the outcomes of vehicles at seeds from 0 on."""
    jobs = []
    for vehicle in ("robot", "car"):
        some = [seed for seed in range(seeds) if lacking(seed)[1] == vehicle]
        jobs += [
            Job(vehicle, tuple(some[k : k + TOGETHER]), tuple(kinds), backend)
            for k in range(0, len(some), TOGETHER)
        ]
    return [one for done in spread_over(work, jobs, processes, each) for one in done]


def work(job: Job) -> list[Outcome]:
    """Return the outcomes of a job."""
    out = []
    for seed, one in zip(job.seeds, _subjects(job), strict=True):
        found, failed = [], ""
        for sensors in SETUPS:
            try:
                found += judged(one, sensors, job.kinds, job.backend)
            except BaqueanoError as error:
                failed = f"{one.name}, {sensors}: {error}"
        out.append(Outcome(seed, lacking(seed)[0], tuple(found), failed))
    return out


def rows(outcomes: Sequence[Outcome]) -> list[dict[str, Any]]:
    """Return the share that is not worse, by lack and over all: a row per set of sensors, estimator and quantity."""
    out = []
    all_judged = [(one.lacking, j) for one in outcomes for j in one.judged if j.fit != "REFUSED"]
    for sensors, estimator in dict.fromkeys((j.sensors, j.estimator) for _, j in all_judged):
        mine = [(name, j) for name, j in all_judged if (j.sensors, j.estimator) == (sensors, estimator)]
        for name in (*LACKING, "all"):
            some = [j for lack, j in mine if name in (lack, "all")]
            for quantity in QUANTITIES if some else ():
                ratios = np.array([j.errors[quantity].ratio[0] for j in some])
                share = float(np.mean(ratios <= ALONE))
                out.append({
                    "recording": f"simulated, {name} ({len(some)}), {sensors}", "estimator": estimator,
                    "quantity": f"{quantity.partition(' [')[0]}, not worse", "value": share, "reference": SHARE,
                    "ok": share >= SHARE if name == "all" else None, "ratio": float(np.median(ratios)),
                })  # fmt: skip
    return out


def sentence(outcomes: Sequence[Outcome]) -> str:
    """Return how many there were, and what was not judged."""
    refused = sum(j.fit == "REFUSED" for one in outcomes for j in one.judged)
    failed = [one.failed for one in outcomes if one.failed]
    why = f": {'; '.join(failed[:2])}" if failed else ""
    return f"{len(outcomes)} simulated vehicles, {refused} fits refused, {len(failed)} failed{why}."


def _subjects(job: Job) -> list[Subject]:
    """Return the vehicles with both runs, all simulated side by side."""
    plans, logged, seeds = [], [], []
    for seed in job.seeds:
        for one in (seed, seed + OTHER):
            of = subject(job.vehicle, seed)._replace(seed=one)
            of = of._replace(file=_file(of, seed))
            u = of.signal(SECONDS)
            nothing = Run("nothing", None, np.zeros(0, np.int64), np.zeros((0, u.shape[1])))
            plan = LACKING[lacking(seed)[0]][job.vehicle](of, u, nothing, np.random.default_rng([seed, 50]))
            assert plan is not None
            plans.append(plan)
            logged.append(u)
            seeds.append(one)
    group = plans[0].vehicle.joined([plan.vehicle for plan in plans[1:]])
    t_ns = times(len(logged[0]), plans[0].file.rate_hz)
    shown = driven(group, np.stack([plan.felt for plan in plans], axis=1), seeds, t_ns)
    runs = []
    for k, plan in enumerate(plans):
        run = recorded(shown, k, logged[k], plan.file, f"seed {seeds[k]}", seeds[k])
        run = run if plan.change is None else plan.change(run, run)
        # who fits on a floor knows no truth
        runs.append(replace(run, truth=None) if seeds[k] < OTHER else run)
    free = subject(job.vehicle, job.seeds[0]).free
    out = []
    for k, seed in enumerate(job.seeds):
        name, file, (first, other) = lacking(seed)[0], plans[2 * k].file, runs[2 * k : 2 * k + 2]
        out.append(Subject(f"{name}, {job.vehicle} {seed}", file, first, other, free))
    return out


def _file(of: Driven, seed: int) -> Any:
    """The file of the subject with an odometer; a car whose tyres slip may steer to the end."""
    if "odometer" not in of.file.sensors._fields:
        return parse(of.file.text + ODOMETER, of.file.name)
    return car_file(car(seed, "understeer")).with_values(FULL_LOCK) if lacking(seed)[0] == "slip" else of.file
