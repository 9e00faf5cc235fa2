"""A taught lap that is repeated does not stop at its start."""

import numpy as np
import pytest

from baqueano.guides.route import Route, with_flying_start

T_S = np.linspace(0.0, 10.0, 201)
START = Route(T_S, np.zeros((201, 3)), np.zeros((201, 3)), True)


def with_speed(v, psi):
    return START._replace(
        eta=np.column_stack([np.zeros((201, 2)), psi]),
        nu=np.column_stack([v, 0.0 * v, np.gradient(psi, T_S)]),
    )


def test_the_lap_starts_at_its_end_speed_instead_of_rest():
    v = np.minimum(T_S, 1.0) * 0.2  # one second of acceleration
    path_m = np.append(0.0, np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(T_S)))
    route = with_flying_start(with_speed(v, 2.0 * np.pi * path_m / path_m[-1]))
    assert route.nu[:, 0] == pytest.approx(0.2)
    assert route.nu[1:-1, 2] == pytest.approx(0.2 * 2.0 * np.pi / path_m[-1], rel=0.02)
    assert np.diff(path_m) / np.diff(route.t_s) == pytest.approx(0.2)
    assert np.all(np.diff(route.t_s) > 0.0)


def test_a_route_that_ends_at_rest_is_unchanged():
    v = np.full(201, 0.2)
    v[[0, -1]] = 0.0
    route = with_speed(v, 0.1 * T_S)
    assert with_flying_start(route) is route


def test_a_route_that_starts_turning_in_place_is_unchanged():
    route = with_speed(np.where(T_S < 1.0, 0.0, 0.2), np.minimum(T_S, 1.0) * 3.0)
    assert with_flying_start(route) is route


def test_a_faster_last_part_does_not_change_the_duration_of_the_lap():
    v = np.where(T_S < 8.0, 0.2, 0.4)
    v[0] = 0.0
    route = with_flying_start(with_speed(v, 0.1 * T_S))
    assert route.t_s[-1] == pytest.approx(10.0, abs=0.1)


def test_a_start_in_a_curve_and_a_speed_that_fluctuates_are_driven_through():
    """Before, both were taken for a turn on the spot, and each lap began from rest."""
    v = np.minimum(T_S / 3.0, 1.0) * 0.3 - 0.002 * (T_S > 3.0) * np.cos(T_S) ** 2
    v[-1] = 0.3
    path_m = np.append(0.0, np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(T_S)))
    route = with_flying_start(with_speed(v, path_m / 0.3))
    assert route.nu[:, 0] == pytest.approx(0.3, abs=0.003)
    assert np.diff(path_m) / np.diff(route.t_s) == pytest.approx(0.3, abs=0.003)
