"""Model predictive control: it joins its path from beside, within the limits of its motors and the walls of its
room.
"""

import sys
from dataclasses import replace

import numpy as np
import pytest

import baqueano as bq
from baqueano.controllers import Mpc
from baqueano.controllers.mpc.program import BoundedProgram
from baqueano.drive import drive_stop_reason, repeat
from baqueano.errors import Invalid, UsageError
from baqueano.geometry import compose
from baqueano.guides.shapes import circle, line, sinuous_circle
from baqueano.routes import reverse
from baqueano.signals import Estimate, Reference
from baqueano.simulate import simulate_loop
from baqueano.study.driving import driving
from baqueano.symbolic import compile_block
from baqueano.tune import tune
from baqueano.vehicle_file import load
from baqueano.worlds import SimulatedWorld
from tests.codes import refused
from tests.controllers.test_model_errors import WRONG_TURNING

SMALL, CAR = load("small"), load("car")
HZ = 50.0


def law(file=SMALL, **changes):
    return Mpc(file.vehicle, limit=file.command.limit, rate_hz=HZ, **changes)


def drive(controller, file, route, start, seconds, speed=0.0):
    """Return poses (N, 3) and commands (N, n) of a vehicle whose pose is known, along an open route."""
    vehicle, state = compile_block(file.vehicle), controller.init()
    motion = file.vehicle.init(eta=np.array(start), nu=np.array([speed, 0.0, 0.0]))
    poses, commands = [], []
    for k in range(round(seconds * HZ)):
        t_s, t_ns = k / HZ, round(k * 1e9 / HZ)
        eta = np.array([np.interp(t_s, route.t_s, column) for column in route.eta.T])
        nu = np.array([np.interp(t_s, route.t_s, column) for column in route.nu.T])
        estimate = Estimate(t_ns, motion.eta, motion.nu, np.eye(6))
        state, command = controller.step(state, Reference(t_ns, eta, nu, 0.0), estimate)
        motion, _ = vehicle.step(motion, command.u, 1.0 / HZ, np.zeros(3))
        poses.append(motion.eta)
        commands.append(command.u)
    return np.array(poses), np.array(commands)


PLACES = [(0.0, 0.2, 30), (0.0, 0.2, -30), (0.0, -0.2, 30), (0.0, -0.2, -30), (-0.2, 0.0, 30), (0.2, 0.0, 30),
          (-0.2, 0.2, 30), (0.2, -0.2, -30)]  # ahead, to the left [m], turned [deg]  # fmt: skip


@pytest.mark.parametrize(
    ("file", "speed", "radius_m"), [(SMALL, 0.2, 1.0), (CAR, 0.5, 3.0)], ids=["robot", "car"]
)
@pytest.mark.parametrize("moving", [False, True], ids=["at rest", "moving"])
def test_mpc_joins_its_route_from_all_sides_within_a_metre(file, speed, radius_m, moving):
    """The vehicle is 20 cm beside, behind or in front, 30° off. After one metre of route it stays within 3 cm of the
    path."""
    route, controller = circle(radius_m, speed), law(file)
    x, y, psi = route.eta[0]
    centre = np.array([x - radius_m * np.sin(psi), y + radius_m * np.cos(psi)])
    for forward, left, heading_deg in PLACES:
        start = compose(route.eta[0], np.array([forward, left, np.radians(heading_deg)]))
        poses, u = drive(controller, file, route, start, 2.0 / speed, speed if moving else 0.0)
        error = np.abs(np.hypot(*(poses[:, :2] - centre).T) - radius_m)
        assert np.max(error[round(1.0 / speed * HZ) :]) < 0.03, (forward, left, heading_deg)
        assert np.all(np.abs(u) <= file.command.limit + 1e-9)


@pytest.mark.parametrize("speed", [0.3, -0.3], ids=["forward", "backward"])
def test_a_car_stays_on_a_circle_that_was_drawn_for_its_origin(speed):
    """The origin is ahead of the rear axle, so on the circle the car points outward of the tangent."""
    lap = circle(1.2, 0.3)
    route = lap if speed > 0.0 else reverse(lap, backing=True)
    poses, _ = drive(law(CAR), CAR, route, route.eta[0], 10.0)
    error = np.abs(np.hypot(poses[:, 0], poses[:, 1] - 1.2) - 1.2)
    assert np.max(error) < 0.012
    assert np.max(error[250:]) < 0.002


@pytest.mark.parametrize(("name", "changes", "radius_m", "speed"), WRONG_TURNING)
def test_mpc_does_not_remain_beside_its_circle_if_its_model_is_wrong(name, changes, radius_m, speed):
    """A wheel differs by 5 %, or the servo by 0.02 rad. Before, mpc drove 1.9 to 3.9 mm beside the circle."""
    file, route = load(name), circle(radius_m, speed)
    start, centre = route.eta[0], compose(route.eta[0], np.array([0.0, radius_m, 0.0]))[:2]
    poses, _ = drive(law(file), file.with_values(changes), route, start, 9.5, speed)
    cross_track_m = np.hypot(*(poses[-round(3.0 * HZ) :, :2] - centre).T) - radius_m
    assert np.abs(cross_track_m).mean() < 0.001


def test_mpc_drives_a_custom_vehicle_class():
    """The omni robot can drive sideways: it corrects 20 cm and 30° while its heading follows the route."""
    file = load("examples/omni_robot.toml")
    poses, u = drive(law(file), file, line(2.0, 0.2), (0.0, 0.2, 0.5), 6.0)
    assert np.max(np.abs(poses[100:, 1:])) < 0.02  # after 40 cm
    assert np.all(np.abs(u) <= file.command.limit + 1e-9)
    assert np.ptp(u, axis=0).min() > 0.05  # all three wheels


def test_no_command_exceeds_the_limit_of_its_motor():
    _, u = drive(law(), SMALL, line(4.0, 2.0), (0.0, 0.1, 0.5), 2.0)
    wheels = np.abs(u[:, 0]) + np.abs(u[:, 2])
    assert np.max(wheels) <= 1.0 + 1e-9
    assert np.median(wheels) > 0.9  # the route is too fast, so the full command is used


def test_mpc_does_not_cross_a_wall():
    """The route leads 0.5 m beyond the wall; without the wall the vehicle follows it."""
    route = line(1.5, 0.25)
    free, _ = drive(law(), SMALL, route, (0.0, 0.0, 0.0), 6.0)
    eta, _ = drive(law(wall_high=np.array([1.0, np.inf])), SMALL, route, (0.0, 0.0, 0.0), 6.0)
    assert np.max(free[:, 0]) > 1.4
    assert np.max(eta[:, 0]) < 1.01


def test_mpc_stays_on_its_path_for_a_lap():
    """At the rate of the file and with its estimator, MPC stays nearer to the reference along the path than the
    feed-forward law."""
    run = repeat(SMALL, sinuous_circle(0.6, 0.08, 5, 0.2), controller=Mpc, duration_s=6.0, rest_s=0.0)
    assert run.estimate is not None
    assert run.reference is not None
    error = run.estimate.eta - run.reference.eta
    psi = run.reference.eta[:, 2]
    forward, sideways = (
        np.array([[np.cos(psi), np.sin(psi)], [-np.sin(psi), np.cos(psi)]]) * error[:, :2].T
    ).sum(axis=1)
    assert np.sqrt(np.mean(sideways**2)) < 0.004
    assert np.sqrt(np.mean(forward[200:] ** 2)) < 0.006


def test_mpc_follows_its_old_plan_after_a_solver_failure_and_then_stops(monkeypatch):
    controller, at_rest = law(), Estimate(0, np.zeros(3), np.zeros(3), np.eye(6))
    target = Reference(0, np.array([0.3, 0.0, 0.0]), np.zeros(3), 0.0)
    state, first = controller.step(controller.init(), target, at_rest)
    monkeypatch.setattr(BoundedProgram, "solve", lambda *_: None)
    for k in range(1, 11):
        t_ns = k * 20_000_000
        state, command = controller.step(state, target._replace(t_ns=t_ns), at_rest._replace(t_ns=t_ns))
        assert state.failures == k
        assert np.isfinite(command.u).all()
    assert first.u[0] > 0.3
    with refused("mpc.unsolved", Invalid, ticks=11):
        controller.step(state, target._replace(t_ns=10**9), at_rest._replace(t_ns=10**9))


def test_a_solver_failure_is_logged_in_the_run(monkeypatch):
    solve, calls = BoundedProgram.solve, []

    def fails_twice(self, *args):
        calls.append(1)
        return None if len(calls) in (20, 21, 40) else solve(self, *args)

    monkeypatch.setattr(BoundedProgram, "solve", fails_twice)
    run = repeat(SMALL, line(1.0, 0.2), controller=Mpc, duration_s=1.0, rest_s=0.0)
    events = [event for event in run.events if event.source == "controller"]
    assert [(event.diagnostic.code, event.level) for event in events] == [("mpc.old-plan", "warning")] * 2
    assert np.diff([event.t_ns for event in events]) == pytest.approx(20e9 / SMALL.rate_hz)
    assert drive_stop_reason(run) is None


AS_WRITTEN = ("simulate.as-written", {"role": "controller", "block": "Mpc"})


@pytest.mark.parametrize(
    ("use", "code", "figures"),
    [
        (lambda file, route: simulate_loop(file, route), *AS_WRITTEN),
        (lambda file, route: tune(file, route), "tune.as-written", {"controller": "Mpc"}),
        (lambda file, route: bq.forecast(file, route), *AS_WRITTEN),
        (lambda file, route: driving(1, controller="mpc"), *AS_WRITTEN),
    ],
    ids=["simulate_loop", "tune", "forecast", "study driving"],
)
def test_functions_that_need_a_compiled_step_refuse_mpc(use, code, figures):
    with refused(code, UsageError, **figures):
        use(SMALL.with_values({"controller.kind": "mpc"}), circle(0.3, 0.2))


def test_a_closed_loop_with_uncompiled_mpc_is_simulated():
    file = SMALL.with_values({"controller.kind": "mpc"})
    run = simulate_loop(file, circle(0.3, 0.2), duration_s=0.2, perfect=True, backend="numpy")
    assert run.truth.nu[-1, 0] > 0.02


def test_a_missing_solver_is_reported_with_the_install_command(monkeypatch):
    monkeypatch.setitem(sys.modules, "osqp", None)
    target = Reference(0, np.array([0.3, 0.0, 0.0]), np.zeros(3), 0.0)
    with refused("mpc.no-solver", UsageError):
        controller = law()
        controller.step(controller.init(), target, Estimate(0, np.zeros(3), np.zeros(3), np.eye(6)))


def test_a_limit_of_wrong_length_is_refused():
    with refused("field.limit", Invalid):
        replace(law(), limit=np.ones(2))


@pytest.mark.parametrize("turn_deg", [60.0, -60.0])
def test_a_car_beside_its_reference_does_not_race_back(turn_deg):
    car = load("car")
    law = car.controller("mpc")
    eta = np.array([0.0, 0.3, np.radians(turn_deg)])
    world, state, speed = SimulatedWorld(car.vehicle, car.sensors, car.rate_hz, eta0=eta), law.init(), []
    for k in range(1, 150):
        t_ns = k * 20_000_000
        pose = Estimate(t_ns, world.truth.eta, world.truth.nu, np.eye(6))
        target = Reference(t_ns, np.array([0.01 * k, 0.0, 0.0]), np.array([0.5, 0.0, 0.0]), 0.0)
        state, command = law.step(state, target, pose)
        world.write(command)
        world.read(t_ns)
        speed.append(abs(world.truth.nu[0]))
    assert max(speed) < 0.9  # v_max is 0.8


def test_a_turned_car_stands_after_the_end_of_its_drive():
    """Before, a car that ended its drive turned by 1 rad drove to and fro for 2 s, over 0.5 m."""
    controller, turned_estimate = law(CAR), Estimate(0, np.array([0.0, 0.0, 1.0]), np.zeros(3), np.eye(6))
    for done, is_moving in ((0.0, True), (1.0, False)):
        _, command = controller.step(
            controller.init(), Reference(0, np.zeros(3), np.zeros(3), done), turned_estimate
        )
        assert np.any(command.u != 0.0) == is_moving
