"""Simulated vehicles fitted by commands and IMU alone: whether the intervals of 95 % hold the truth.

    python -m benchmarks.coverage_without_encoders --seeds 20   (--smallest: that it runs)

One row per vehicle: the share of intervals that hold, over all parameters that were seen inside their bounds; the
error over the one told, root mean square over the runs, of the middle parameter and of the worst; the
largest mean error over its scatter, of which 1/√seeds is chance; the median of the error told, in parts of the
truth, over the parameters that are not 0.

    shaken          a car whose IMU is shaken the more, the faster it drives
    shaken, floor   the same on a floor that pushes it, as the garage's file tells
    steady, floor   the garage's car: noise that does not know of the speed
    ± scales        as "shaken, floor", of an IMU whose scales are off by chance within ± 1 % (gyro), ± 2 %
"""

import argparse
from dataclasses import replace
from typing import Any

import numpy as np

from baqueano.identify import identify, random_steps
from baqueano.identify.without_encoders import without_encoders
from baqueano.runs.run import Run
from baqueano.simulate import simulate
from baqueano.vehicle_file import load

SECONDS, SMALLEST_S = 60.0, 15.0
DRIVE = ("throttle_gain", "linear_drag", "coulomb_m_s2", "cornering_drag")
YAW = ("steering_gain", "steering_offset_rad", "yaw_lag_s")
FREE = tuple(f"model.{name}" for name in DRIVE + YAW)
QUIET = {"sensors.imu.accel_noise_std": [0.0, 0.0], "sensors.imu.gyro_noise_std": 0.0}
STILL = {"model.process_noise_std": [0.0, 0.0, 0.0]}
AT_REST, BY_SPEED = np.array([0.05, 0.05, 0.02]), np.array([0.6, 1.2, 0.03])  # noise, and its growth per m/s
SCALES = {"gyro": 0.01, "accel": 0.02}
EXACT = {"gyro": 0.0, "accel": 0.0}
CASES = ("shaken", "shaken, floor", "steady, floor", "± scales", "small", "small, plain", "case-study-1",
         "case-study-1, plain")  # fmt: skip


def steps(
    rng: np.random.Generator, low: float, high: float, hold_s: float, rate_hz: float, duration_s: float
) -> np.ndarray:
    """A command (N,) that jumps every `hold_s`."""
    count = int(np.ceil(duration_s / hold_s))
    return np.repeat(rng.uniform(low, high, count), int(hold_s * rate_hz))[: int(duration_s * rate_hz)]


def car(case: str, seed: int, duration_s: float) -> tuple[Run, Any]:
    """A run of the garage's car, and its file."""
    file, rng = load("car").with_values({"model.quadratic_drag": 0.0}), np.random.default_rng(seed)
    forward, turning = (0.1, 0.55, 2.0), (-0.8, 0.8, 1.2)
    u = np.stack([steps(rng, *one, file.rate_hz, duration_s) for one in (forward, turning)], axis=1)
    changes = ({} if "steady" in case else QUIET) | (STILL if case == "shaken" else {})
    if case == "± scales":
        changes |= {
            "sensors.imu.gyro_scale": float(file.sensors.imu.gyro_scale) * (1.0 + rng.uniform(-0.01, 0.01)),
            "sensors.imu.accel_scale": (file.sensors.imu.accel_scale * (1.0 + rng.uniform(-0.02, 0.02, 2))).tolist(),
        }  # fmt: skip
    run = simulate(file.with_values(changes), u, seed)
    if "steady" not in case:
        channel = run.sensors["imu"]
        v = np.abs(np.interp(channel.t_ns, run.truth.t_ns, run.truth.nu[:, 0]))
        shaken = (AT_REST + np.outer(v, BY_SPEED)) * rng.normal(size=channel.z.shape)
        run = replace(run, sensors={"imu": channel._replace(z=channel.z + shaken)})
    return run, file


def fitted(case: str, seed: int, duration_s: float) -> tuple[Any, Any]:
    """The fit of a run, and the file of what drove it."""
    name = case.partition(",")[0]
    if name not in ("small", "case-study-1"):
        run, file = car(case, seed, duration_s)
        return without_encoders(run, file, FREE, tolerance=SCALES if case == "± scales" else EXACT), file
    file = load(name)
    run = simulate(file, random_steps(file.command.limit, duration_s, file.rate_hz, seed), seed)
    if "plain" in case:
        return identify(run, file, use=("imu",), led=False), file
    return without_encoders(run, file, tolerance=EXACT), file


def covered(case: str, seeds: range, duration_s: float) -> str:
    """One row of the table."""
    errors, told, truth = [], [], np.zeros(0)
    for seed in seeds:
        fit, file = fitted(case, seed, duration_s)
        truth = np.array([np.ravel(file.value(path))[0] for path in fit.names])
        inside = np.isfinite(fit.sd) & (fit.bound == 0)
        errors.append(np.where(inside, fit.estimate - truth, np.nan))
        told.append(np.where(inside, fit.sd, np.nan))
    seen = np.isfinite(errors).sum(axis=0) > 1
    e, sd = np.array(errors)[:, seen], np.array(told)[:, seen]
    holds = float(np.nanmean(np.where(np.isnan(e), np.nan, np.abs(e) <= 1.96 * sd)))
    z = np.sqrt(np.nanmean((e / sd) ** 2, axis=0))
    drawn = np.nanmax(np.abs(np.nanmean(e, axis=0)) / np.nanstd(e, axis=0))
    known = truth[seen] != 0.0
    part = np.median(np.nanmedian(sd, axis=0)[known] / np.abs(truth[seen][known]))
    figures = f"{np.median(z):8.2f} {z.max():8.2f} {drawn:8.2f} {part:8.2%}"
    return f"{case:20} {holds:8.1%} {figures} {np.isfinite(e).sum():6d}"


def main() -> None:
    """Prints the table."""
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    asked.add_argument("--seeds", type=int, default=10)
    asked.add_argument("--first", type=int, default=0)
    asked.add_argument("--case", choices=CASES)
    asked.add_argument(
        "--smallest", action="store_true", help="two short drives of a few cases: that it runs"
    )
    told = asked.parse_args()
    count, duration_s = (2, SMALLEST_S) if told.smallest else (told.seeds, SECONDS)
    cases = CASES[::3] if told.smallest else CASES
    heads = ("holds", "error/sd", "largest", "drawn", "sd")
    print(f"{'vehicle':20} " + " ".join(f"{head:>8}" for head in heads) + "  count")
    for case in cases:
        if told.case in (None, case):
            print(covered(case, range(told.first, told.first + count), duration_s), flush=True)


if __name__ == "__main__":
    main()
