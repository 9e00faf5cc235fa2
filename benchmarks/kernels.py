"""Compare the uses of `scan` with the same functions written by hand in C (kernels.c).

The ratio is the time of careful code by hand over the time of the compiled step. The target is at least 0.77: the
compiled step takes at most 1.3 times as long. It is judged only for the fit, in which one evaluation is one call.
"""

import ctypes
from functools import partial
from pathlib import Path
from time import process_time
from typing import TypeAlias

import numpy as np

from baqueano.symbolic import jacobian, scan
from baqueano.symbolic.c_code import compile
from baqueano.vehicles import delay
from baqueano.vehicles.effort import lagged_effort
from baqueano.vehicles.rk4 import rk4
from benchmarks import paper, peers
from benchmarks.harness import Bench, Case, LeftOut, measured

Libraries: TypeAlias = dict[str, ctypes.CDLL]
HANDS = {  # find_vectors, operations: the usual flags, and the flags for our code
    "by hand in C, -O3": (True, compile.MAX_SCHEDULED_OPERATIONS),
    "by hand in C, our flags": (False, 0),
}
TARGETS: dict[str, float] = {}
FIT: dict[str, float] = {"by hand in C, -O3": 1.0 / 1.3}
THETA, MASS, INERTIA = peers.parameters()
ALL = np.array([*THETA, MASS, INERTIA])
Q, R = np.diag([0.0025, 0.0025, 0.000025]), np.diag([1e-6, 1e-6, 1e-6, 1e-4, 1e-4, 1e-4])
MOTORS = np.array([*THETA[:6], *THETA[6:].reshape(3, 3)[:, [0, 2]].ravel(), 0.045, 0.013, 0.002])
BEGUN = np.zeros(3), np.zeros((2, 2)), np.ones(2), np.zeros(2)  # ν, past commands and their durations, effort
WEIGHT, BEND = np.array([20.0, 20.0, 200.0]), 1.345


def benches(smallest: bool) -> list[Bench] | list[LeftOut]:
    """Return the benches of a trajectory, a filter, a fit and many vehicles."""
    if compile.find_compiler().compiler is None:
        return [LeftOut("kernels by hand", "sudo apt-get install gcc")]
    u = paper.signal(1.0 if smallest else 60.0, sideways=5.0)
    libraries = libraries_of("kernels.c")
    return [bench(libraries, u) for bench in (trajectory, filtering, fitting, fleet)]


def libraries_of(name: str) -> Libraries:
    """Return the library of a C file of this folder, for each set of flags."""
    text = Path(__file__).with_name(name).read_text(encoding="utf-8")
    return {
        title: compile.load_library((text, n), lambda n=n: (text, n), find_vectors)
        for title, (find_vectors, n) in HANDS.items()
    }


def runge_kutta(theta, x, u):
    """Return the state x after one tick; θ (17,) ends with mass and inertia."""

    def f(x):
        return peers.right_hand_side(x, u, theta[:15], theta[15], theta[16])

    a = f(x)
    b = f(x + 0.5 * peers.DT * a)
    c = f(x + 0.5 * peers.DT * b)
    d = f(x + peers.DT * c)
    return x + peers.DT / 6.0 * (a + 2.0 * b + 2.0 * c + d)


def trajectory(libraries: Libraries, u: np.ndarray) -> Bench:
    """Return the bench of a trajectory, tick by tick, with all states as output."""

    def step(theta, x, u):
        x = runge_kutta(theta, x, u)
        return x, x

    folded_scan = scan(lambda x, u: step(ALL, x, u), np.zeros(6), u[0], backend="c")
    free = scan(step, np.zeros(6), u[0], ALL, backend="c")
    expected = np.empty((len(u), 6))
    by_hand = compiled_cases(libraries, "simulate", len(u), ALL, u, expected)
    np.testing.assert_allclose(folded_scan.run(u)[1], expected, rtol=1e-11, atol=1e-11)
    cases = [
        Case("scan, constants folded", lambda: folded_scan.run(u)),
        *by_hand,
        Case("scan, 17 parameters at run time", lambda: free.run(u, ALL)),
    ]
    return measured(
        f"kernel a: trajectory of {len(u):,} ticks, Runge-Kutta", cases, TARGETS, clock=process_time
    )


def filtering(libraries: Libraries, u: np.ndarray) -> Bench:
    """Return the bench of the extended Kalman filter with 6 states and 3 measurements, with its Jacobians derived."""
    z = np.random.default_rng(0).normal(size=(len(u), 3)) * 0.1
    expected = np.empty((len(u), 6))
    by_hand = compiled_cases(libraries, "filter", len(u), u, z, expected)
    start = (np.zeros(6), 0.01 * np.eye(6))
    joseph, short = (scan(kalman(form), start, (u[0], z[0]), backend="c") for form in (True, False))
    np.testing.assert_allclose(joseph.run((u, z))[1], expected, rtol=1e-9, atol=1e-9)
    cases = [
        Case("scan, Joseph form", lambda: joseph.run((u, z))),
        *by_hand,
        Case("scan, P − K H P", lambda: short.run((u, z))),
    ]
    return measured(f"kernel b: EKF over {len(u):,} ticks", cases, TARGETS, clock=process_time)


def kalman(joseph: bool):
    """Return the step of the filter, with Joseph's form of the covariance if `joseph`."""

    def f(x, u):
        return x + peers.DT * peers.right_hand_side(x, u, THETA, MASS, INERTIA)

    def h(x, u):
        return imu_reading(THETA, x, u)

    def step(belief, tick):
        (x, P), (u, z) = belief, tick
        G, x = jacobian(f)(x, u), f(x, u)
        P = G @ P @ G.T + R
        H = jacobian(h)(x, u)
        K = np.linalg.solve(H @ P @ H.T + Q, H @ P).T
        x = x + K @ (z - h(x, u))
        rest = np.eye(6) - K @ H
        P = rest @ P @ rest.T + K @ Q @ K.T if joseph else P - K @ (H @ P)
        return (x, P), x

    return step


def imu_reading(theta, x, u):
    """Return the reading of an IMU (3,): ν̇ − the centripetal part, and ν_ψ."""
    nu_dot = peers.right_hand_side(x, u, theta, MASS, INERTIA)[3:]
    return np.array([nu_dot[0] - x[5] * x[4], nu_dot[1] + x[5] * x[3], x[5]])


def fitting(libraries: Libraries, u: np.ndarray) -> Bench:
    """Return the bench of Huber's normal equations for 15 parameters, with lag and delay, on rows as in a fit."""
    z = np.random.default_rng(0).normal(size=(len(u), 3))
    rows = np.concatenate([np.full((len(u), 1), peers.DT), u[:, [0, 2]], z], axis=1)
    cost, gradient, hessian = np.empty(1), np.empty(15), np.empty((15, 15))
    by_hand = compiled_cases(libraries, "fit", len(u), MOTORS, rows, BEND, cost, gradient, hessian)
    kernel, packing_kernel = (
        scan(step, BEGUN, example, MOTORS, backend="c")
        for step, example in (
            (late, rows[0]),
            (lambda p, x, row: late(p, x, np.concatenate(row)), parts(rows[0])),
        )
    )
    equations = kernel.normal_equations(rows, MOTORS, BEND)
    np.testing.assert_allclose(equations.cost, cost[0], rtol=1e-11)
    np.testing.assert_allclose(equations.gradient, gradient, rtol=1e-9)
    np.testing.assert_allclose(
        np.triu(equations.hessian), np.triu(hessian), rtol=1e-9, atol=1e-9 * hessian.max()
    )
    cases = [
        Case("scan", lambda: kernel.normal_equations(rows, MOTORS, BEND)),
        *by_hand,
        Case("scan, packed at each call", lambda: packing_kernel.normal_equations(parts(rows), MOTORS, BEND)),
    ]
    return measured(
        f"kernel c: normal equations, 15 parameters, {len(u):,} ticks", cases, FIT, clock=process_time
    )


def late(theta, state, row):
    """Return a tick of a robot with delay and lag of its motors, computed as in our vehicles; θ as in kernels.c."""
    nu, past, steps_s, lag_state = state
    dt_s, u, z, inverse_mass = row[0], row[1:3], row[3:], np.array([1.0 / MASS, 1.0 / MASS, 1.0 / INERTIA])
    T = theta[6:12].reshape(3, 2)

    def nu_dot(nu, effort):
        turning = np.array([nu[1] * nu[2], -nu[0] * nu[2], 0.0])
        return (T @ effort - (theta[:3] + theta[3:6] * np.abs(nu)) * nu) * inverse_mass + turning

    effort = lagged_effort(
        delay.command_segments(u, past, steps_s, theta[13], dt_s), lag_state, theta[12], dt_s
    )
    nu = rk4(nu_dot, nu, effort, dt_s)
    a = nu_dot(nu, effort.last)
    h = np.array([a[0] - nu[2] * nu[1], a[1] + nu[2] * nu[0], nu[2] + theta[14]])
    after = nu, delay.with_newest_value(past, u), delay.with_newest_value(steps_s, dt_s), effort.last
    return after, (z - h) * WEIGHT


def parts(rows):
    """Return dt (…, 1), u (…, 2) and z of rows of inputs."""
    return rows[..., :1], rows[..., 1:3], rows[..., 3:]


def fleet(libraries: Libraries, u: np.ndarray) -> Bench:
    """Return the bench of 32 vehicles, each with 17 parameters: few enough for one processor."""
    theta = ALL * np.random.default_rng(0).uniform(0.9, 1.1, (32, 17))
    expected = np.empty((32, 6))
    by_hand = compiled_cases(libraries, "fleet", 32, len(u), theta, u, expected)
    kernel = scan(lambda p, x, u: (runge_kutta(p, x, u), x), np.zeros(6), u[0], ALL, backend="c")
    np.testing.assert_allclose(kernel.batch(u, theta)[0], expected, rtol=1e-10, atol=1e-10)
    cases = [Case("scan.batch", lambda: kernel.batch(u, theta)), *by_hand]
    return measured(
        f"kernel e: 32 vehicles side by side, {len(u):,} ticks, one processor",
        cases,
        TARGETS,
        clock=process_time,
    )


def compiled_cases(libraries: Libraries, name: str, *arguments) -> list[Case]:
    """Return a case per library: its function `name` on these arguments, after one call that fills the outputs."""
    kinds = {int: ctypes.c_int64, float: ctypes.c_double}
    pointers = [
        a.ctypes.data_as(ctypes.c_void_p) if isinstance(a, np.ndarray) else kinds[type(a)](a)
        for a in arguments
    ]
    cases = []
    for title, library in libraries.items():
        function = getattr(library, name)
        function.restype = None
        function(*pointers)
        cases.append(Case(title, partial(function, *pointers)))
    return cases
