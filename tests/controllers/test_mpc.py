"""Model predictive control: onto its path from aside, within the limits of its motors and the walls of its room."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from baqueano.controllers import Mpc
from baqueano.drive import repeat
from baqueano.errors import Invalid, UsageError
from baqueano.guides.shapes import line, sinuous_circle
from baqueano.signals import Estimate, Reference
from baqueano.vehicle_file import load
from tests.codes import refused

SMALL, CAR = load("small"), load("car")
HZ = 50.0


def law(file=SMALL, **changes):
    return Mpc(file.vehicle, limit=file.command.limit, rate_hz=HZ, **changes)


def drive(controller, file, route, start, seconds):
    """Return poses (N, 3) and commands (N, n) of a vehicle whose pose is known, along an open route."""
    vehicle, state = file.vehicle, controller.init()
    motion = vehicle.init(eta=np.array(start))
    poses, commands = [], []
    for k in range(round(seconds * HZ)):
        t_s, t_ns = k / HZ, round(k * 1e9 / HZ)
        eta = np.array([np.interp(t_s, route.t_s, column) for column in route.eta.T])
        nu = np.array([np.interp(t_s, route.t_s, column) for column in route.nu.T])
        believed = Estimate(t_ns, motion.eta, motion.nu, np.eye(6))
        state, command = controller.step(state, Reference(t_ns, eta, nu, 0.0), believed)
        motion, _ = vehicle.step(motion, command.u, 1.0 / HZ, np.zeros(3))
        poses.append(motion.eta)
        commands.append(command.u)
    return np.array(poses), np.array(commands)


@pytest.mark.parametrize(("file", "speed"), [(SMALL, 0.2), (CAR, 0.6)], ids=["robot", "car"])
@pytest.mark.parametrize("aside", [0.2, -0.2])
def test_it_joins_its_path_from_beside(file, speed, aside):
    """20 cm beside and 30° off: within 3 cm of the path after one metre of route."""
    start = (0.0, aside, np.copysign(np.radians(30.0), aside))
    poses, u = drive(law(file), file, line(2.0, speed), start, 1.9 / speed)
    late = poses[round(1.2 / speed * HZ) :]
    assert np.max(np.abs(late[:, 1])) < 0.03
    assert np.all(np.abs(u) <= file.command.limit + 1e-9)


def test_no_motor_is_asked_for_more_than_it_has():
    _, u = drive(law(), SMALL, line(4.0, 2.0), (0.0, 0.1, 0.5), 2.0)
    wheels = np.abs(u[:, 0]) + np.abs(u[:, 2])
    assert np.max(wheels) <= 1.0 + 1e-9
    assert np.median(wheels) > 0.9  # the route is too fast, and it uses what there is


def test_a_wall_is_not_passed():
    """The route leads 0.5 m beyond the wall; without the wall it is followed."""
    route = line(1.5, 0.25)
    free, _ = drive(law(), SMALL, route, (0.0, 0.0, 0.0), 6.0)
    kept, _ = drive(law(wall_high=np.array([1.0, np.inf])), SMALL, route, (0.0, 0.0, 0.0), 6.0)
    assert np.max(free[:, 0]) > 1.4
    assert np.max(kept[:, 0]) < 1.01


def test_a_lap_of_the_whole_loop_stays_on_its_path():
    """At the file's own rate, with its estimator: nearer to the reference along the path than the feed-forward law."""
    run = repeat(SMALL, sinuous_circle(0.6, 0.08, 5, 0.2), controller=Mpc, duration_s=6.0)
    assert run.estimate is not None
    assert run.reference is not None
    off = run.estimate.eta - run.reference.eta
    psi = run.reference.eta[:, 2]
    along, across = (np.array([[np.cos(psi), np.sin(psi)], [-np.sin(psi), np.cos(psi)]]) * off[:, :2].T).sum(
        axis=1
    )
    assert np.sqrt(np.mean(across**2)) < 0.004
    assert np.sqrt(np.mean(along[200:] ** 2)) < 0.006


def test_where_the_solver_fails_the_old_plan_goes_on_and_then_the_drive_ends(monkeypatch):
    controller, here = law(), Estimate(0, np.zeros(3), np.zeros(3), np.eye(6))
    ahead = Reference(0, np.array([0.3, 0.0, 0.0]), np.zeros(3), 0.0)
    state, first = controller.step(controller.init(), ahead, here)
    monkeypatch.setattr("baqueano.controllers.mpc.BoundedProgram.solve", lambda *_: None)
    for k in range(1, 11):
        t_ns = k * 20_000_000
        state, command = controller.step(state, ahead._replace(t_ns=t_ns), here._replace(t_ns=t_ns))
        assert state.failures == k
        assert np.isfinite(command.u).all()
    assert first.u[0] > 0.3
    with refused("mpc.unsolved", Invalid, ticks=11):
        controller.step(state, ahead._replace(t_ns=10**9), here._replace(t_ns=10**9))


def test_without_its_solver_it_says_what_to_type(monkeypatch):
    monkeypatch.setitem(sys.modules, "osqp", None)
    ahead = Reference(0, np.array([0.3, 0.0, 0.0]), np.zeros(3), 0.0)
    with refused("mpc.no-solver", UsageError):
        controller = law()
        controller.step(controller.init(), ahead, Estimate(0, np.zeros(3), np.zeros(3), np.eye(6)))


def test_a_limit_of_another_length_is_refused():
    with refused("field.limit", Invalid):
        replace(law(), limit=np.ones(2))
