"""Parts of a route with an unknown path are refused; drawn and edited routes do not have such parts."""

from pathlib import Path

import numpy as np
import pytest

from baqueano.drive import repeat
from baqueano.errors import UsageError
from baqueano.guides.route import Route
from baqueano.guides.shapes import circle, clothoid, eight, line, rectangle, sinuous_circle, slalom
from baqueano.messages.notation import python_call
from baqueano.routes import cut, examine, fastest, join, reverse, scale, smooth
from baqueano.routes.path import direction
from baqueano.vehicle_file import load
from tests.codes import refused


def cut_out(route, first, last):
    keep = np.r_[0:first, last : len(route.t_s)]
    return Route(route.t_s[keep], route.eta[keep], route.nu[keep], route.closed)


def codes(route):
    return [finding.code for finding in examine(route).findings]


def test_missing_samples_on_a_straight_line_are_a_gap():
    (gap,) = examine(cut_out(line(2.0, 0.2), 50, 100)).findings
    assert gap.code == "route.gap"
    figures = {"position_m": 0.49, "gap_m": 0.51, "gap_s": 2.55, "count": 1}
    assert {name: gap.figures[name] for name in figures} == pytest.approx(figures)


def test_a_chord_across_a_circle_is_a_gap():
    lap = circle(0.5, 0.2)
    (gap,) = examine(cut_out(lap, 200, 920)).findings
    assert gap.code == "route.gap"
    assert gap.figures["gap_m"] == pytest.approx(1.0, abs=0.01)


def test_sparse_poses_are_a_gap_only_if_the_heading_changes_too_much():
    lap = circle(0.5, 0.2)
    for step, expected in ((240, ["route.gap"]), (60, [])):  # arcs of 60°, 7 cm high; of 15°
        assert codes(Route(lap.t_s[::step], lap.eta[::step], lap.nu[::step], True)) == expected


@pytest.mark.parametrize("name", ["t_s", "eta", "nu"])
def test_a_value_that_is_not_finite_is_reported_with_its_row(name):
    lap = circle(0.5, 0.2)
    rows = getattr(lap, name).copy()
    rows[30:32] = np.nan
    (finding,) = examine(lap._replace(**{name: rows}), load("small")).findings
    assert (finding.code, finding.figures) == ("route.no-number", {"row": 31, "count": 2})


def test_a_stop_or_a_start_from_rest_is_not_a_gap():
    route = line(1.0, 0.2)
    t_s = np.append(route.t_s[:50], route.t_s[50:] + 4.0)
    waits = route._replace(t_s=t_s, nu=np.where(np.arange(101)[:, None] == 49, 0.0, route.nu))
    assert codes(waits) == []
    assert codes(fastest(line(2.0, 0.1), load("small"))) == []


def test_a_closed_route_whose_ends_are_apart_is_refused_and_its_advised_cut_is_open():
    part = cut(circle(0.5, 0.2), to_m=1.0)._replace(closed=True)  # the last rows of the file were deleted
    assert codes(part) == ["route.open-ends"]
    open_route = cut(part, from_m=0.0)
    assert not open_route.closed
    assert codes(open_route) == []


def advised_cut(route, fix):
    """Return the part of a route that the advised command line keeps."""
    *_, option, value = fix.split()
    return cut(route, **{{"--from": "from_m", "--to": "to_m"}[option]: float(value)})


@pytest.mark.parametrize("k", [1, 50, 70, 200])
def test_the_advised_cut_removes_a_jump_or_a_change_of_direction(k):
    scaled_line = scale(line(2.0, 0.2), 0.97)  # a pose every 9.7 mm, so that some distances are rounded up
    jump = scaled_line._replace(
        eta=scaled_line.eta + np.where(np.arange(len(scaled_line.t_s)) < k, 0.0, 0.5)[:, None] * [1, 0, 0]
    )
    assert codes(jump) == ["route.jump"]
    assert codes(advised_cut(jump, examine(jump).findings[0].fix)) == []
    two_ways = scaled_line._replace(
        nu=np.where(np.arange(len(scaled_line.t_s)) < k, 1.0, -1.0)[:, None] * scaled_line.nu
    )
    with pytest.raises(UsageError) as error:
        direction(two_ways)
    assert abs(direction(advised_cut(two_ways, error.value.diagnostic.fix))) == 1.0


DRAWN = {
    "circle": circle(0.5, 0.2), "eight": eight(0.6, 0.2), "rectangle": rectangle(1.2, 0.8, 0.2, 0.2),
    "line": line(2.0, 0.2), "slalom": slalom(2.0, 0.3, 3, 0.2), "clothoid": clothoid(1.0, 1.5, 0.2),
    "sinuous": sinuous_circle(0.6, 0.08, 5, 0.2),
}  # fmt: skip


@pytest.mark.parametrize("name", DRAWN)
def test_drawn_and_edited_routes_have_no_gaps(name):
    route = DRAWN[name]
    part = cut(route, 0.1, 0.9)
    for edited_route in (route, smooth(route), reverse(route), scale(route, 3.0), part, join(part, part)):
        assert codes(edited_route) == []


def sideways(route, heading_rad):
    """Return a route driven with a constant heading, as by a vehicle that can move along all axes."""
    turned_headings = np.full(len(route.t_s), heading_rad)
    return route._replace(eta=np.column_stack([route.eta[:, :2], turned_headings]))


def test_a_sideways_route_is_only_for_a_vehicle_with_a_command_that_moves_it_sideways():
    omni = load(Path(__file__).parents[2] / "examples" / "omni_robot.toml")
    for heading_rad, limits in ((0.5 * np.pi, (-0.21, -0.19)), (-0.5 * np.pi, (0.19, 0.21))):
        route = sideways(line(1.0, 0.2), heading_rad)
        for name in ("small", "car"):
            (finding,) = examine(route, load(name)).findings
            assert finding.code == "route.sideways"
            assert limits[0] < finding.figures["speed_m_s"] < limits[1]
        assert not examine(route, omni).findings


def test_a_slip_and_an_origin_beside_the_axle_are_not_sideways_motion():
    slow_circle, car = circle(0.5, 0.2), load("car")
    turned_headings = slow_circle.eta + np.array([0.0, 0.0, np.radians(40.0)])
    assert not examine(slow_circle._replace(eta=turned_headings), car).findings
    turn = np.linspace(0.0, np.pi, 200)
    # an origin 0.1 m ahead of the axle
    spin = np.column_stack([0.1 * np.cos(turn), 0.1 * np.sin(turn), turn])
    route = Route(turn, spin, np.tile([0.0, 0.1, 1.0], (200, 1)), False)
    assert not examine(route, load("small")).findings


@pytest.mark.parametrize(("row", "at_m"), [(0, 0.0), (75, 0.75)])
def test_a_heading_that_turns_at_once_is_refused_with_a_cut_that_mends_the_route(row, at_m):
    route = line(2.0, 0.25)
    eta = route.eta.copy()
    eta[: row + 1, 2] = np.radians(90.0)
    (finding,) = examine(route._replace(eta=eta)).findings
    assert (finding.code, finding.figures["count"]) == ("route.sudden-turn", 1)
    assert finding.figures["position_m"] == pytest.approx(at_m, abs=0.01)
    assert finding.figures["turn_deg"] == pytest.approx(-90.0)
    *_, side, distance = finding.fix.split()
    ends = {"--from": {"from_m": float(distance)}, "--to": {"to_m": float(distance)}}[side]
    assert not examine(cut(route._replace(eta=eta), **ends)).findings


@pytest.mark.parametrize("factor", [0.0, -1.0, 3.0])
def test_velocities_that_disagree_with_the_poses_are_refused_with_a_call_that_corrects_them(factor):
    lap = circle(0.6, 0.25)
    report = examine(lap._replace(nu=factor * lap.nu), load("small"))
    (finding,) = [f for f in report.findings if f.code == "route.otherwise"]
    assert finding.figures["speed_m_s"] == pytest.approx(0.25, rel=0.02)
    assert finding.figures["velocity_m_s"] == pytest.approx(0.25 * factor, abs=0.02)
    assert python_call(finding.fix) == "route = bq.routes.at_speed(route, 0.25)"


def test_times_that_decrease_and_a_single_pose_are_refused():
    lap = circle(0.6, 0.25)
    t_s = lap.t_s.copy()
    t_s[700] = t_s[698]
    (finding, *_) = examine(lap._replace(t_s=t_s), load("small")).findings
    assert (finding.code, finding.figures["row"]) == ("route.time-order", 701)
    with refused("route.shapes", UsageError):
        repeat(load("small"), Route(lap.t_s[:1], lap.eta[:1], lap.nu[:1], False))
