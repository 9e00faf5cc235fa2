"""How near to the limit a fit comes: case study I at many seeds, against the Cramér-Rao bound.

    F = Σ_t ∂h_tᵀ Q⁻¹ ∂h_t   at the true parameters,     b_i = √(F⁻¹)_ii                                  (1)
    rmse_i / bound_i = √(mean (p̂_i − p_i)²) / √(mean b_i²)      both means over the same seeds            (2)

h is what the IMU shows of the true motion, Q its true noise, ∂h the exact sensitivities of a simulation that
shares no kernel with the fit. Vehicle, excitation and duration are those of `study paper`. The bound holds
the 12 observable parameters together (cross-talk, forces, friction: each is a nuisance to the others) and
nothing else: the fit begins at rest and the IMU has no bias, as in the paper, and σ, which the fit has to
find, costs nothing in (1) on normal noise. What is known without the data, friction ≥ 0, is not in (1).

Each seed is fitted three times:
    clean     from half of the truth
    outliers  with one sample in ten, each channel for itself, off by 20 σ with a random sign
    wrong     from every parameter times 0.2 to 5 (evenly in the logarithm), the sign of a force drawn by lot;
              an entry of T that is 0 in truth, which no factor moves, begins at ± (0.2 to 5) times a tenth
              of the largest force, or torque, of the vehicle
A wrong start counts as converged if every parameter ends within a tenth of a standard error of where the
clean fit ended; else the fit must be REFUSED, or it is silent.

Huber's estimate by itself is 1/√0.95 = 1.026 bounds from the truth; with 10 % outliers far out, theory says
1.20 of the clean error. (2) scatters by 1/√(2 N) over N seeds: 2.2 % of 1,000.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from baqueano.identify import identify
from baqueano.identify.solve.intervals import QUANTILE_95
from baqueano.runs import Run
from baqueano.simulate.system import System, varied
from baqueano.study.paper import FREE, START, names, recorded
from baqueano.study.workers import spread_over
from baqueano.symbolic import scan
from baqueano.vehicle_file import VehicleFile, load
from baqueano.worlds.noise import stream

SEEDS = 1_000
OUTLIERS, FAR = 0.1, 20.0  # part of the samples, and how many σ they are off
WRONG = 5.0  # the factor by which a start is off, at most, up or down
CROSS = 0.1  # of the largest force: the size of an entry of T that is 0 in truth, for its start
SAME = 0.1  # standard errors within which two searches ended at the same place
MOST_RMSE, MOST_OUTLIERS, LEAST_CONVERGED = 1.1, 1.3, 0.99
POOLED, EACH = (0.93, 0.97), (0.90, 0.99)  # part of the 95 % intervals that must hold the truth
SURE = 3.0  # standard errors; they widen the limits where the seeds are few
FITS = ("clean", "outliers", "wrong")
POOL = "pooled"


class Ended(NamedTuple):
    """What of a fit is kept."""

    estimate: np.ndarray  # (p,) in the order of PATHS
    sd: np.ndarray  # (p,)
    refused: bool


class Trial(NamedTuple):
    """One seed."""

    seed: int
    bound: np.ndarray  # (p,) b of (1)
    clean: Ended
    outliers: Ended
    wrong: Ended


def observable() -> Iterator[tuple[str, str]]:
    """(the paper's name, path) of the parameters that a vehicle without sideways actuator can show."""
    for name, path, _ in names():
        if not path.endswith(",1]"):
            yield name, path


NAMES, PATHS = zip(*observable(), strict=True)


@dataclass(frozen=True)
class Identification:
    """Trials of case study I, in the order of their seeds; fewer than were asked for if it was interrupted."""

    trials: tuple[Trial, ...]
    asked: int
    truth: np.ndarray  # (p,) in the order of NAMES

    def errors(self, fit: str) -> np.ndarray:
        """(N, p) estimate − truth of the fits of that name: one of FITS."""
        return np.stack([getattr(trial, fit).estimate for trial in self.trials]) - self.truth

    def z(self) -> np.ndarray:
        """(N, p) errors of the clean fits in their own standard errors."""
        return self.errors("clean") / np.stack([trial.clean.sd for trial in self.trials])

    @property
    def bound(self) -> np.ndarray:
        """(p,) root of the mean of b² over the seeds."""
        return np.sqrt(np.mean([trial.bound**2 for trial in self.trials], axis=0))

    def rmse(self, fit: str) -> np.ndarray:
        """(p,) root mean square of the errors of the fits of that name."""
        return np.sqrt(np.mean(self.errors(fit) ** 2, axis=0))

    @property
    def inside(self) -> np.ndarray:
        """(N, p) bool: the 95 % interval holds the truth."""
        return np.abs(self.z()) <= QUANTILE_95

    @property
    def met(self) -> np.ndarray:
        """(N,) bool: the wrong start ended where the right one did."""
        return np.array([_same(trial.wrong, trial.clean) for trial in self.trials])

    @property
    def silent(self) -> int:
        """Wrong starts that ended elsewhere and were not refused."""
        refused = np.array([trial.wrong.refused for trial in self.trials])
        return int(np.sum(~self.met & ~refused))

    @property
    def sign_errors(self) -> int:
        """Estimates with the wrong sign, of parameters that are not 0, in all fits that were not refused."""
        wrong = [
            np.sign(end.estimate) * np.sign(self.truth) < 0.0
            for trial in self.trials
            for end in (trial.clean, trial.outliers, trial.wrong)
            if not end.refused
        ]
        return int(np.sum(wrong))

    def rows(self) -> list[dict[str, Any]]:
        """name, rmse_over_bound, coverage, outlier_ratio, converged: one row per parameter, one for all of
        them. converged is pooled: the part of the wrong starts that found the end, all parameters at once."""
        over, outlier = self.rmse("clean") / self.bound, self.rmse("outliers") / self.rmse("clean")
        inside, converged = self.inside.mean(axis=0), float(np.mean(self.met))
        figures = [
            *zip(NAMES, over, inside, outlier, strict=True),
            (POOL, _root_mean(over), inside.mean(), _root_mean(over * outlier) / _root_mean(over)),
        ]
        keys = ("name", "rmse_over_bound", "coverage", "outlier_ratio")
        return [
            dict(zip(keys, (name, *map(float, row)), strict=True)) | {"converged": converged}
            for name, *row in figures
        ]

    @property
    def reasons(self) -> tuple[str, ...]:
        """What keeps the verdict from being USABLE."""
        out: list[str] = []
        for row in self.rows():
            count = len(self.trials) * (len(NAMES) if row["name"] == POOL else 1)
            low, high = POOLED if row["name"] == POOL else EACH
            few = SURE * np.sqrt(0.95 * 0.05 / count)  # so few seeds scatter by as much: no fault of the fits
            low, high = min(low, 0.95 - few), max(high, 0.95 + few)
            if row["rmse_over_bound"] > max(MOST_RMSE, 1.0 + SURE / np.sqrt(2.0 * count)):
                out.append(f"{row['name']}: rmse {row['rmse_over_bound']:.3f} bounds")
            if not low <= row["coverage"] <= high:
                out.append(f"{row['name']}: {100 * row['coverage']:.1f} % of the intervals hold the truth")
            if row["outlier_ratio"] > max(MOST_OUTLIERS, 1.0 + SURE / np.sqrt(count)):
                out.append(f"{row['name']}: outliers make the error {row['outlier_ratio']:.2f} times larger")
        if self.sign_errors:
            out.append(f"{self.sign_errors} estimates have the wrong sign")
        if self.silent > (1.0 - LEAST_CONVERGED) * len(self.trials):
            out.append(f"{self.silent} wrong starts ended elsewhere and did not say so")
        return tuple(out)

    @property
    def verdict(self) -> str:
        """WARN where a figure is missed, else USABLE."""
        return "WARN" if self.reasons else "USABLE"

    def table(self) -> str:
        """For people."""
        n = len(self.trials)
        head = f"{'':8}{'rmse / bound':>14}{'coverage':>11}{'with outliers':>15}"
        lines = [f"Case study I, {_seeds(n)}" + (f" of {self.asked}" if n < self.asked else ""), head]
        lines.append("-" * len(head))
        for row in self.rows():
            lines.append(
                f"{row['name']:8}{row['rmse_over_bound']:14.3f}{100 * row['coverage']:9.1f} %"
                f"{row['outlier_ratio']:13.3f} ×"
            )
        met = int(np.sum(self.met))
        lines += [
            "",
            f"wrong starts: {met} of {n} converged, {n - met - self.silent} said that they did not, "
            f"{self.silent} were silent",
            f"wrong signs: {self.sign_errors}",
            f"rmse / bound scatters by ± {100 / np.sqrt(2 * n):.1f} % over so many seeds",
        ]
        return "\n".join([*lines, f"{self.verdict}: {'; '.join(self.reasons) or 'at the limit'}"])


def identification(
    seeds: int = SEEDS,
    first: int = 0,
    backend: str = "auto",
    processes: int = 1,
    each: Callable[[int], None] | None = None,
) -> Identification:
    """Trials at `seeds` seeds from `first` on, over so many `processes`; `each` is called with the number of
    seeds that have just been done. Ctrl-C ends it with what is done by then, if that is one seed or more.

    More than one process begins Python anew, as `multiprocessing` does: call it from under
    `if __name__ == "__main__":`.
    """
    jobs = [(seed, backend) for seed in range(first, first + seeds)]
    done = spread_over(_trial_of, jobs, processes, each)
    if not done:
        raise KeyboardInterrupt
    return Identification(tuple(sorted(done, key=lambda one: one.seed)), seeds, truth()[0])


def trial(seed: int, backend: str = "auto") -> Trial:
    """One seed: bound and three fits."""
    vehicle, run = recorded(seed, backend)
    return Trial(
        seed,
        cramer_rao(run, backend),
        _ended(run, vehicle, START, backend),
        _ended(spoilt(run, seed), vehicle, START, backend),
        _ended(run, vehicle, wrong_start(seed), backend),
    )


def _trial_of(job: tuple[int, str]) -> Trial:
    return trial(*job)


def cramer_rao(run: Run, backend: str = "auto") -> np.ndarray:
    """b (p,) of this run: no unbiased estimate has a smaller standard deviation.  (1)"""
    _, slopes = _simulation(backend).sensitivities(run.applied, truth()[1])
    seen = [k for k, (_, path, _) in enumerate(names()) if path in PATHS]
    G = (slopes[:, :, seen] / _noise()[:, None]).reshape(-1, len(PATHS))
    size = np.sqrt(np.sum(G * G, axis=0))
    R = np.linalg.qr(G / size, mode="r")
    return np.linalg.norm(np.linalg.solve(R, np.eye(len(R))), axis=1) / size  # (GᵀG)⁻¹ = R⁻¹ R⁻ᵀ


@cache
def _simulation(backend: str) -> Any:
    """θ (15,) in the order of FREE and the command → what the IMU shows without noise (3,)."""
    vehicle = load_once()
    system, still, dt_s = System(vehicle.vehicle, None), np.zeros(3), 1.0 / vehicle.rate_hz

    def step(theta: np.ndarray, state: Any, u: np.ndarray) -> tuple[Any, np.ndarray]:
        state, motion = varied(system, FREE, theta).model.step(state, u, dt_s, still)
        return state, vehicle.sensors.imu.h(motion)

    return scan(step, vehicle.vehicle.init(), np.zeros(3), np.zeros(15), backend=backend)


def spoilt(run: Run, seed: int) -> Run:
    """The run with outliers in all channels."""
    rng, imu = stream(seed, "outliers"), run.sensors["imu"]
    hit = rng.random(imu.z.shape) < OUTLIERS
    z = imu.z + hit * rng.choice([-FAR, FAR], imu.z.shape) * _noise()
    return replace(run, sensors={**run.sensors, "imu": imu._replace(z=z)})


def wrong_start(seed: int) -> dict[str, float]:
    """Path → where the search begins."""
    rng, limit = stream(seed, "wrong start"), load_once().command.limit
    known, every = truth()
    T, size = every[6:].reshape(3, 3), dict(zip(PATHS, known, strict=True))
    force, torque = T[0, 0] * limit[0], T[2, 2] * limit[2]
    for i, most in enumerate((force, force, torque)):
        for j in (0, 2):
            path = f"{FREE[2]}[{i},{j}]"
            size[path] = rng.choice([-1.0, 1.0]) * (T[i, j] or CROSS * most / limit[j])
    return {path: float(value * WRONG ** rng.uniform(-1.0, 1.0)) for path, value in size.items()}


def _ended(run: Run, vehicle: VehicleFile, start: Mapping[str, Any], backend: str) -> Ended:
    fit = identify(
        run, vehicle, FREE, start=start, biases=False, at_rest=True, doubts=False, backend=backend
    )  # the model is the vehicle's own: there is nothing to ask for that it lacks
    at = [fit.names.index(path) for path in PATHS]
    return Ended(fit.estimate[at], fit.sd[at], fit.verdict == "REFUSED")


def _same(one: Ended, other: Ended) -> bool:
    return bool(np.all(np.abs(one.estimate - other.estimate) < SAME * other.sd))


@cache
def load_once() -> VehicleFile:
    """The vehicle of case study I."""
    return load("case-study-1")


@cache
def truth() -> tuple[np.ndarray, np.ndarray]:
    """The parameters (12,) in the order of PATHS, and all (15,) in that of FREE."""
    every = {path: float(load_once().value(path)) for _, path, _ in names()}
    return np.array([every[path] for path in PATHS]), np.array(list(every.values()))


def _noise() -> np.ndarray:
    """(3,) standard deviations."""
    return np.sqrt(np.diagonal(load_once().sensors.imu.cov))


def _root_mean(x: np.ndarray) -> float:
    return float(np.sqrt(np.mean(x**2)))


def _seeds(n: int) -> str:
    return f"{n:,} seed{'s' * (n != 1)}"
