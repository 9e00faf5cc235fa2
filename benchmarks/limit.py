"""Check filters on drives of the model that they assume: their consistency, and their distance to the Cramér-Rao bound.

    python -m benchmarks.limit --plot limit.svg      (--smallest: a short trial)

Two models of matched.py are used: in one, biases and scales are known, as `ekf` assumes; in the other they are drawn as
`augmented_ekf` assumes. A row per filter has NEES of pose and velocity and NIS, as means of the whole drive, then NEES
of single states. Each is divided by its dimension, so that it is 1 for a correct filter. The share of ticks at which
the mean of all drives is in its 99 % band is in brackets. The last figure is the error of the speed over the bound, rms
from SETTLED_S on.
"""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from baqueano.estimators import AugmentedEkf, Ekf
from baqueano.geometry import wrap
from baqueano.sensors import Imu, Odometer
from baqueano.signals import Slot, Tick, sensor_slots
from baqueano.symbolic import scan
from baqueano.vehicles import Friction, Planar
from benchmarks import matched

VEHICLE = Planar(
    mass_kg=float(matched.M[0]),
    inertia_kg_m2=matched.I,
    actuator_matrix=np.diag([matched.PUSH, 0.0, matched.TWIST]),
    friction=Friction(linear=np.array([matched.ALONG, matched.ACROSS, matched.SPIN])),
)
IMU = Imu(
    accel_noise_std=np.array([0.05, 0.05]), gyro_noise_std=0.005, accel_bias_walk=2e-4, gyro_bias_walk=1e-5
)
EXACT = replace(
    IMU, accel_bias_std=np.zeros(2), gyro_bias_std=0.0, accel_bias_walk=0.0, gyro_bias_walk=0.0, gyro_scale_std=0.0
)  # fmt: skip
ODOMETER = Odometer(noise_std=0.02, slip_std=0.0)
READING = np.array([*IMU.accel_noise_std, IMU.gyro_noise_std, ODOMETER.noise_std])
IMU_ALONE, BOTH = ("imu",), ("imu", "odometer")
ACCELEROMETERS = ("imu[0]", "imu[1]")
SETTLED_S, HOLD = 1.0, 50  # ticks of a command
TOGETHER = 100  # drives that are compared at once
BAND = 2.576  # 99 %
LEAST_SD = 1e-5  # for variances that must be above 0 in the paper's filter


class Case(NamedTuple):
    """A filter and its assumptions."""

    name: str
    block: Any
    assumed_noise: matched.AssumedNoise


class Accuracy(NamedTuple):
    """The accuracy of one case: normalised errors over time, their bands, and the error of the speed."""

    name: str
    t_s: np.ndarray  # (N,)
    ratios: dict[str, np.ndarray]  # (N,) NEES and NIS over their dimensions, mean of all drives
    width: dict[str, float]  # half of the band
    speed: tuple[float, float]  # rms [m/s], and divided by the bound


def cases() -> list[Case]:
    """Return both filters with the assumptions of `ekf`, then the recommended filter with errors of the sensors."""
    case_list = [Case(f"ekf, {' + '.join(use)}", *_white(use)) for use in (IMU_ALONE, BOTH)]
    exact, errors = (
        (EXACT, replace(ODOMETER, scale_std=0.0), "sensors exact"),
        (IMU, ODOMETER, "with bias, scale"),
    )
    for imu, odometer, limit_of in (exact, errors):
        for use, trusted_sensors in (
            (IMU_ALONE, ()),
            (IMU_ALONE, ACCELEROMETERS),
            (BOTH, ()),
            (BOTH, ACCELEROMETERS),
        ):
            sensors = sensor_slots(use)(*(imu, odometer)[: len(use)])
            block = AugmentedEkf(
                VEHICLE, sensors, use=use, speed_from=trusted_sensors, course_std=0.0, sideslip_error_std=0.0
            )
            name = f"augmented_ekf, {' + '.join(use)}{', speed_from accel.' if trusted_sensors else ''}, {limit_of}"
            case_list.append(Case(name, block, assumed_by(block, imu)))
    return case_list


def simulated(
    assumed_noise: matched.AssumedNoise, drives: int, seconds: float, seed: int = 0
) -> matched.Drives:
    """Return simulated drives under random commands, each constant for HOLD ticks."""
    n, rng = round(seconds / matched.DT), np.random.default_rng([seed, 1])
    blocks = -(-n // HOLD)
    levels = np.stack(
        [rng.uniform(0.3, 0.9, blocks), np.zeros(blocks), rng.uniform(-0.5, 0.5, blocks)], axis=1
    )
    return matched.drive_matched(assumed_noise, np.repeat(levels, HOLD, axis=0)[:n], drives, seed)


def accuracy(case: Case, simulated_drives: matched.Drives) -> Accuracy:
    """Return the accuracy of the filter on the drives, compared with the truth and the bound."""
    n, drives = simulated_drives.x.shape[:2]
    bound = matched.bound(case.assumed_noise, simulated_drives, 2 + 1 + (case.block.use == BOTH))
    kernel, sums, squares, settled_row = kernel_of(case.block), {}, 0.0, round(SETTLED_S / matched.DT)
    for first in range(0, drives, TOGETHER):
        rows = slice(first, first + TOGETHER)
        truth = np.swapaxes(simulated_drives.x[:, rows], 0, 1)
        each_run = [
            kernel.run(make_ticks(simulated_drives, first + k, case.block.use))[1] for k in range(len(truth))
        ]
        eta, nu, cov, y, S = (np.stack(outputs) for outputs in zip(*each_run, strict=True))
        pose_error, e = (
            eta - truth[..., matched.POSE],
            nu - truth[..., matched.NU] * (1.0 + truth[..., [8, 8, 9]]),
        )
        pose_error[..., 2] = wrap(pose_error[..., 2])
        errors = {
            "NEES of the pose": (_square(cov[..., :3, :3], pose_error), 3),
            "NEES of the velocity": (_square(cov[..., 3:, 3:], e), 3),
            "NIS": (_square(S, y), y.shape[-1]),
            "NEES of ψ": (pose_error[..., 2] ** 2 / cov[..., 2, 2], 1),
            **{
                f"NEES of {name}": (e[..., i] ** 2 / cov[..., 3 + i, 3 + i], 1)
                for i, name in enumerate(("ν_x", "ν_y", "ν_ψ"))
            },
        }
        for name, (square, size) in errors.items():
            before = sums.get(name, (0.0, size))[0]
            sums[name] = (before + np.sum(square, axis=0) / (size * drives), size)
        squares += np.sum(np.mean(e[:, settled_row:, 0] ** 2, axis=1)) / drives
    width = {name: BAND * np.sqrt(2.0 / (drives * size)) for name, (_, size) in sums.items()}
    rms = np.sqrt(squares), np.sqrt(np.mean(bound[settled_row:, 0]))
    t_s = matched.DT * np.arange(1, n + 1)
    return Accuracy(case.name, t_s, {name: series for name, (series, _) in sums.items()}, width, rms)


def main() -> None:
    """Print a row per case; draw the curves if requested."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.limit", description=__doc__)
    parser.add_argument("--drives", type=int, default=500)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--plot", type=Path, help="a file for the curves, .svg or .png")
    parser.add_argument("--smallest", action="store_true", help="a size that shows in seconds that it runs")
    args = parser.parse_args()
    drives, seconds = (4, 2.0) if args.smallest else (args.drives, args.seconds)
    print(
        f"{drives} drives of {seconds:g} s of the matched model; 1 is right, in brackets the share of ticks in band"
    )
    results, assumed_noise, simulated_drives = [], None, None
    for case in cases():
        if (
            assumed_noise is None
            or simulated_drives is None
            or not all(map(np.array_equal, assumed_noise, case.assumed_noise))
        ):
            assumed_noise, simulated_drives = (
                case.assumed_noise,
                simulated(case.assumed_noise, drives, seconds),
            )
        result = accuracy(case, simulated_drives)
        results.append(result)
        words = [
            f"{name} {np.mean(x):.2f} ({np.mean(np.abs(x - 1.0) < result.width[name]):.0%})"
            for name, x in result.ratios.items()
        ]
        speed_error, min_error = result.speed
        words.append(f"speed {1e3 * speed_error:.2f} mm/s = {speed_error / min_error:.2f} × the bound")
        print(f"{result.name:74}  {', '.join(words)}", flush=True)
    if args.plot:
        _drawing(results).savefig(args.plot)


def assumed_by(block: AugmentedEkf, imu: Imu) -> matched.AssumedNoise:
    """Return the noise that the recommended filter assumes."""
    start = np.sqrt(np.diag(block.init().cov))[matched.OF_FILTER]
    walk = np.array([*imu.accel_bias_walk * np.ones(2), imu.gyro_bias_walk])
    return matched.AssumedNoise(
        start, block.velocity_walk_std, block.disturbance_std, block.disturbance_fade_s, walk, READING
    )


def _white(use: tuple[str, ...]) -> tuple[Ekf, matched.AssumedNoise]:
    """Return the filter with the paper's state, and its assumed noise.

    R assumes that in a tick ν changes by half of the change of d, and that ν̇ = f(ν) + d.
    """
    walk, d, fade_s = np.array([0.03, 0.01, 0.1]), np.array([0.3, 3.0]), 0.5
    A = -np.diag([matched.ALONG / matched.M[0], matched.ACROSS / matched.M[1], matched.SPIN / matched.I])
    fresh = np.diag([d[0], 0.0, d[1]]) * np.sqrt(1.0 - np.exp(-2.0 * matched.DT / fade_s))
    lasts = np.sqrt((np.exp(2.0 * matched.DT * np.diag(A)) - 1.0) / (2.0 * np.diag(A)))  # √∫ exp(2 A s) ds
    of_nu = np.hstack([np.diag(walk * lasts), 0.5 * matched.DT * fresh])
    B = np.vstack([of_nu, A @ of_nu + np.hstack([np.zeros((3, 3)), fresh])])
    R = B @ B.T + LEAST_SD**2 * np.diag([0.0, 0.0, 0.0, 1.0, 1.0, 1.0])
    sensors = sensor_slots(use)(*(EXACT, replace(ODOMETER, scale_std=0.0))[: len(use)])
    pose, nu = np.full(3, 1e-3), np.full(3, LEAST_SD)
    block = Ekf(
        VEHICLE, sensors, R, use=use, disturbance_time_s=fade_s,
        initial_std=np.array([*pose, *nu, d[0], 1e-2, d[1]]),
    )  # fmt: skip
    start = np.concatenate([pose, nu, d, np.zeros(5)])
    return block, matched.AssumedNoise(start, walk, d, np.full(2, fade_s), np.zeros(3), READING)


def kernel_of(block: Any) -> Any:
    """Return the filter as a scan with the outputs η, ν, covariance, innovation, and covariance of the innovation."""
    use = block.use
    example = Tick(1, np.zeros(3), sensor_slots(use)(*(Slot(1.0, np.zeros(m)) for m in (3, 1)[: len(use)])))

    def step(belief: Any, tick: Tick) -> tuple[Any, Any]:
        belief, estimate = block.row(belief, tick)
        return belief, (estimate.eta, estimate.nu, estimate.cov, estimate.innovation, estimate.innovation_cov)

    return scan(step, block.init(), example)


def make_ticks(simulated_drives: matched.Drives, k: int, use: tuple[str, ...]) -> Any:
    """Return the ticks of drive `k` for a filter."""
    n, z = len(simulated_drives.u), simulated_drives.z[:, k]
    columns = (np.ascontiguousarray(z[:, :3]), np.ascontiguousarray(z[:, 3:]))[: len(use)]
    slots = sensor_slots(use)(*(Slot(np.ones(n), column, np.zeros(n)) for column in columns))
    t_ns: Any = round(1e9 * matched.DT) * np.arange(1, n + 1)
    return Tick(t_ns, simulated_drives.u, slots)


def _square(cov: np.ndarray, e: np.ndarray) -> np.ndarray:
    """Return eᵀ P⁻¹ e (L, N) for errors e (L, N, n) with covariances P (L, N, n, n)."""
    return np.sum(e * np.linalg.solve(cov, e[..., None])[..., 0], axis=-1)


def _drawing(results: list[Accuracy]) -> Any:
    from baqueano.report.figures import draw_time_series

    names = list(results[0].ratios)[:3]
    figure = draw_time_series(
        [(result.name, {name: (result.t_s, result.ratios[name]) for name in names}) for result in results]
    )
    for axis, result in zip(figure.axes, results, strict=True):
        axis.set_ylim(0.0, max(2.0, 1.2 * max(float(np.max(result.ratios[name])) for name in names)))
        axis.set_title(axis.get_ylabel())
        axis.set_ylabel("mean / dimension")
        for line, colour in zip(axis.lines, ("#1f77b4", "#d62728", "#2ca02c"), strict=False):
            line.set_color(colour)
        axis.axhspan(
            1.0 - result.width[names[0]], 1.0 + result.width[names[0]], color="#8a8f98", alpha=0.25, lw=0
        )
    figure.axes[0].legend(names, ncols=3, loc="upper right")
    return figure


if __name__ == "__main__":
    main()
