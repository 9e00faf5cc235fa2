"""Routes of poses over distance, written by hand or by another program."""

import numpy as np
import pytest

from baqueano.errors import FileError
from baqueano.guides.shapes import circle, eight, rectangle
from baqueano.routes.path import distances_along
from baqueano.runs.route_file import read_route
from tests.codes import refused

HEAD = "# closed = false\ns_m,x_m,y_m,psi_rad,v_m_s"


def written_route(path, rows, head=HEAD):
    path.write_text("\n".join([head, *rows]) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize("route", [circle(0.5, 0.2), eight(0.6, 0.2), rectangle(1.2, 0.8, 0.2, 0.2)])
def test_a_route_over_distance_equals_the_route_over_time(tmp_path, route):
    rows = np.column_stack([distances_along(route.eta[:, :2]), route.eta, route.nu[:, 0]]).tolist()
    second = read_route(written_route(tmp_path / "r.csv", [",".join(map(repr, row)) for row in rows]))
    np.testing.assert_array_equal(second.eta, route.eta)
    np.testing.assert_allclose(second.t_s, route.t_s, rtol=1e-4)
    # half a step of a corner's yaw rate
    np.testing.assert_allclose(second.nu[1:-1, 2], route.nu[1:-1, 2], atol=0.51)
    assert np.median(np.abs(second.nu[:, 2] - route.nu[:, 2])) < 1e-3


def test_speed_changes_stops_and_turns_in_place_have_correct_durations(tmp_path):
    rows = [
        "0,0,0,0,0,0",
        "0.1,0.1,0,0,0.2,0",
        "0.3,0.3,0,0,0.2,3",
        "0.5,0.5,0,0,0.2,0",
        "0.5,0.5,0,1.5,0.2,0",
    ]
    route = read_route(written_route(tmp_path / "r.csv", rows, HEAD + ",wait_s"))
    np.testing.assert_allclose(route.t_s, [0.0, 1.0, 2.0, 5.0, 6.0, 7.5])
    np.testing.assert_array_equal(route.eta[2], route.eta[3])
    assert np.all(route.nu[2:4] == 0.0)
    assert not route.closed


@pytest.mark.parametrize(
    ("code", "rows"),
    [
        ("route.way", ["0,0,0,0,0.2", "0.2,0.2,0,0,0.2", "0.1,0.3,0,0,0.2"]),
        ("route.way", ["0,0,0,0,0", "0.2,0.2,0,0,0"]),
        ("route.not-number", ["0,0,0,0,0.2", "0.2,nan,0,0,0.2"]),
        ("route.too-short", ["0,0,0,0,0.2"]),
        ("route.too-short", ["0,0,0,0,0.2", "0,0,0,0,0.2"]),
    ],
)
def test_an_invalid_route_over_distance_is_refused(tmp_path, code, rows):
    with refused(code, FileError):
        read_route(written_route(tmp_path / "r.csv", rows))
