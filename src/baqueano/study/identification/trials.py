"""Simulations and fits of `study identification`: robots and cars of the independent truth.

Robots have dead zones of 0.25 to 0.33, unequal gains, dry friction, a lag of 45 ms and delays of 4 to 17 ms. Their
8-bit PWM counts are logged. The IMU is 3 cm off the centre, turned by 4° and tilted by 2°. In a fit all parameters
are free that a user would free. It begins at a rough guess with the true tilt (robots.py). Cars on tyres are fitted
by the kinematic car with understeer, from IMU and odometer. The cases:
    clean               only white noise
    rough               ticks 1 ms irregular with true timestamps, 0.5 % outliers of 20 σ, steps of 1 σ, walking biases
    floor               process noise of a rough floor; "floor, innovations" is the same with the other cost
    low-passed          clean, but the IMU filters at 44 Hz, which is not in the file
    wrong start         clean, from friction and forces times 0.2 to 5, random signs, and dead zones from 0 to 0.5
    matched             cars with stiff and equal tyres, gentle steering: almost the fitted model
    understeer          soft tyres that understeer and saturate, half of full lock and more
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from baqueano.identify import Fit, FitOptions, excitation, identify
from baqueano.messages.language import mark as N_
from baqueano.runs.run import Run
from baqueano.simulate.open_loop import tick_times
from baqueano.study.counterpart import (
    FREE_CAR,
    FREE_ROBOT,
    GroupDrive,
    car_file,
    car_values,
    drive_group,
    robot_file,
    robot_values,
    vehicle_run,
)  # fmt: skip
from baqueano.study.counterpart.cars import SPEED, speed_at
from baqueano.study.demo import GUESSED_VALUES
from baqueano.study.identification.bound import cramer_rao_bound, perturbed_copies
from baqueano.study.truth import Cars, Robots, draw_cars, draw_robots, merge
from baqueano.vehicle_file import VehicleFile

ROBOT_CASES = (
    N_("clean"),
    N_("rough"),
    N_("floor"),
    N_("floor, innovations"),
    N_("low-passed"),
    N_("wrong start"),
)
CAR_CASES = (N_("matched"), N_("understeer"))
FREE_CAR_ON_TYRES = (*FREE_CAR, "+model.understeer")
CASES = ROBOT_CASES + CAR_CASES
DRIVE_S, REST_S = 60.0, 2.0
FLOOR_NOISE = (0.02, 0.01, 0.05)  # [m/s^1.5, m/s^1.5, rad/s^1.5]
JITTER_S = 1e-3
# the cases that are compared with the bound of clean readings
BOUND_CASES = ("clean", "rough", "wrong start")
LOW_PASS_HZ = 44.0
BOUND_STEP_S = 5e-3  # of Runge-Kutta: the bound equals that of 1 ms steps within 1e-4
PWM_COUNTS = 255
STEERING_AMPLITUDE = {"matched": 0.2, "understeer": 0.8}  # of full lock
OUTLIER_SHARE, OUTLIER_SIGMA = 0.005, 20.0  # share of the outliers, and their magnitude in σ
BIAS_WALK = (2e-4, 2e-4, 1e-5)  # of a bias in 1 s, as in garage/small
WRONG_START_FACTOR, MAX_ZONE = 5.0, 0.5  # of a wrong start
SAME_END_SIGMA = 0.1  # standard errors: two searches within this distance ended at the same point


class TrialJob(NamedTuple):
    """The seeds and cases of vehicles that are simulated together."""

    seeds: tuple[int, ...]
    cases: tuple[str, ...]
    backend: str
    duration_s: float


class TrialOutcome(NamedTuple):
    """The result of a fit, with the true values of its parameters."""

    case: str
    seed: int
    names: tuple[str, ...]  # (p,)
    truth: np.ndarray
    estimate: np.ndarray
    std: np.ndarray
    bound: np.ndarray  # NaN without a bound
    verdict: str
    reasons: tuple[tuple[str, str], ...]  # code and subject of each
    is_same_optimum: bool  # True if a wrong start ended at the same point as the usual start


def fit_job(job: TrialJob) -> list[TrialOutcome]:
    """Return the outcomes of all fits of a job."""
    robots = [case for case in ROBOT_CASES if case in job.cases]
    outcomes = _robot_outcomes(job, robots) if robots else []
    for case in (case for case in CAR_CASES if case in job.cases):
        outcomes += _car_outcomes(job, case)
    return outcomes


def draw_robot(seed: int) -> Robots:
    """Return the robot of that seed, with dead zones, motor lag, and an IMU that is off the centre, turned and
    tilted."""
    draw, q = np.random.default_rng([seed, 40]), draw_robots(1, seed)
    direction, towards = draw.uniform(-np.pi, np.pi, 2)
    imu = q.imu.with_parameters(
        place_m=0.03 * np.array([[np.cos(direction), np.sin(direction)]]),
        turn_rad=np.radians(4.0) * draw.choice([-1.0, 1.0], 1),
        tilt_rad=np.radians(2.0) * np.array([[np.cos(towards), np.sin(towards)]]),
    )
    forward, backward = draw.uniform(0.25, 0.33, (2, 1, 2))
    return q.with_parameters(
        forward=forward, backward=backward, lag_s=np.full(1, 0.045), floor=np.zeros((1, 3)), imu=imu
    )


def draw_car(seed: int, case: str) -> Cars:
    """Return the car of that seed; with stiff tyres unless the case is "understeer"."""
    q = draw_cars(1, seed)
    if case == "understeer":
        return q
    return q.with_parameters(tyre_n_rad=np.full((1, 2), 40.0), grip_n=np.full((1, 2), 10.0))


def initial_file(robot: Robots) -> VehicleFile:
    """Return the initial file of a fit: the guess of a user with a scale but without a data sheet."""
    guess = {path: value for path, value in GUESSED_VALUES.items() if path.startswith(("model.", "sensors."))}
    return robot_file(robot).with_values(
        guess | {
            "model.centre_of_mass_x_m": 0.0, "model.drivetrain.delay_s": 0.01, "sensors.imu.lever_arm_m": [0.0, 0.0],
            "sensors.imu.heading_rad": 0.0, "sensors.imu.tilt_rad": robot.imu.tilt_rad[0].tolist(),
        }
    )  # fmt: skip


def _robot_outcomes(job: TrialJob, cases: list[str]) -> list[TrialOutcome]:
    robots = [draw_robot(seed) for seed in job.seeds]
    signals = [
        _steps(initial_file(q), seed, job.duration_s) for q, seed in zip(robots, job.seeds, strict=True)
    ]
    t_ns, n = tick_times(len(signals[0]), 100.0), len(robots)
    drives: dict[str, GroupDrive] = {}
    bounds: list[dict[str, float]] = [{}] * n
    if set(cases) & set(BOUND_CASES):
        bounds = _bounds(robots, signals, t_ns)
    if "clean" in cases or "wrong start" in cases:
        drives = dict.fromkeys(
            ("clean", "wrong start"), drive_group(merge(robots), _columns(signals), job.seeds, t_ns)
        )
    if any("floor" in case for case in cases):
        group = [q.with_parameters(floor=np.array([FLOOR_NOISE])) for q in robots]
        drives |= dict.fromkeys(
            ("floor", "floor, innovations"), drive_group(merge(group), _columns(signals), job.seeds, t_ns)
        )
    if "low-passed" in cases:
        filtered_robots = [_low_pass(q) for q in robots]
        drives["low-passed"] = drive_group(merge(filtered_robots), _columns(signals), job.seeds, t_ns)
    if "rough" in cases:
        drives["rough"] = _drive_irregularly(robots, signals, job.seeds, t_ns)
    outcomes: list[TrialOutcome] = []
    for k in range(n):
        clean: Fit | None = None
        for case in cases:
            q = robots[k] if case != "rough" else _with_coarse_readings(robots[k])
            run = vehicle_run(
                drives[case], k, signals[k], initial_file(q), f"robot {job.seeds[k]}", job.seeds[k]
            )
            fit = _fit(run, q, case, job.seeds[k], job.backend)
            clean = fit if case == "clean" else clean
            bound = bounds[k] if case in BOUND_CASES else {}
            reference_fits = clean if case == "wrong start" else None
            true_values = robot_values(
                q.with_parameters(imu=q.imu.with_parameters(bias=q.imu.bias + drives[case].bias_drift[k]))
            )
            outcomes.append(_outcome(case, job.seeds[k], fit, true_values, bound, reference_fits))
    return outcomes


def _fit(run: Run, q: Robots, case: str, seed: int, backend: str) -> Fit:
    if case == "rough":
        run = _with_outliers(run, q, seed)
    start = _wrong_start(initial_file(q), seed) if case == "wrong start" else {}
    cost = "innovations" if "innovations" in case else "simulation"
    return identify(
        run, initial_file(q), FREE_ROBOT, options=FitOptions(start=start, cost=cost, backend=backend)
    )


def _bounds(robots: list[Robots], signals: list[np.ndarray], t_ns: np.ndarray) -> list[dict[str, float]]:
    """Return the Cramér-Rao bounds of each robot, by parameter."""
    copies = [perturbed_copies(q) for q in robots]
    u = np.repeat(_columns(signals), len(copies[0].mass_kg), axis=1)
    noiseless = drive_group(merge(copies), u, range(u.shape[1]), t_ns, BOUND_STEP_S).noiseless
    readings_by_robot = np.split(noiseless, len(robots), axis=1)
    return [cramer_rao_bound(readings, q) for readings, q in zip(readings_by_robot, robots, strict=True)]


def _drive_irregularly(
    robots: list[Robots], signals: list[np.ndarray], seeds: Sequence[int], t_ns: np.ndarray
) -> GroupDrive:
    """Return the drives of robots whose logger samples at irregular times."""
    jitter_s = (
        np.random.default_rng(41).normal(0.0, JITTER_S, len(t_ns)).clip(-3.0 * JITTER_S, 3.0 * JITTER_S)
    )
    irregular = t_ns + np.round(1e9 * jitter_s).astype(np.int64)
    return drive_group(merge([_with_coarse_readings(q) for q in robots]), _columns(signals), seeds, irregular)


def _with_coarse_readings(q: Robots) -> Robots:
    return q.with_parameters(imu=q.imu.with_parameters(walk=np.array([BIAS_WALK]), step=q.imu.noise))


def _low_pass(q: Robots) -> Robots:
    return q.with_parameters(imu=q.imu.with_parameters(low_pass_s=np.full(1, 0.5 / (np.pi * LOW_PASS_HZ))))


def _with_outliers(run: Run, q: Robots, seed: int) -> Run:
    draw, imu = np.random.default_rng([seed, 42]), run.sensors["imu"]
    outlier_mask = draw.random(imu.z.shape) < OUTLIER_SHARE
    imu.z[:] += outlier_mask * draw.choice([-OUTLIER_SIGMA, OUTLIER_SIGMA], imu.z.shape) * q.imu.noise
    return run


def _wrong_start(vehicle_file: VehicleFile, seed: int) -> dict[str, float]:
    draw, start = np.random.default_rng([seed, 43]), {}
    for i, j in ((0, 0), (2, 2)):
        path = f"model.actuator_matrix[{i},{j}]"
        start[path] = (
            draw.choice([-1.0, 1.0])
            * float(vehicle_file.value(path))
            * WRONG_START_FACTOR ** draw.uniform(-1.0, 1.0)
        )
    for k in range(3):
        path = f"model.friction.linear[{k}]"
        start[path] = float(vehicle_file.value(path)) * WRONG_START_FACTOR ** draw.uniform(-1.0, 1.0)
    for name in ("forward", "backward"):
        for k in range(2):
            start[f"model.drivetrain.dead_zone_{name}[{k}]"] = draw.uniform(0.0, MAX_ZONE)
    return start


def _car_outcomes(job: TrialJob, case: str) -> list[TrialOutcome]:
    cars = [draw_car(seed, case) for seed in job.seeds]
    files = [car_file(q) for q in cars]
    signals = [
        _car_steps(seed, files[0].rate_hz, job.duration_s, STEERING_AMPLITUDE[case]) for seed in job.seeds
    ]
    drive = drive_group(
        merge(cars), _columns(signals), job.seeds, tick_times(len(signals[0]), files[0].rate_hz)
    )
    outcomes = []
    for k, seed in enumerate(job.seeds):
        run = vehicle_run(drive, k, signals[k], files[k], f"car {seed}", seed)
        fit = identify(run, files[k], FREE_CAR_ON_TYRES, options=FitOptions(backend=job.backend))
        outcomes.append(_outcome(case, seed, fit, car_values(cars[k]), {}, None))
    return outcomes


def _outcome(
    case: str, seed: int, fit: Fit, truth: dict[str, np.ndarray], bound: dict[str, float], clean: Fit | None
) -> TrialOutcome:
    results = {
        **dict(
            zip(fit.run_entry_names, zip(fit.run_entries[0], fit.run_entry_std[0], strict=True), strict=True)
        ),
        **dict(zip(fit.names, zip(fit.estimate, fit.std, strict=True), strict=True)),
    }
    if SPEED in truth:
        results[SPEED] = _speed_estimate(fit)
    names = tuple(name for name in truth if name in results)
    estimate, stds = np.array([results[name] for name in names]).T
    same_fit = clean is None or _is_same_end(fit, clean)
    reasons = tuple((reason.code, reason.subject) for reason in fit.reasons)
    return TrialOutcome(
        case, seed, names, np.array([float(truth[name][0]) for name in names]), estimate, stds,
        np.array([bound.get(name, np.nan) for name in names]), fit.verdict, reasons, same_fit,
    )  # fmt: skip


def _speed_estimate(fit: Fit) -> tuple[float, float]:
    """Return the estimated steady speed at TEST_THROTTLE, and its standard error."""
    names = [
        "throttle_gain",
        "linear_drag",
        "quadratic_drag",
        "coulomb_m_s2",
        "drivetrain.dead_zone_forward[0]",
    ]
    entries = [fit.names.index(f"model.{name}") for name in names]
    x = np.where(np.isfinite(fit.estimate[entries]), fit.estimate[entries], fit.start[entries])
    value, h = float(speed_at(x)), 1e-6
    gradient = np.array([(float(speed_at(x + h * axis)) - value) / h for axis in np.eye(len(x))])
    cov = np.nan_to_num(fit.cov[np.ix_(entries, entries)])
    return value, float(np.sqrt(gradient @ cov @ gradient))


def _is_same_end(fit: Fit, clean: Fit) -> bool:
    is_near = np.abs(fit.estimate - clean.estimate) < SAME_END_SIGMA * clean.std
    return bool(np.all(is_near | ~np.isfinite(clean.std)))


def _steps(vehicle_file: VehicleFile, seed: int, duration_s: float) -> np.ndarray:
    return quantised_commands(
        excitation(
            "random_steps", vehicle_file.command.limit, duration_s, vehicle_file.rate_hz, seed, rest_s=REST_S
        )
    )


def quantised_commands(u: np.ndarray) -> np.ndarray:
    """Return the commands (N, 3) of a robot as the motors receive and the log stores them: whole counts of a PWM."""
    left, right = (
        np.round(PWM_COUNTS * np.clip(u[:, 0] + side * u[:, 2], -1.0, 1.0)) / PWM_COUNTS
        for side in (-1.0, 1.0)
    )
    return np.stack([0.5 * (left + right), 0.0 * left, 0.5 * (right - left)], axis=1)


def _car_steps(seed: int, rate_hz: float, duration_s: float, lock: float) -> np.ndarray:
    """Return throttle and servo (N, 2) that jump every 2 s and 1.2 s, after a rest."""
    draw, ticks = np.random.default_rng([seed, 44]), round(duration_s * rate_hz)
    columns = []
    for low, high, hold_s in ((0.1, 0.55, 2.0), (-lock, lock, 1.2)):
        hold_ticks = round(hold_s * rate_hz)
        columns.append(np.repeat(draw.uniform(low, high, ticks // hold_ticks + 1), hold_ticks)[:ticks])
    u = np.stack(columns, axis=1)
    u[: round(REST_S * rate_hz)] = 0.0
    return u


def _columns(signals: Sequence[np.ndarray]) -> np.ndarray:
    return np.stack(signals, axis=1)
