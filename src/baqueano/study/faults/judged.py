"""`baqueano study faults`: what a fit says of recordings that are damaged, and of sound ones.

wrong: a parameter off by more than 5 of its own standard errors and 5 % of what it truly is. Shown fault by
fault: fits, wrong ones that were called USABLE, sound ones that were REFUSED, and how the verdicts fell. A
damage that can be mended is held against the fit of the same run before it was damaged:

    over_clean = median over runs of |error damaged| / median over runs of |error clean|                  (1)

errors in standard errors of the clean fit, all parameters together. A part of (1) is the price of samples that are
gone, another the harm that is left in the others. The second alone is

    over_left = median over runs of |error damaged| / median over runs of |error left|                    (2)

left: the run before it was damaged, without the very readings that the fit of the damaged one leaves out (left.py).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from baqueano.errors import BaqueanoError
from baqueano.identify import excitation, identify
from baqueano.identify.answer.result import Fit
from baqueano.runs.run import Run
from baqueano.simulate import simulate
from baqueano.study.faults.damage import DAMAGES, outliers
from baqueano.study.faults.left import left_of
from baqueano.study.faults.structures import STRUCTURES
from baqueano.study.workers import spread_over
from baqueano.vehicle_file import VehicleFile, load

VEHICLES = ("case-study-1", "small", "car")
SECONDS = 30.0
ERRORS, PART = 5.0, 0.05  # standard errors and part of itself that a wrong parameter is off
SOUND = ("sound", "sound, 10 % outliers", "sound, multisine", "sound, 60 s", "sound, other start")
MENDED = ("repeated time", "time jumps a day", "time jumps seconds", "held samples", "stuck", "frames as zero",
          "not numbers", "clipped", "bursts", "clock goes back")  # fmt: skip
FAULTS = (*SOUND, *DAMAGES, *STRUCTURES)


class Job(NamedTuple):
    """One fault on one vehicle at one seed."""

    fault: str
    vehicle: str
    seed: int
    backend: str


class Outcome(NamedTuple):
    """What came of it."""

    job: Job
    verdict: str  # ERROR: the fit was not begun, and the message said why
    wrong: bool
    off: float  # root mean square of the errors, in standard errors of the clean fit; NaN: not compared
    clean: float
    reasons: tuple[str, ...]
    left: float = np.nan  # that of the clean run without what was left out of the damaged one
    lost: float = np.nan  # the part of the readings that this is


def work(job: Job) -> Outcome | None:
    """One fit; None where the vehicle has nothing that this fault acts on."""
    file = _vehicle(job.vehicle)
    rng = np.random.default_rng([job.seed, *job.fault.encode()])
    made = _made(job, file, rng)
    if made is None:
        return None
    fitted, run, truth, clean = made
    try:
        fit = identify(run, fitted, backend=job.backend)
    except BaqueanoError as error:
        return Outcome(job, "ERROR", False, np.nan, np.nan, (str(error),))
    outcome = Outcome(job, fit.verdict, bool(np.any(wrong(fit, truth))), np.nan, np.nan, fit.reasons)
    if clean is None:
        return outcome
    before = _before(job, fitted, clean)
    outcome = outcome._replace(off=_rms(fit, before, truth), clean=_rms(before, before, truth))
    same = left_of(clean, run, fitted)
    if same is None:
        return outcome
    left = identify(same[0], fitted, doubts=False, backend=job.backend)
    return outcome._replace(left=_rms(left, before, truth), lost=same[1])


_clean: dict[tuple[str, int], Fit] = {}


def _before(job: Job, file: VehicleFile, run: Run) -> Fit:
    """The fit of a run before it was damaged: one for all damages of a vehicle and seed."""
    key = job.vehicle, job.seed
    if key not in _clean:
        _clean.clear()  # jobs come seed by seed
        _clean[key] = identify(run, file, doubts=False, backend=job.backend)
    return _clean[key]


@lru_cache
def _vehicle(name: str) -> VehicleFile:
    """The same object each time: kernels of its simulation are kept with it."""
    return load(name)


def wrong(fit: Fit, truth: VehicleFile) -> np.ndarray:
    """(p,) which of the parameters are wrong."""
    true = np.array([_true(truth, name) for name in fit.names])
    off = np.abs(fit.estimate - true)
    sd = np.where(np.isfinite(fit.sd), fit.sd, 0.0)
    return np.isfinite(off) & (off > ERRORS * sd) & (off > PART * np.abs(true))


@lru_cache(maxsize=1000)
def _true(truth: VehicleFile, name: str) -> float:
    return float(truth.value(name))


def _rms(fit: Fit, clean: Fit, truth: VehicleFile) -> float:
    true = np.array([_true(truth, name) for name in fit.names])
    z = (fit.estimate - true) / clean.sd
    z = z[np.isfinite(z)]
    return float(np.sqrt(np.mean(np.minimum(z**2, 1e6)))) if len(z) else np.nan


def _made(
    job: Job, file: VehicleFile, rng: np.random.Generator
) -> tuple[VehicleFile, Run, VehicleFile, Run | None] | None:
    """The file that is fitted, the run, the truth, and the run before it was damaged, where both are compared."""
    if job.fault in STRUCTURES:
        made = STRUCTURES[job.fault](file, _signal(file, job.seed, SECONDS), job.seed, rng)
        return None if made is None else (*made, None)
    seconds = 60.0 if job.fault == "sound, 60 s" else SECONDS
    kind = "multisine" if job.fault == "sound, multisine" else "random_steps"
    run = simulate(file, _signal(file, job.seed, seconds, kind), job.seed, backend=job.backend)
    if job.fault == "sound, 10 % outliers":
        return file, outliers(run, file, rng), file, None
    if job.fault == "sound, other start":
        return _other_start(file, rng), run, file, None
    if job.fault in SOUND:
        return file, run, file, None
    damaged = DAMAGES[job.fault](run, file, rng)
    return None if damaged is None else (file, damaged, file, run if job.fault in MENDED else None)


def _signal(file: VehicleFile, seed: int, seconds: float, kind: str = "random_steps") -> np.ndarray:
    return excitation(kind, file.command.limit, seconds, file.rate_hz, seed, rest_s=1.0)


def _other_start(file: VehicleFile, rng: np.random.Generator) -> VehicleFile:
    """A file whose friction and drag were guessed, by up to twice or half."""
    if len(file.command.limit) == 3:
        linear = file.vehicle.friction.linear * 2.0 ** rng.uniform(-1.0, 1.0, 3)
        return file.with_values({"model.friction.linear": linear.tolist()})
    return file.with_values({"model.linear_drag": file.vehicle.linear_drag * 2.0 ** rng.uniform(-1.0, 1.0)})


@dataclass(frozen=True)
class Faults:
    """All outcomes."""

    outcomes: tuple[Outcome, ...]
    asked: int  # fits that were asked for
    tried: int  # and those that were come to

    def rows(self) -> list[dict[str, Any]]:
        """A row per fault, the sound ones first."""
        return [self._row(fault) for fault in dict.fromkeys(FAULTS) if self._of(fault)]

    def _of(self, fault: str) -> list[Outcome]:
        return [o for o in self.outcomes if o.job.fault == fault]

    def _row(self, fault: str) -> dict[str, Any]:
        mine = self._of(fault)
        sound = fault in SOUND
        lost = [o.lost for o in mine if np.isfinite(o.lost)]
        return {
            "fault": fault,
            "fits": len(mine),
            "wrongly_usable": sum(o.verdict == "USABLE" and o.wrong for o in mine),
            "wrongly_refused": sum(sound and o.verdict in ("REFUSED", "ERROR") for o in mine),
            "wrong": sum(o.wrong for o in mine),
            "usable": sum(o.verdict == "USABLE" for o in mine),
            "warn": sum(o.verdict == "WARN" for o in mine),
            "refused": sum(o.verdict in ("REFUSED", "ERROR") for o in mine),
            "over_clean": _ratio([(o.off, o.clean) for o in mine]),
            "lost": float(np.median(lost)) if lost else None,
            "over_left": _ratio([(o.off, o.left) for o in mine]),
        }

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why the verdict is not USABLE."""
        rows = self.rows()
        out = [
            f"{r['wrongly_usable']} wrong fits with {r['fault']} were called USABLE"
            for r in rows
            if r["wrongly_usable"]
        ]
        sound = sum(r["fits"] for r in rows if r["fault"] in SOUND)
        refused = sum(r["wrongly_refused"] for r in rows)
        if refused > 0.02 * sound:
            out.append(f"{refused} of {sound} sound runs were refused, more than 2 %")
        if not sound:
            out.append("no sound run was fitted")
        return tuple(out)

    @property
    def verdict(self) -> str:
        """USABLE where no wrong fit was called so and at most 2 % of the sound ones were refused."""
        return "REFUSED" if self.reasons else "USABLE"

    def table(self) -> str:
        """For people."""
        head = (
            f"{'fault':<22}{'fits':>5}{'wrong':>7}{'called usable':>15}{'sound refused':>15}   "
            f"{'usable/warn/refused':<20}{'error/clean':>12}{'lost':>8}{'error/left':>12}"
        )
        lines = [head, "-" * len(head)]
        for r in self.rows():
            over = ["" if r[key] is None else f"{r[key]:.2f}" for key in ("over_clean", "over_left")]
            lost = "" if r["lost"] is None else f"{100 * r['lost']:.0f} %"
            verdicts = f"{r['usable']}/{r['warn']}/{r['refused']}"
            lines.append(
                f"{r['fault']:<22}{r['fits']:>5}{r['wrong']:>7}{r['wrongly_usable']:>15}{r['wrongly_refused']:>15}   "
                f"{verdicts:<20}{over[0]:>12}{lost:>8}{over[1]:>12}"
            )
        sound = [o for o in self.outcomes if o.job.fault in SOUND]
        warned = sum(o.verdict == "WARN" for o in sound)
        lines += ["", f"{warned} of {len(sound)} sound runs with a warning"]
        if self.tried < self.asked:
            lines.append(f"interrupted: {self.tried} of {self.asked} fits")
        return "\n".join([*lines, f"verdict: {self.verdict}", *self.reasons])


def _ratio(pairs: list[tuple[float, float]]) -> float | None:
    """Of the medians of both, over the pairs that are known.  (1), (2)"""
    known = [pair for pair in pairs if np.isfinite(pair).all()]
    return float(np.divide(*np.median(known, axis=0))) if known else None


def faults(
    seeds: int = 20,
    first: int = 0,
    *,
    vehicles: Sequence[str] = VEHICLES,
    only: Sequence[str] | None = None,
    processes: int = 1,
    backend: str = "auto",
    each: Callable[[int], None] | None = None,
) -> Faults:
    """`seeds` fits of each fault, in turn on each of the vehicles, from seed `first` on."""
    jobs = []
    for fault in only or FAULTS:
        some = [v for v in vehicles if v != "car" or fault not in NOT_FOR_CARS]
        jobs += [Job(fault, some[s % len(some)], first + s, backend) for s in range(seeds)]
    # Fits of one vehicle stand together, its kernels are warm; of them those of one seed, for the clean fit.
    jobs.sort(key=lambda job: (job.vehicle, job.seed))
    done = spread_over(work, jobs, processes, each)
    return Faults(tuple(o for o in done if o is not None), len(jobs), len(done))


NOT_FOR_CARS = ("motors swapped", "motor inverted", "caster flips", "centre of mass", "slope")
