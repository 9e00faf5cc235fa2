"""The noise of a taught route: it is measured, and smoothing is advised with a tolerance."""

import numpy as np
import pytest

from baqueano.guides.shapes import circle, eight, line, rectangle, sinuous_circle
from baqueano.routes import examine, smooth
from baqueano.routes.noise import position_noise

DRAWN = (circle(0.5, 0.2), eight(0.6, 0.2), sinuous_circle(0.6, 0.08, 5, 0.2))


def noisy(route, noise_m, hold=1, seed=0):
    """Return the route with noise of its positions at every `hold`-th pose, interpolated between them."""
    m = len(route.t_s)
    knots = np.append(np.arange(0, m - 1, hold), m - 1)
    noise = np.random.default_rng(seed).normal(0.0, noise_m, (len(knots), 2))
    eta = route.eta.copy()
    for k in range(2):
        eta[:, k] += np.interp(np.arange(m), knots, noise[:, k])
    return route._replace(eta=eta)


@pytest.mark.parametrize(
    "route", [circle(0.5, 0.2), eight(0.6, 0.2), sinuous_circle(0.6, 0.08, 5, 0.2)], ids=str
)
@pytest.mark.parametrize("noise_m", [0.003, 0.01])
def test_the_noise_of_a_route_is_measured(route, noise_m):
    assert position_noise(noisy(route, noise_m)) == pytest.approx(noise_m, rel=0.15)


def test_the_noise_of_a_slow_camera_is_measured_between_interpolated_poses():
    assert 0.006 < position_noise(noisy(circle(0.5, 0.2), 0.01, hold=4)) < 0.014


@pytest.mark.parametrize("route", [line(2.0, 0.2), rectangle(1.2, 0.8, 0.2, 0.2), *DRAWN], ids=str)
def test_a_drawn_route_with_a_jump_or_few_poses_is_not_noisy(route):
    sparse = route._replace(t_s=route.t_s[::12], eta=route.eta[::12], nu=route.nu[::12])
    jump = route._replace(eta=route.eta + 0.03 * (np.arange(len(route.t_s)) > 80)[:, None])
    assert max(map(position_noise, (route, sparse, jump))) < 1e-4


def test_a_noisy_route_is_advised_to_be_smoothed_with_a_tolerance_that_removes_the_noise():
    route = noisy(circle(0.5, 0.2), 0.01)
    (finding,) = (f for f in examine(route).findings if f.code == "route.noisy")
    tolerance_m = float(finding.fix.split()[-1])
    assert tolerance_m == pytest.approx(0.01 * np.sqrt(2.0), abs=0.002)
    smooth_route = smooth(route, tolerance_m, "rms")
    assert "route.noisy" not in [f.code for f in examine(smooth_route).findings]
    away_m = np.hypot(smooth_route.eta[:, 0], smooth_route.eta[:, 1] - 0.5) - 0.5
    assert np.sqrt(np.mean(away_m**2)) < 0.005
    assert np.max(np.abs(smooth_route.nu[:, 2] / smooth_route.nu[:, 0])) < 8.0  # before, it was 23 1/m


def test_a_smooth_route_with_uneven_times_is_not_noisy():
    """A run at 20 Hz with ticks of 40 and 60 ms was taken for a noise of 4.5 mm."""
    route = circle(1.0, 0.5)
    indices = np.sort(np.concatenate([np.arange(0, 1440, 10), np.arange(4, 1440, 10)]))
    uneven = route._replace(t_s=route.t_s[indices], eta=route.eta[indices], nu=route.nu[indices])
    assert position_noise(uneven) < 1e-4
    assert position_noise(noisy(uneven, 0.01)) == pytest.approx(0.01, rel=0.15)
