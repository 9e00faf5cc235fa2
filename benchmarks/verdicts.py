"""Count how often the verdict on a filter's consistency is wrong, and how often it is absent. The truth is known.

    python -m benchmarks.verdicts --drives 720      (--smallest: a short trial)

All variances of the model of matched.py are κ times the variances that the recommended filter assumes, κ from 1/4 to 4.
So its errors are √κ times the reported errors. "Too sure" is correct for κ > 1, "too cautious" for κ < 1, "consistent"
for κ = 1, and "cannot tell" is never wrong. The benchmark runs twice: with sensors whose biases and scales are known,
and with biases and scales that are drawn once per drive, as the filter assumes. Each drive lasts 10 to 60 s. Every
second drive is judged only by its innovations, as without a camera. A drive with 100 independent samples should have a
verdict.
"""

import argparse
from collections import Counter
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from baqueano.compare.filter_consistency import filter_consistency
from baqueano.estimators import AugmentedEkf
from baqueano.runs.run import EstimateLog, Run, TruthLog
from baqueano.sensors import Imu, Odometer
from baqueano.signals import sensor_slots
from benchmarks import limit, matched

RATIOS = (0.25, 0.5, 1.0, 1.0, 2.0, 4.0)
SHORTEST_S, LONGEST_S = 10.0, 60.0
ENOUGH = 100.0  # independent samples
WRONG, SPEAKS = 0.05, 0.80
RIGHT = {"too sure": lambda k: k > 1.0, "too cautious": lambda k: k < 1.0, "consistent": lambda k: k == 1.0}


class JudgedDrive(NamedTuple):
    """The verdict on one drive, with κ and the number of independent samples."""

    kappa: float  # true variances over those that the filter assumes
    verdict: str
    samples: float  # largest number of independent samples of a figure


def logged(
    kernel: object, simulated_drives: matched.Drives, k: int, use: tuple[str, ...], ticks: int, truth: bool
) -> Run:
    """Return the first `ticks` of drive `k` as a run with an estimate, and with its truth if `truth`."""
    ticks_of_run = limit.make_ticks(simulated_drives, k, use)
    eta, nu, cov, y, S = (np.asarray(output)[:ticks] for output in kernel.run(ticks_of_run)[1])  # type: ignore[attr-defined]
    x, t_ns = simulated_drives.x[:ticks, k], np.asarray(ticks_of_run.t_ns)[:ticks]
    velocity = x[:, matched.NU] * (1.0 + x[:, [8, 8, 9]])
    log = TruthLog(t_ns, x[:, matched.POSE], velocity, np.full_like(velocity, np.nan)) if truth else None
    return Run(
        "drive",
        None,
        t_ns,
        simulated_drives.u[:ticks],
        truth=log,
        estimate=EstimateLog(t_ns, eta, nu, cov, y, S),
    )


def judge_filters(imu: Imu, odometer: Odometer, drives: int, longest_s: float) -> list[JudgedDrive]:
    """Return the verdicts on drives with only an IMU, and on drives with IMU and odometer."""
    out, rng = [], np.random.default_rng(0)
    for use in (limit.IMU_ALONE, limit.BOTH):
        sensors = sensor_slots(use)(*(imu, odometer)[: len(use)])
        block = AugmentedEkf(limit.VEHICLE, sensors, use=use, course_std=0.0, sideslip_error_std=0.0)
        kernel, assumed_noise = limit.kernel_of(block), limit.assumed_by(block, imu)
        for j, kappa in enumerate(RATIOS):
            n = max(drives // (2 * len(RATIOS)), 2)
            scaled_noise = matched.AssumedNoise(
                *(density * np.sqrt(kappa) for density in assumed_noise)
            )._replace(fade_s=assumed_noise.fade_s)
            simulated_drives = limit.simulated(scaled_noise, n, longest_s, 10 * j + len(use))
            for k in range(n):
                ticks = round(rng.uniform(min(SHORTEST_S, 0.5 * longest_s), longest_s) / matched.DT)
                consistency = filter_consistency(logged(kernel, simulated_drives, k, use, ticks, k % 2 == 0))
                bands = (
                    (consistency.nees_pose, consistency.nees_velocity) if k % 2 == 0 else (consistency.nis,)
                )
                out.append(
                    JudgedDrive(float(kappa), consistency.verdict, max(band.samples for band in bands))
                )
    return out


def main() -> int:
    """Print the shares of wrong and absent verdicts; return 1 if a limit is missed, else 0."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.verdicts", description=__doc__)
    parser.add_argument("--drives", type=int, default=720)
    parser.add_argument("--smallest", action="store_true", help="a size that shows in seconds that it runs")
    args = parser.parse_args()
    size, all_met = (24, 4.0) if args.smallest else (args.drives, LONGEST_S), True
    for name, imu, odometer in (
        ("sensors exact", limit.EXACT, replace(limit.ODOMETER, scale_std=0.0)),
        ("with bias, scale", limit.IMU, limit.ODOMETER),
    ):
        results = judge_filters(imu, odometer, *size)
        for kappa in dict.fromkeys(RATIOS):
            words = Counter(result.verdict for result in results if result.kappa == kappa)
            print(
                f"{name}, variances × {kappa:<5g} {', '.join(f'{word}: {n}' for word, n in words.most_common())}"
            )
        share = np.mean([not RIGHT.get(result.verdict, lambda k: True)(result.kappa) for result in results])
        could = [result.verdict != "cannot tell" for result in results if result.samples >= ENOUGH]
        speaks = float(np.mean(could)) if could else 1.0
        is_good = bool(share <= WRONG and speaks >= SPEAKS)
        print(
            f"{name}, {len(results)} drives: wrong in {share:.1%} (at most {WRONG:.0%}); speaks in {speaks:.1%} of "
            f"{len(could)} with {ENOUGH:g} independent samples (at least {SPEAKS:.0%}): "
            f"{'MET' if is_good else 'MISSED'}",
            flush=True,
        )
        all_met = all_met and is_good
    return int(not (all_met or args.smallest))


if __name__ == "__main__":
    raise SystemExit(main())
