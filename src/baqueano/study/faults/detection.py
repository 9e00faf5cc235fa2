"""`baqueano study faults`: count the verdicts of fits on damaged and on undamaged recordings.

The runs are simulated by the independent truth (subject.py), then damaged. In a fit all parameters are free that a
user would free. A parameter is wrong if its error is more than 5 standard errors and 5 % of its true value. The table
shows for each fault: fits, wrong fits called USABLE, undamaged runs that were REFUSED, and the counts of the
verdicts. For a damage that a fit can repair, the fit is compared with the fit of the same run before the damage:
    over_clean = median over runs of |error damaged| / median over runs of |error clean|                  (1)

The unit of errors is the standard error of the clean fit, all parameters together. (1) has two parts: the lost samples,
and the errors in the remaining ones. The second part is measured by
    over_left = median over runs of |error damaged| / median over runs of |error left|                    (2)

"left" is the undamaged run without the readings that the fit of the damaged run excludes (undamaged.py).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from baqueano.contracts.values import JsonObject, TableRow
from baqueano.diagnostics import Verdict
from baqueano.errors import BaqueanoError
from baqueano.identify import FitOptions, identify
from baqueano.identify.result.fit_result import Fit
from baqueano.messages.language import mark as N_, number, translate as _
from baqueano.messages.text_table import text_table
from baqueano.runs.run import Run
from baqueano.study.faults.damage import DAMAGES, outliers
from baqueano.study.faults.logging import LOGGING
from baqueano.study.faults.structures import STRUCTURES, FaultPlan
from baqueano.study.faults.subject import VEHICLES, FaultSubject, subject
from baqueano.study.faults.undamaged import undamaged_run
from baqueano.study.wrong_estimates import wrong_mask
from baqueano.sweep.workers import run_in_processes
from baqueano.vehicle_file import VehicleFile

RATIO_KEYS = ("error_ratio_clean", "error_ratio_reduced")
DRIVE_S = 30.0
FAULT_BATCH = 16  # faults of a vehicle and seed that share their simulations
SOUND_DATA = (
    N_("clean"), N_("clean, 10 % outliers"), N_("clean, multisine"), N_("clean, 60 s"), N_("clean, other start"),
)  # fmt: skip
REPAIRS = (
    N_("repeated time"), N_("time jumps a day"), N_("time jumps seconds"), N_("repeated samples"), N_("stuck"),
    N_("frames as zero"), N_("not numbers"), N_("clipped"), N_("bursts"), N_("clock goes back"),
)  # fmt: skip
RUN_FAULTS = {**DAMAGES, **LOGGING}
FAULTS = (*SOUND_DATA, *RUN_FAULTS, *STRUCTURES)


class FaultJob(NamedTuple):
    """A fault, and the vehicle and seed of the fit with this fault."""

    fault: str
    vehicle: str
    seed: int
    backend: str


class FaultOutcome(NamedTuple):
    """The verdict of the fit of a job, and the errors of its parameters."""

    job: FaultJob
    verdict: str  # ERROR: the fit did not start, and the message gave the reason; CRASH: the program failed
    is_wrong: bool
    error_rms: float  # root mean square of the errors, in standard errors of the clean fit; NaN: not compared
    undamaged_error_rms: float
    reasons: tuple[str, ...]  # codes
    reduced_error_rms: float = np.nan  # error of the clean run without the readings that the damaged run lost
    lost_share: float = np.nan  # the lost part of the readings


class FaultInputs(NamedTuple):
    """The inputs of one fit, and the true parameters."""

    vehicle_file: VehicleFile
    run: Run
    free: tuple[str, ...]
    truth: dict[str, float]
    undamaged_run: Run | None = None  # the run before the damage, if both are compared


def run_fault_jobs(jobs: tuple[FaultJob, ...]) -> list[FaultOutcome]:
    """Return the outcomes of faults on one vehicle and seed."""
    fault_subject = subject(jobs[0].vehicle, jobs[0].seed)
    job_inputs, backend = _inputs(fault_subject, jobs), jobs[0].backend
    fits = (_fit(x, x.undamaged_run, backend) for _, x in job_inputs if x.undamaged_run)
    fit = next(fits, None)  # the same run for all jobs
    return [_outcome(job, inputs, fit) for job, inputs in job_inputs]


def _outcome(job: FaultJob, inputs: FaultInputs, reference: Fit | None) -> FaultOutcome:
    try:
        fit = identify(inputs.run, inputs.vehicle_file, inputs.free, options=FitOptions(backend=job.backend))
    except BaqueanoError as error:
        return FaultOutcome(
            job,
            "ERROR",
            is_wrong=False,
            error_rms=np.nan,
            undamaged_error_rms=np.nan,
            reasons=(error.diagnostic.code,),
        )
    except (ArithmeticError, ValueError, LookupError) as error:  # a fault of the program
        return FaultOutcome(
            job,
            "CRASH",
            is_wrong=False,
            error_rms=np.nan,
            undamaged_error_rms=np.nan,
            reasons=(f"{type(error).__name__}: {error}",),
        )
    is_wrong = bool(np.any(wrong_mask(fit.estimate, fit.std, _true_values(fit, inputs.truth))))
    outcome = FaultOutcome(
        job, fit.verdict, is_wrong, np.nan, np.nan, tuple(reason.code for reason in fit.reasons)
    )
    if inputs.undamaged_run is None or reference is None:
        return outcome
    outcome = outcome._replace(
        error_rms=_error_rms(fit, reference, inputs.truth),
        undamaged_error_rms=_error_rms(reference, reference, inputs.truth),
    )
    reduced_run = undamaged_run(inputs.undamaged_run, inputs.run, inputs.vehicle_file)
    if reduced_run is None:
        return outcome
    repaired_fit = _fit(inputs, reduced_run[0], job.backend)
    return outcome._replace(
        reduced_error_rms=_error_rms(repaired_fit, reference, inputs.truth), lost_share=reduced_run[1]
    )


def _fit(inputs: FaultInputs, run: Run, backend: str) -> Fit:
    options = FitOptions(diagnose=False, backend=backend)
    return identify(run, inputs.vehicle_file, inputs.free, options=options)


def _true_values(fit: Fit, truth: dict[str, float]) -> np.ndarray:
    return np.array([truth.get(name, np.nan) for name in fit.names])


def _error_rms(fit: Fit, reference: Fit, truth: dict[str, float]) -> float:
    z = (fit.estimate - _true_values(fit, truth)) / reference.std
    z = z[np.isfinite(z)]
    return float(np.sqrt(np.mean(np.minimum(z**2, 1e6)))) if len(z) else np.nan


def _inputs(subject: FaultSubject, jobs: Sequence[FaultJob]) -> list[tuple[FaultJob, FaultInputs]]:
    """Return the inputs of each job; the vehicles of all structures are simulated together."""
    u = subject.signal(DRIVE_S)
    (undamaged_drive,) = subject.runs([subject.vehicle], [u], [u])
    job_inputs, plans, multisine = [], [], subject.signal(DRIVE_S, "multisine")
    for job in jobs:
        rng = np.random.default_rng([job.seed, *job.fault.encode()])
        if job.fault in STRUCTURES:
            plans.append((job, STRUCTURES[job.fault](subject, u, undamaged_drive, rng), u))
        elif job.fault == "clean, multisine":
            plans.append((job, FaultPlan(subject.vehicle, multisine, subject.vehicle_file), multisine))
        elif job.fault in SOUND_DATA:
            job_inputs.append((job, _undamaged_inputs(subject, job, undamaged_drive, rng)))
        else:
            damaged_run = RUN_FAULTS[job.fault](undamaged_drive, subject.vehicle_file, rng)
            undamaged_run = undamaged_drive if job.fault in REPAIRS else None
            truth = {k: x for k, x in subject.truth.items() if (job.fault, k) not in UNCOMPARED_PARAMETERS}
            inputs = FaultInputs(subject.vehicle_file, damaged_run, subject.free, truth, undamaged_run)
            job_inputs.append((job, inputs))
    return job_inputs + _planned_inputs(subject, plans)


def _undamaged_inputs(
    subject: FaultSubject, job: FaultJob, undamaged_drive: Run, rng: np.random.Generator
) -> FaultInputs:
    vehicle_file, run = subject.vehicle_file, undamaged_drive
    if job.fault == "clean, 60 s":
        u = subject.signal(2.0 * DRIVE_S)
        (run,) = subject.runs([subject.vehicle], [u], [u])
    elif job.fault == "clean, 10 % outliers":
        run = outliers(undamaged_drive, vehicle_file, rng)
    elif job.fault == "clean, other start":
        vehicle_file = _with_other_friction(vehicle_file, rng)
    return FaultInputs(vehicle_file, run, subject.free, subject.truth)


def _planned_inputs(
    subject: FaultSubject, plans: list[tuple[FaultJob, FaultPlan, np.ndarray]]
) -> list[tuple[FaultJob, FaultInputs]]:
    if not plans:
        return []
    first_drives = [(plan.vehicle, plan.effective_commands, u) for _, plan, u in plans]
    second = [
        (plan.second_vehicle, plan.effective_commands, u) for _, plan, u in plans if plan.second_vehicle
    ]
    runs = subject.runs(*zip(*first_drives, *second, strict=True))
    second_runs, plan_inputs = iter(runs[len(plans) :]), []
    for (job, plan, _u), run in zip(plans, runs, strict=False):
        second_run = next(second_runs) if plan.second_vehicle else run
        run = plan.change(run, second_run) if plan.change else run
        free = tuple(p for p in subject.free if p.removeprefix("+") not in plan.excluded_parameters)
        truth = subject._replace(vehicle=plan.vehicle).truth
        plan_inputs.append((job, FaultInputs(plan.vehicle_file, run, free, truth)))
    return plan_inputs


def _with_other_friction(vehicle_file: VehicleFile, rng: np.random.Generator) -> VehicleFile:
    """Return the file with its linear friction or drag multiplied by a random factor of 1/2 to 2."""
    if len(vehicle_file.command.limit) == 3:
        linear = vehicle_file.vehicle.friction.linear * 2.0 ** rng.uniform(-1.0, 1.0, 3)
        return vehicle_file.with_values({"model.friction.linear": linear.tolist()})
    return vehicle_file.with_values(
        {"model.linear_drag": vehicle_file.vehicle.linear_drag * 2.0 ** rng.uniform(-1.0, 1.0)}
    )


@dataclass(frozen=True)
class Faults:
    """The outcomes of all fits."""

    outcomes: tuple[FaultOutcome, ...]
    fit_count: int  # fits of the call
    ended_count: int  # fits that ended

    def rows(self) -> list[TableRow]:
        """Return a row per fault, the undamaged runs first."""
        return [self._row(fault) for fault in dict.fromkeys(FAULTS) if self._fault_outcomes(fault)]

    def _fault_outcomes(self, fault: str) -> list[FaultOutcome]:
        return [o for o in self.outcomes if o.job.fault == fault]

    def _row(self, fault: str) -> JsonObject:
        own_outcomes = self._fault_outcomes(fault)
        is_undamaged = fault in SOUND_DATA
        losses = [o.lost_share for o in own_outcomes if np.isfinite(o.lost_share)]
        return {
            "fault": fault,
            "fits": len(own_outcomes),
            "wrongly_usable": sum(o.verdict == Verdict.USABLE and o.is_wrong for o in own_outcomes),
            "wrongly_refused": sum(
                is_undamaged and o.verdict in (Verdict.REFUSED, "ERROR") for o in own_outcomes
            ),
            "wrong": sum(o.is_wrong for o in own_outcomes),
            "usable": sum(o.verdict == Verdict.USABLE for o in own_outcomes),
            "warn": sum(o.verdict == Verdict.WARN for o in own_outcomes),
            "refused": sum(o.verdict in (Verdict.REFUSED, "ERROR") for o in own_outcomes),
            "crashes": sum(o.verdict == "CRASH" for o in own_outcomes),
            "error_ratio_clean": _ratio([(o.error_rms, o.undamaged_error_rms) for o in own_outcomes]),
            "loss_share": float(np.median(losses)) if losses else None,
            "error_ratio_reduced": _ratio([(o.error_rms, o.reduced_error_rms) for o in own_outcomes]),
        }

    @property
    def reasons(self) -> tuple[str, ...]:
        """Return a sentence for each reason why the verdict is not USABLE."""
        rows = self.rows()
        wrongly_usable = (r | {"fault": _(r["fault"])} for r in rows if r["wrongly_usable"])
        reasons = [
            _("{wrongly_usable} wrong fits with {fault} were called USABLE", **r) for r in wrongly_usable
        ]
        reasons += [
            _("{crashed} fits with {fault} crashed", crashed=r["crashes"], fault=_(r["fault"]))
            for r in rows
            if r["crashes"]
        ]
        undamaged_fits = sum(r["fits"] for r in rows if r["fault"] in SOUND_DATA)
        refusals = sum(r["wrongly_refused"] for r in rows)
        if refusals > 0.02 * undamaged_fits:
            figures = {"refused": refusals, "sound": undamaged_fits}
            reasons.append(
                _("{refused} of {sound} runs without faults were refused, more than 2 %", **figures)
            )
        if not undamaged_fits:
            reasons.append(_("no run without faults was fitted"))
        return tuple(reasons)

    @property
    def verdict(self) -> Verdict:
        """Return USABLE if undamaged runs were fitted and at most 2 % of them are REFUSED. Also, a fit must not
        crash, and a wrong fit must not be USABLE. Otherwise return REFUSED.
        """
        return Verdict.REFUSED if self.reasons else Verdict.USABLE

    def table(self) -> str:
        """Return the counts and error ratios of each fault as a text table."""
        head = [
            _("fault"), _("fits"), _("wrong"), _("called usable"), _("clean refused"), _("usable/warn/refused"),
            _("error/clean"), _("lost"), _("err/reduced"),
        ]  # fmt: skip
        rows = []
        for r in self.rows():
            ratio_texts = ["" if r[key] is None else f"{number(r[key]):.2f}" for key in RATIO_KEYS]
            loss = "" if r["loss_share"] is None else f"{number(100 * r['loss_share']):.0f} %"
            verdicts = (
                f"{r['usable']}/{r['warn']}/{r['refused']}"
                + " "
                + _("{crashed} crashed", crashed=r["crashes"]) * bool(r["crashes"])
            )
            counts = [str(r[key]) for key in ("fits", "wrong", "wrongly_usable", "wrongly_refused")]
            rows.append([_(r["fault"]), *counts, verdicts, ratio_texts[0], loss, ratio_texts[1]])
        lines = text_table("<>>>><>>>", head, *rows)
        undamaged_fits = [o for o in self.outcomes if o.job.fault in SOUND_DATA]
        warning_count = sum(o.verdict == Verdict.WARN for o in undamaged_fits)
        figures = {"warned": warning_count, "sound": len(undamaged_fits)}
        lines += ["", _("{warned} of {sound} runs without faults have a warning", **figures)]
        if self.ended_count < self.fit_count:
            figures = {"tried": self.ended_count, "count": self.fit_count}
            lines.append(_("interrupted: {tried} of {count} fits", **figures))
        return "\n".join([*lines, _("verdict: {verdict}", verdict=_(self.verdict)), *self.reasons])


def _ratio(pairs: list[tuple[float, float]]) -> float | None:
    """Return the ratio of the two medians over the finite pairs; None if all pairs contain NaN.  (1), (2)"""
    finite_pairs = [pair for pair in pairs if np.isfinite(pair).all()]
    return float(np.divide(*np.median(finite_pairs, axis=0))) if finite_pairs else None


def faults(
    seeds: int = 20,
    first: int = 0,
    *,
    vehicles: Sequence[str] = VEHICLES,
    names: Sequence[str] | None = None,
    processes: int = 1,
    backend: str = "auto",
    advance: Callable[[int], None] | None = None,
) -> Faults:
    """Return the outcomes of `seeds` fits of each fault, from seed `first` on, with one vehicle after the other."""
    jobs: dict[tuple[str, int], list[FaultJob]] = {}
    for fault in names or FAULTS:
        fault_vehicles = [v for v in vehicles if v != "car" or fault not in ROBOT_FAULTS]
        for s in range(seeds if fault_vehicles else 0):
            name = fault_vehicles[s % len(fault_vehicles)]
            jobs.setdefault((name, first + s), []).append(FaultJob(fault, name, first + s, backend))
    batches = [
        tuple(group[k : k + FAULT_BATCH])
        for _, group in sorted(jobs.items())
        for k in range(0, len(group), FAULT_BATCH)
    ]
    report = advance or (lambda n: None)
    finished_batches = run_in_processes(run_fault_jobs, batches, processes, lambda n: report(n * FAULT_BATCH))
    outcomes = tuple(o for batch in finished_batches for o in batch)
    fit_count = sum(map(len, batches))
    return Faults(outcomes, fit_count, min(fit_count, sum(map(len, batches[: len(finished_batches)]))))


# a run shows only the sum of both, and a note reports it
UNCOMPARED_PARAMETERS = {("late sensors", "model.drivetrain.delay_s")}
ROBOT_FAULTS = ("motors swapped", "motor inverted", "caster flips", "centre of mass", "tilted floor")
