"""Measure the delay that a controller tolerates: robots of the second simulator, wrong models, disturbed wheels.

    python -m benchmarks.delay --controller pd_feedforward      (--smallest: a short trial)

The tolerated delay is the total delay, from a command to the motor, that doubles the distance beside the path. The
distance is rms over time, and the median of the robots; without added delay they have 4 to 17 ms. The controller's
model does not include the added delay. Pose and velocity are known, gains are the defaults. The model has uniform
errors: actuator matrix ± 2 %, dry friction and dead zones ± 5 %, lag ± 10 %. The duty of each wheel has an error of 3 %
(1 std) that varies within 2 s. The paper's PD cannot correct an error beside its path; its row shows the effect.
"""

import argparse

import numpy as np

from baqueano.compare.errors import cross_track, rms
from baqueano.guides.repeat import Repeat
from baqueano.guides.shapes import sinuous_circle
from baqueano.signals import Estimate, Slot, Tick
from baqueano.simulate.open_loop import tick_times
from baqueano.study.counterpart.robots import robot_file, robot_values
from baqueano.study.truth import TruthWorld, draw_robots, merge
from baqueano.study.truth_drives import Loop

ROUTE = sinuous_circle(0.6, 0.06, 5, 0.2)
FIRST, ROBOTS = 900, 4
EXTRA_S = (0.0, 0.03, 0.06, 0.09, 0.12)
LASTS_S = 10.0  # half a lap
ERRORS = {"model.actuator_matrix": 0.02, "model.friction.coulomb": 0.05, "model.drivetrain.dead_zone": 0.05,
          "model.drivetrain.lag_s": 0.1}  # fmt: skip
WHEELS, FADE_S = 0.03, 2.0
FROM_S = 2.0  # a start from rest is not steady following
SIDES = np.array([[1.0, 0.0, -1.0], [1.0, 0.0, 1.0]])  # duty of the wheels (2,) of a command (3,)


def model_of(robot, seed):
    """Return the vehicle file of a robot, with random errors of the model."""
    draw, file = np.random.default_rng([seed, 31]), robot_file(robot)
    values = {}
    for path, truth in robot_values(robot).items():
        if path.startswith("model."):
            part = next((size for name, size in ERRORS.items() if path.startswith(name)), 0.0)
            values[path] = float(truth[0]) * (1.0 + part * draw.uniform(-1.0, 1.0))
    return file.with_values(values)


def disturbances(seed, ticks, rate_hz):
    """Return the relative error of each wheel's duty (ticks, 2)."""
    draw, keep = np.random.default_rng([seed, 32]), np.exp(-1.0 / (FADE_S * rate_hz))
    out = np.zeros((ticks, 2))
    out[0] = WHEELS * draw.standard_normal(2)
    for k in range(1, ticks):
        out[k] = keep * out[k - 1] + WHEELS * np.sqrt(1.0 - keep**2) * draw.standard_normal(2)
    return out


def errors_beside(loops, robots, seeds, seconds):
    """Return the distance (robots,) [m] of each robot beside the path, rms over time after the start."""
    rate_hz, n = loops[0].file.rate_hz, len(loops)
    t_ns, guide = tick_times(int(seconds * rate_hz), rate_hz), Repeat.along(ROUTE)
    world = TruthWorld(robots, seeds, np.tile(ROUTE.eta[0], (n, 1)))
    states, u, now = [loop.start(ROUTE.eta[0]) for loop in loops], np.zeros((n, 3)), guide.init()
    errors = np.stack([disturbances(seed, len(t_ns), rate_hz) for seed in seeds])
    exact, requested_u = np.zeros((len(t_ns), n, 2)), np.zeros((len(t_ns), 2))
    at_rest = Estimate(0, np.zeros(3), np.zeros(3), np.zeros((6, 6)))
    for k, t in enumerate(t_ns):
        duty = u @ SIDES.T * (1.0 + errors[:, k])
        world.move(
            np.column_stack([duty.mean(1), np.zeros(n), 0.5 * (duty[:, 1] - duty[:, 0])]), 1.0 / rate_hz
        )
        truth = world.truth
        now, reference = guide.step(now, at_rest._replace(t_ns=int(t)))
        for i, loop in enumerate(loops):
            state = np.concatenate([truth.eta[i], truth.nu[i]])
            states[i], (u[i], _) = loop.step(
                states[i], Tick(int(t), u[i].copy(), loop.slots(Slot(1.0, state))), reference
            )
        exact[k], requested_u[k] = truth.eta[:, :2], reference.eta[:2]
    is_late = t_ns >= int(min(FROM_S, 0.5 * seconds) * 1e9)
    return np.array([rms(cross_track(t_ns[is_late], exact[is_late, i], t_ns, requested_u)) for i in range(n)])


def main():
    """Print the distance for each delay, and the delay at which it doubles."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--controller", default="pd_feedforward")
    parser.add_argument("--smallest", action="store_true")
    args = parser.parse_args()
    seeds = [FIRST] if args.smallest else list(range(FIRST, FIRST + ROBOTS))
    seconds, extra = (1.0, EXTRA_S[:2]) if args.smallest else (LASTS_S, EXTRA_S)
    robots_of_seeds = [draw_robots(1, seed) for seed in seeds]
    gains = {"alpha": 4.0, "beta": 1.0, "gamma": 0.1} if args.controller == "pd" else {}
    files = [
        model_of(robot, seed).with_values(
            {"controller.kind": args.controller}
            | {f"controller.{name}": value for name, value in gains.items()}
        )
        for robot, seed in zip(robots_of_seeds, seeds, strict=True)
    ]
    loops, robots = [Loop(file, True, "auto") for file in files], merge(robots_of_seeds)
    mean_s = float(np.median(robots.delay_s))
    print(
        f"{args.controller}, {len(seeds)} robots: total delay [ms] (median), beside the path [mm rms]: median, worst"
    )
    rows = []
    for delay_s in extra:
        rows.append(
            errors_beside(loops, robots.with_parameters(delay_s=robots.delay_s + delay_s), seeds, seconds)
        )
        middle, worst = 1e3 * np.median(rows[-1]), 1e3 * np.max(rows[-1])
        print(f"  {1e3 * (mean_s + delay_s):6.0f} {middle:8.2f} {worst:8.2f}", flush=True)
    medians = np.array([np.median(d) for d in rows])
    slow_sizes = np.flatnonzero(medians >= 2.0 * medians[0])
    if len(slow_sizes):
        k = int(slow_sizes[0])
        part = (2.0 * medians[0] - medians[k - 1]) / (medians[k] - medians[k - 1])
        print(f"  twice at {1e3 * (mean_s + extra[k - 1] + part * (extra[k] - extra[k - 1])):.0f} ms")
    else:
        print(f"  not twice up to {1e3 * (mean_s + extra[-1]):.0f} ms")


if __name__ == "__main__":
    main()
