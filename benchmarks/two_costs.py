"""Simulation error against innovations on simulated vehicles: whose estimates are nearer, whose intervals hold.

    python -m benchmarks.two_costs --seeds 20   (--smallest: that it runs)

One row per vehicle and floor: the share of 95 % intervals that hold the truth, by either cost, over all parameters
that were seen inside their bounds; the error of the innovations over that of the simulation, the geometric mean
over the parameters; the median of the time that the second search adds.
"""

import argparse
import time
from dataclasses import replace
from typing import Any

import numpy as np

from baqueano.identify import identify, random_steps
from baqueano.runs.run import Run
from baqueano.simulate import simulate
from baqueano.vehicle_file import load

SECONDS, SMALLEST_S = 60.0, 15.0
FLOOR = "model.process_noise_std"
OUTLIERS, SIZE = 0.1, 20.0  # share, and standard deviations
PUSH, LASTS_S = 0.03, 0.5  # of a coloured floor: acceleration [m/s², rad/s²], and its time constant
CASES = (
    ("case-study-1", "still"),
    ("case-study-1", "white"),
    ("case-study-1", "white, outliers"),
    ("case-study-1", "coloured"),
    ("small", "white"),
    ("small", "white, outliers"),
    ("car", "white"),
    ("car", "white, outliers"),
)


def driven(name: str, floor: str, seed: int, duration_s: float) -> tuple[Run, Any]:
    """A run, and the file of the vehicle that drove it."""
    file = load(name)
    if name == "case-study-1" and "white" in floor:
        file = file.with_values({FLOOR: [0.03, 0.01, 0.03]})
    u = random_steps(file.command.limit, duration_s, file.rate_hz, seed)
    if floor == "coloured":
        wide = replace(file, command=file.command._replace(limit=np.full(u.shape[1], np.inf)))
        run = replace(simulate(wide, u + push(file, len(u), seed), seed), applied=u)
    else:
        run = simulate(file, u, seed)
    if "outliers" in floor:
        for key, channel in run.sensors.items():
            rng = np.random.default_rng([seed, len(key)])
            hit = rng.choice(
                [-SIZE, 0.0, SIZE], channel.z.shape, p=[OUTLIERS / 2, 1 - OUTLIERS, OUTLIERS / 2]
            )
            channel.z[:] += hit * np.sqrt(np.diagonal(getattr(file.sensors, key).cov))
    return run, file


def push(file: Any, ticks: int, seed: int) -> np.ndarray:
    """Commands (N, 3) that push a vehicle of three forces as a coloured floor does."""
    rng, a = np.random.default_rng([seed, 99]), np.exp(-1.0 / (file.rate_hz * LASTS_S))
    acceleration = np.zeros((ticks, 3))
    acceleration[0] = rng.standard_normal(3)
    for k in range(1, ticks):
        acceleration[k] = a * acceleration[k - 1] + np.sqrt(1.0 - a * a) * rng.standard_normal(3)
    m = file.vehicle
    inertia = np.array([m.mass_kg, m.mass_kg, m.inertia_kg_m2])
    return PUSH * acceleration * inertia / np.diagonal(m.actuator_matrix)


def compared(name: str, floor: str, seeds: range, duration_s: float) -> str:
    """One row of the table."""
    z, errors, took = [], [], []
    for seed in seeds:
        run, file = driven(name, floor, seed, duration_s)
        begin = time.perf_counter()
        first = identify(run, file, doubts=False)
        middle = time.perf_counter()
        second = identify(run, file, doubts=False, cost="innovations")
        took.append(time.perf_counter() - middle - (middle - begin))
        truth = np.array([file.value(path) for path in first.names])
        p = len(truth)
        inside = np.isfinite(first.sd) & (first.bound == 0) & (second.bound[:p] == 0)
        error = np.array([first.estimate - truth, second.estimate[:p] - truth])
        errors.append(np.where(inside, error, np.nan))
        z.append(errors[-1] / np.array([first.sd, second.sd[:p]]))
    hold = [np.nanmean(np.where(np.isnan(one), np.nan, np.abs(one) < 1.96)) for one in np.swapaxes(z, 0, 1)]
    with np.errstate(invalid="ignore", divide="ignore"):
        known = np.isfinite(errors).any(axis=(0, 1))
        rmse = np.sqrt(np.nanmean(np.square(np.array(errors)[:, :, known]), axis=0))
    ratio = np.exp(np.mean(np.log(rmse[1] / rmse[0])))
    count = int(np.isfinite(np.array(z)[:, 1]).sum())
    return (
        f"{name:13} {floor:16} {hold[0]:8.1%} {hold[1]:8.1%} {ratio:8.2f} {count:6d} {np.median(took):7.2f} s"
    )


def main() -> None:
    """Prints the table."""
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    asked.add_argument("--seeds", type=int, default=10)
    asked.add_argument("--first", type=int, default=0)
    asked.add_argument("--vehicle", choices=sorted({name for name, _ in CASES}))
    asked.add_argument(
        "--smallest", action="store_true", help="two short drives of a few cases: that it runs"
    )
    told = asked.parse_args()
    count, duration_s = (2, SMALLEST_S) if told.smallest else (told.seeds, SECONDS)
    cases = CASES[::3] if told.smallest else CASES
    print(f"{'vehicle':13} {'floor':16} {'simul.':>8} {'innov.':>8} {'error':>8} {'count':>6} {'added':>9}")
    for name, floor in cases:
        if told.vehicle in (None, name):
            print(compared(name, floor, range(told.first, told.first + count), duration_s), flush=True)


if __name__ == "__main__":
    main()
