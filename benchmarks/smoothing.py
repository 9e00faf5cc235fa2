"""Compare the smoothed with the filtered estimates of the default filter, on vehicles of the second simulator.

    python -m benchmarks.smoothing      (--smallest: a short trial with one vehicle)

The vehicles are numbers 0 to 3 of `study estimation`: robots with slip, backlash, a slope and a second lag, which the
model does not include. Each is fitted to one run and replayed on another. In that run a camera reads the pose every
10 s, with noise of 1 cm and 0.02 rad; `draws` is the number of draws of this noise. The truth is that of the simulator.
"""

import argparse
from dataclasses import replace

import numpy as np

from baqueano.drive import replay
from baqueano.geometry import wrap
from baqueano.runs import Channel
from baqueano.runs.interpolation import interpolate_poses, true_speed
from baqueano.signals import NANOSECONDS
from baqueano.study.estimation.evaluation import fit_subject
from baqueano.study.estimation.simulated import EstimationJob, make_subjects
from baqueano.study.estimation.subjects import BOTH, IMU
from baqueano.vehicle_file import parse

SENSORS = (IMU, BOTH, IMU, BOTH)  # of vehicles 0 … 3
PERIOD_S, NOISE_STD = 10.0, np.array([0.01, 0.01, 0.02])
CAMERA = f'\n[sensors.camera]\nkind = "pose"\nrate_hz = 1.0\nnoise_std = {NOISE_STD.tolist()}\n'
CHI_SQUARE_95 = {"position": 5.991, "heading": 3.841}


def with_camera(run, seed):
    """Return the run with a reading of the true pose every PERIOD_S."""
    times_s = np.arange(PERIOD_S, run.duration_s, PERIOD_S)
    t_ns = run.t_ns[np.searchsorted(run.t_ns, run.t_ns[0] + (times_s * NANOSECONDS).astype(np.int64))]
    noise = NOISE_STD * np.random.default_rng(seed).standard_normal((len(t_ns), 3))
    z = interpolate_poses(t_ns, run.truth.t_ns, run.truth.eta) + noise
    z[:, 2] = wrap(z[:, 2])
    return replace(run, sensors=run.sensors | {"camera": Channel(t_ns, t_ns, z)})


def errors_of(run):
    """Return the mean squares of speed, position and heading errors, and the coverage of two 95 % regions, (5,)."""
    log = run.estimate
    e = log.eta - interpolate_poses(log.t_ns, run.truth.t_ns, run.truth.eta)
    e[:, 2], speed = wrap(e[:, 2]), log.nu[:, 0] - true_speed(log.t_ns, run.truth)
    rows = run.t_s > 1.0
    e, speed, P = e[rows], speed[rows], log.cov[rows]
    d2 = np.einsum("ki,ki->k", e[:, :2], np.linalg.solve(P[:, :2, :2], e[:, :2, None])[..., 0])
    is_inside = d2 < CHI_SQUARE_95["position"], e[:, 2] ** 2 / P[:, 2, 2] < CHI_SQUARE_95["heading"]
    return [np.mean(x) for x in (speed**2, np.sum(e[:, :2] ** 2, axis=1), e[:, 2] ** 2, *is_inside)]


def main():
    """Print a line for each vehicle, filtered and smoothed."""
    arguments = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    arguments.add_argument("--draws", type=int, default=8)
    arguments.add_argument("--smallest", action="store_true", help="one vehicle, one draw")
    options = arguments.parse_args()
    draws, sensor_sets = (1, SENSORS[:1]) if options.smallest else (options.draws, SENSORS)
    subjects = make_subjects(EstimationJob("robot", tuple(range(len(sensor_sets))), (), "auto"))
    for subject, sensors in zip(subjects, sensor_sets, strict=True):
        file = fit_subject(subject, sensors)[1]
        use = [*file.data["estimator"]["use"], "camera"]
        file = parse(file.text + CAMERA, file.name).with_values({"estimator.use": use})
        runs = [with_camera(subject.test_run, seed) for seed in range(100, 100 + draws)]
        for smooth in (False, True):
            replays = [replay(run, file, smooth=smooth) for run in runs]
            figures = np.mean([errors_of(replay_run) for replay_run in replays], axis=0)
            speed, position, heading = np.sqrt(figures[:3])
            print(
                f"{subject.name}, {sensors}, {'smoothed' if smooth else 'filtered'}: speed {1e3 * speed:.1f} mm/s, "
                f"position {1e2 * position:.1f} cm, heading {np.degrees(heading):.2f}°, in their 95 % regions "
                f"{100.0 * figures[3]:.1f} and {100.0 * figures[4]:.1f} %"
            )


if __name__ == "__main__":
    main()
