"""Fit vehicles of the independent truth by commands and IMU only, and count how often 95 % intervals cover the truth.

    python -m benchmarks.coverage_without_encoders --seeds 20      (--smallest: a short trial)

One row per case. "holds" is the coverage over all parameters with a true value and an estimate inside its bounds. The
next two columns are error over standard error, rms over the runs, for the median and for the worst parameter. "drawn"
is the largest ratio of mean error to scatter (1/√seeds by chance). "std" is the median standard error relative to the
truth, without parameters that are 0.

    shaken            a car whose IMU vibrates more at higher speed
    shaken, floor     the same on a floor that disturbs it, as in the garage's file
    steady, floor     noise independent of the speed
    ± scales          as "shaken, floor", with random scale errors of the IMU within ± 1 % (gyro), ± 2 %
    robot             two wheels with dead zones, lag and delay, fitted from the gyro; "plain": by the simulation
"""

import argparse
from dataclasses import replace
from typing import Any

import numpy as np

from baqueano.calibration.tolerances import with_tolerance
from baqueano.identify import FitOptions, identify
from baqueano.runs.run import Run
from baqueano.study.counterpart import FREE_ROBOT, car_file, car_values, drive_runs, robot_file, robot_values
from baqueano.study.identification.trials import draw_car, draw_robot, quantised_commands
from baqueano.vehicle_file import load

SECONDS, SMALLEST_S = 60.0, 10.0
REST_S = 3.0  # of a car at the start, to measure the zero of its gyro
DRIVE = ("throttle_gain", "linear_drag", "coulomb_m_s2", "cornering_drag")
YAW = ("steering_gain", "steering_offset_rad", "yaw_lag_s")
FREE = tuple(f"model.{name}" for name in DRIVE + YAW)
LOCK = 0.3  # of full steering: the tyres hardly slip, so that the model nearly fits
AT_REST, BY_SPEED = np.array([0.05, 0.05, 0.02]), np.array([0.6, 1.2, 0.03])  # noise, and its growth per m/s
SCALES = {"sensors.imu.gyro_scale": 0.01, "sensors.imu.accel_scale": 0.02}
EXACT = dict.fromkeys(SCALES, 0.0)
CASES = ("shaken", "shaken, floor", "steady, floor", "± scales", "robot", "robot, plain")


def steps(
    rng: np.random.Generator, low: float, high: float, hold_s: float, rate_hz: float, duration_s: float
) -> np.ndarray:
    """Return a command (N,) of random steps, uniform from `low` to `high`, each `hold_s` long."""
    count = int(np.ceil(duration_s / hold_s))
    return np.repeat(rng.uniform(low, high, count), int(hold_s * rate_hz))[: int(duration_s * rate_hz)]


Made = tuple[Run, Any, dict[str, np.ndarray]]  # a run, its file, and the true values


def of_cars(case: str, seeds: range, duration_s: float) -> list[Made]:
    """Return run, file and true values of a car for each seed; all cars are simulated in one batch."""
    cars = [draw_car(seed, "matched") for seed in seeds]
    if case != "shaken":
        floor = np.asarray(load("car").value("model.process_noise_std"))[None]
        cars = [q.with_parameters(floor=floor) for q in cars]
    if "steady" not in case:
        cars = [q.with_parameters(imu=q.imu.with_parameters(noise=0.0 * q.imu.noise)) for q in cars]
    draws = [np.random.default_rng([seed, 50]) for seed in seeds]
    files = [car_file(q) for q in cars]
    kinds = ((0.1, 0.55, 2.0), (-LOCK, LOCK, 1.2))
    rate_hz = files[0].rate_hz
    inputs = [np.stack([steps(rng, *k, rate_hz, duration_s) for k in kinds], axis=1) for rng in draws]
    for u in inputs:
        u[: round(REST_S * rate_hz)] = 0.0
    out = []
    for (run, file), q, rng in zip(_drive_cars(cars, files, inputs, seeds), cars, draws, strict=True):
        imu, truth = run.sensors["imu"], run.truth
        assert truth is not None
        if case == "± scales":
            imu.z[:] *= 1.0 + rng.uniform(-1.0, 1.0, 3) * [0.02, 0.02, 0.01]
        if "steady" not in case:
            imu.z[:] += (AT_REST + np.outer(np.abs(truth.nu[:, 0]), BY_SPEED)) * rng.normal(size=imu.z.shape)
        out.append((replace(run, sensors={"imu": imu}), file, car_values(q)))
    return out


def of_robots(seeds: range, duration_s: float) -> list[Made]:
    """Return run, file and true values of a robot for each seed; all robots are simulated in one batch."""
    robots = [draw_robot(seed) for seed in seeds]
    files, inputs = [robot_file(q) for q in robots], []
    for seed, file in zip(seeds, files, strict=True):
        rng = np.random.default_rng([seed, 51])
        columns = [steps(rng, -limit, limit, 1.0, file.rate_hz, duration_s) for limit in file.command.limit]
        inputs.append(quantised_commands(np.stack(columns, axis=1)))
    pairs = zip(_drive_cars(robots, files, inputs, seeds), robots, strict=True)
    return [(run, file, robot_values(q)) for (run, file), q in pairs]


def _drive_cars(
    vehicles: list[Any], files: list[Any], inputs: list[np.ndarray], seeds: range
) -> list[tuple[Run, Any]]:
    return list(zip(drive_runs(vehicles, inputs, seeds, files), files, strict=True))


def fit_case(case: str, run: Run, file: Any) -> Any:
    """Return the fit of a run with the options of the case."""
    if "plain" in case:
        return identify(run, file, FREE_ROBOT, use=("imu",), options=FitOptions(gyro_leads=False))
    file = with_tolerance(file, SCALES if case == "± scales" else EXACT)
    free = None if "robot" in case else FREE
    return identify(run, file, free, use=("imu",), options=FitOptions(gyro_leads=True))


def covered(case: str, seeds: range, duration_s: float) -> str:
    """Return the row of the table for a case, as text."""
    errors, sds, truths = [], [], []
    runs_of_case = of_robots(seeds, duration_s) if "robot" in case else of_cars(case, seeds, duration_s)
    for run, file, exact in runs_of_case:
        fit = fit_case(case, run, file)
        truth = np.array([float(exact[name][0]) if name in exact else np.nan for name in fit.names])
        is_inside = np.isfinite(fit.std) & (fit.bound == 0) & np.isfinite(truth)
        errors.append(np.where(is_inside, fit.estimate - truth, np.nan))
        sds.append(np.where(is_inside, fit.std, np.nan))
        truths.append(truth)
    finite = np.isfinite(errors).sum(axis=0) > 1
    e, std, truth = (np.array(x)[:, finite] for x in (errors, sds, truths))
    holds = float(np.nanmean(np.where(np.isnan(e), np.nan, np.abs(e) <= 1.96 * std)))
    z = np.sqrt(np.nanmean((e / std) ** 2, axis=0))
    bias_ratio = np.nanmax(np.abs(np.nanmean(e, axis=0)) / np.nanstd(e, axis=0))
    nonzero = np.all(truth != 0.0, axis=0)
    part = np.median(np.nanmedian(std[:, nonzero] / np.abs(truth[:, nonzero]), axis=0))
    figures = f"{np.median(z):8.2f} {z.max():8.2f} {bias_ratio:8.2f} {part:8.2%}"
    return f"{case:20} {holds:8.1%} {figures} {np.isfinite(e).sum():6d}"


def main() -> None:
    """Print the table, one row per case."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--case", choices=CASES)
    parser.add_argument(
        "--smallest", action="store_true", help="two short drives of a few cases: that it runs"
    )
    options = parser.parse_args()
    count, duration_s = (2, SMALLEST_S) if options.smallest else (options.seeds, SECONDS)
    cases = CASES[::4] if options.smallest else CASES
    heads = ("holds", "error/std", "largest", "drawn", "std")
    print(f"{'vehicle':20} " + " ".join(f"{head:>8}" for head in heads) + "  count")
    for case in cases:
        if options.case in (None, case):
            print(covered(case, range(options.first, options.first + count), duration_s), flush=True)


if __name__ == "__main__":
    main()
