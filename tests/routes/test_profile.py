"""The fastest speed along a path: equal to hand calculations, and reached by the simulated vehicle."""

import tracemalloc

import numpy as np
import pytest

from baqueano.compare.errors import cross_track
from baqueano.controllers import PdFeedforward
from baqueano.errors import UsageError
from baqueano.guides.route import Route
from baqueano.guides.shapes import circle, clothoid, line, rectangle, sinuous_circle
from baqueano.routes import at_speed, examine, fastest, scale
from baqueano.routes.capability import Capability
from baqueano.simulate.closed_loop import simulate_loop
from baqueano.vehicle_file import load
from tests.codes import refused
from tests.memory import memory_trace


class Block:
    """A vehicle file of a mass without friction and dead zone."""

    def __init__(self, vehicle, limit):
        self.vehicle = vehicle
        self.command = type("Command", (), {"limit": limit})


@pytest.fixture(scope="module")
def ice():
    """Return a vehicle with a force of 1 N per unit of command on 1 kg: 1 m/s² at full command."""
    from baqueano.vehicles import Planar

    return Block(Planar(1.0, 0.01, np.diag([1.0, 0.0, 0.02])), np.array([1.0, 0.0, 1.0]))


def test_without_friction_acceleration_and_braking_are_constant(ice):
    """L = a T² / 4 for a vehicle that accelerates over the first half and brakes over the second."""
    for share in (0.5, 1.0):
        route = fastest(line(2.0, 0.1), ice, command_share=share)
        assert route.t_s[-1] == pytest.approx(2.0 * np.sqrt(2.0 / share), rel=0.03)
        assert np.max(route.nu[:, 0]) == pytest.approx(np.sqrt(2.0 * share), rel=0.02)


def test_the_speed_in_a_curve_is_limited_by_the_tyres(ice):
    """v² / R = a_y on a circle, where no other limit applies."""
    route = fastest(circle(0.5, 0.1), ice, lateral_m_s2=0.32)
    np.testing.assert_allclose(route.nu[:, 0], 0.4, rtol=0.01)


def test_a_fastest_lap_ends_at_its_start_speed(ice):
    route = fastest(rectangle(1.2, 0.8, 0.2, 0.2), load("small"))
    assert route.closed
    assert route.nu[0, 0] == pytest.approx(route.nu[-1, 0], rel=0.05)
    assert np.all(np.diff(route.t_s) > 0.0)


@pytest.mark.parametrize("name", ["small", "car"])
def test_the_computed_share_of_the_command_maintains_the_speed(name):
    """Under the command that corresponds to the share, the vehicle maintains the speed in its own step."""
    file = load(name)
    can = Capability(file)
    v = can.fastest_speed(np.zeros(1), np.full(1, 100.0))[0]
    u = np.zeros(file.vehicle.commands)
    u[0] = file.command.limit[0]
    state = file.vehicle.init(nu=np.array([v, 0.0, 0.0]))
    for _ in range(3000):
        state, _ = file.vehicle.step(state, u, 0.01, np.zeros(3))
    assert state.nu[0] == pytest.approx(v, rel=0.05)


@pytest.mark.parametrize(
    "lap", [rectangle(1.6, 1.0, 0.3, 0.2), sinuous_circle(0.6, 0.08, 5, 0.2)], ids=["rectangle", "sinuous"]
)
def test_wheels_saturate_on_a_lap_faster_than_the_fastest_lap(lap):
    """The recommended controller is simulated: at 0.8 of the command no wheel saturates. On a lap 40 % faster,
    wheels saturate where the lap needs most."""
    file = load("small")
    route = fastest(lap, file)
    shares = []
    for factor in (1.0, 1.4):
        scaled_route = route._replace(t_s=route.t_s / factor, nu=route.nu * factor)
        run = simulate_loop(
            file, scaled_route, laps=3, controller=PdFeedforward(file.vehicle, limit=file.command.limit)
        )
        assert run.requested_commands is not None
        middle_lap = run.requested_commands[len(run.t_ns) // 3 : 2 * len(run.t_ns) // 3]
        wheels = np.abs(middle_lap[:, 0]) + np.abs(middle_lap[:, 2])
        shares.append(np.mean(wheels > 0.97))
    assert shares[0] < 0.02
    assert shares[1] > 0.1


def test_examine_finds_a_short_part_that_is_too_fast_in_half_an_hour_of_driving():
    """A gap of 0.7 s between two samples of the check would hide it."""
    t_s, v = np.arange(0.0, 1800.0, 0.05), np.full(36_000, 0.2)
    v[13_320:13_334] = 2.0
    x = np.append(0.0, np.cumsum(0.05 * v[:-1]))
    eta, nu = (np.column_stack([column, 0.0 * v, 0.0 * v]) for column in (x, v))
    report = examine(Route(t_s, eta, nu, False), load("small"))
    assert [finding.code for finding in report.findings] == ["route.speed-too-high"]
    assert report.findings[0].figures["position_m"] == pytest.approx(x[13_326], abs=0.7)


def test_examine_of_a_route_of_a_nanosecond_needs_little_memory():
    eta = np.array([[0.0, 0.0, 0.0], [1e-10, 0.0, 0.0]])
    route = Route(np.array([0.0, 1e-9]), eta, np.full((2, 3), [0.1, 0.0, 0.0]), False)
    with memory_trace():
        examine(route, load("small"))
        assert tracemalloc.get_traced_memory()[1] < 100e6


def test_examine_reports_where_the_route_needs_too_much_yaw_rate():
    small = load("small")
    tight = at_speed(clothoid(1.0, np.pi, 0.2), 0.45)
    report = examine(tight, small)
    (finding,) = report.findings
    assert finding.code == "route.turns-too-fast"
    assert 0.3 < finding.figures["position_m"] < 0.7
    assert finding.figures["max_rad_s"] < finding.figures["demand_rad_s"] <= report.max_yaw_rate_rad_s
    assert not examine(fastest(tight, small), small).findings
    assert examine(circle(0.3, 2.0), small).findings[0].code == "route.speed-too-high"


def test_a_curve_that_a_car_cannot_drive_at_any_speed_is_refused_with_its_radius():
    """Before, a slower drive was advised, which `faster` then refused."""
    (finding,) = examine(circle(0.2, 0.8), load("car")).findings
    assert finding.code == "route.curve-too-tight"
    assert finding.figures["radius_m"] == pytest.approx(0.2, abs=0.01)
    # of the steering alone: wheelbase / tan(0.47), from the middle
    assert 0.25 < finding.figures["min_radius_m"] < 0.35
    assert examine(circle(0.5, 2.8), load("car")).findings[0].code == "route.turns-too-fast"


def test_a_jump_is_reported_with_its_place():
    route = circle(0.5, 0.2)
    eta = route.eta.copy()
    eta[700:, 0] += 0.4
    (finding,) = examine(route._replace(eta=eta)).findings
    assert finding.code == "route.jump"
    assert finding.figures["gap_m"] == pytest.approx(0.4, abs=0.01)
    assert finding.figures["t_s"] == pytest.approx(route.t_s[699], abs=0.02)


def test_the_route_is_checked_against_the_walls_of_the_room():
    from baqueano.routes.room import vehicle_room

    small = load("small")
    lap = circle(0.5, 0.2)  # 1 m wide and to the left of its start
    assert examine(lap, small, vehicle_room(small, "1.5x3")).clearance_m == pytest.approx(
        0.75 - 0.07 - 0.5, abs=1e-3
    )
    (finding,) = examine(lap, small, vehicle_room(small, "2x2")).findings
    assert finding.code == "route.through-wall"
    assert " -0." not in examine(lap, small, vehicle_room(small, "2x2")).table()
    assert finding.figures["excess_m"] == pytest.approx(1.0 - 0.93, abs=1e-3)
    factor = float(finding.fix.split()[-1])
    assert not examine(scale(lap, factor), small, vehicle_room(small, "2x2")).findings
    assert examine(scale(lap, factor + 0.02), small, vehicle_room(small, "2x2")).findings
    assert not examine(lap, small, vehicle_room(small, "2x2", start=(0.0, -0.5, 0.0))).findings


def test_limits_out_of_range_are_refused():
    small, lap = load("small"), circle(0.5, 0.2)
    with refused("route.limit", UsageError):
        fastest(lap, small, command_share=1.5)
    with refused("route.speed", UsageError):
        fastest(lap, small, speed_m_s=0.0)
    with refused("route.too-tight", UsageError, command_share=0.01) as refusal:
        fastest(lap, small, command_share=0.01)
    assert "--command-share" in refusal.value.diagnostic.fix


def test_a_curve_that_needs_more_than_the_default_share_is_refused_with_a_share_that_is_enough():
    """Before, the curve was called too small for the vehicle, and smoothing was advised, which does not help."""
    car, lap = load("car"), circle(0.335, 0.2)
    with refused("route.too-tight", UsageError, command_share=0.8) as refusal:
        fastest(lap, car)
    share = float(refusal.value.diagnostic.fix.split("--command-share ")[1])
    assert 0.8 < share < 1.0
    assert fastest(lap, car, command_share=share).nu[:, 0].min() > 0.1
    with refused("route.too-tight", UsageError) as refusal:
        fastest(circle(0.2, 0.2), car)
    assert "smooth" in refusal.value.diagnostic.fix


def test_the_table_of_a_straight_route_has_no_line_about_curves():
    straight, curve = (
        len(examine(route).table().splitlines()) for route in (line(1.0, 0.2), circle(0.5, 0.2))
    )
    assert straight == curve - 1


@pytest.mark.parametrize("shape", [line(6.0, 0.5), clothoid(6.0, 1.57, 0.5)])
def test_a_car_follows_its_fastest_route_and_ends_it_slowly(shape):
    """Before, the route braked with 11 m/s², but the controllers limit their reference to 1: the end at 2.8 m/s."""
    car = load("car")
    route = fastest(shape, car)
    run = simulate_loop(car, route, perfect=True, noise=False)
    distance = cross_track(run.t_ns, run.truth.eta[:, :2], run.t_ns, run.reference.eta[:, :2])
    assert np.abs(distance).max() < 0.03
    assert run.truth.nu[-1, 0] < 0.2
    assert np.hypot(*(run.truth.eta[-1] - route.eta[-1])[:2]) < 0.08
