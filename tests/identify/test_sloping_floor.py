"""A floor that slopes is named, and the options of its message give the slope and its direction.

The cart of these drives has its own equations, which are integrated in steps of 1 ms.
"""

from itertools import pairwise
from math import cos, sin

import numpy as np
import pytest

from baqueano.geometry import wrap
from baqueano.identify import identify
from baqueano.runs.logs import Channel
from baqueano.runs.run import Run
from baqueano.vehicle_file import parse

TICKS, TICK_STEPS, STEP_S = 900, 20, 1e-3
MASS_KG, INERTIA_KG_M2, HALF_TRACK_M, GRAVITY = 1.4, 0.012, 0.09, 9.80665
FILE = """
format = 1
name = "cart"
rate_hz = 50.0
[command]
names = ["u_x", "u_y", "u_psi"]
limit = [1.0, 0.0, 1.0]
[geometry]
track_m = 0.18
[model]
kind = "planar"
mass_kg = 1.4
inertia_kg_m2 = 0.012
actuator_matrix = [[5.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.5]]
[model.friction]
linear = [4.0, 80.0, 0.06]
[sensors.imu]
kind = "imu"
[sensors.wheels]
kind = "wheels"
"""


def acceleration(x, u, slope_rad, uphill_rad):
    """Return gravity along the body and to its left, and the acceleration (ν_x, ν_y, ν_ψ) of a cart."""
    _, _, psi, v, side, w = x
    down = -GRAVITY * sin(slope_rad) * np.array([cos(uphill_rad - psi), sin(uphill_rad - psi)])
    force = np.array([6.8 * u[0] - 3.1 * v, -60.0 * side])
    return down, np.array(
        [*(force / MASS_KG + down + w * np.array([side, -v])), (0.6 * u[1] - 0.05 * w) / INERTIA_KG_M2]
    )


def x_dot(x, *conditions):
    _, _, psi, v, side, w = x
    map_speed = [v * cos(psi) - side * sin(psi), v * sin(psi) + side * cos(psi)]
    return np.array([*map_speed, w, *acceleration(x, *conditions)[1]])


def drive(slope_rad, uphill_rad):
    rng, x, imu, wheels = np.random.default_rng(2), np.zeros(6), [], []
    u = np.repeat(rng.uniform(-1.0, 1.0, (TICKS // 30, 2)) * [0.9, 0.5], 30, axis=0)
    for command in u:
        conditions = (command, slope_rad, uphill_rad)
        for _ in range(TICK_STEPS):  # the midpoint rule
            x = x + STEP_S * x_dot(x + 0.5 * STEP_S * x_dot(x, *conditions), *conditions)
        down, (v_dot, side_dot, _) = acceleration(x, *conditions)
        v, side, w = x[3:]
        imu.append([v_dot - w * side - down[0], side_dot + w * v - down[1], w])
        wheels.append([v - HALF_TRACK_M * w, v + HALF_TRACK_M * w])
    t_ns = np.arange(1, TICKS + 1) * round(1e9 * TICK_STEPS * STEP_S)
    readings = {
        "imu": np.array(imu) + rng.normal(0.0, [0.08, 0.08, 0.004], (TICKS, 3)),
        "wheels": np.array(wheels) + rng.normal(0.0, 0.01, (TICKS, 2)),
    }
    channels = {name: Channel(t_ns, t_ns, z) for name, z in readings.items()}
    return Run("slope", None, t_ns, np.insert(u, 1, 0.0, axis=1), sensors=channels)


@pytest.mark.parametrize("uphill_rad", [2.5, -1.2])
def test_a_sloping_floor_is_named_and_the_advice_gives_its_slope_and_direction(uphill_rad):
    run, file = drive(0.035, uphill_rad), parse(FILE, "cart.toml")
    fit = identify(run, file)
    reasons = [reason for reason in fit.reasons if reason.code == "residual.missing-free"]
    assert fit.verdict == "WARN"
    assert reasons[0].figures["effect"].code == "term.slope"
    words = reasons[0].fix.split()
    free = [word for option, word in pairwise(words) if option == "--free"]
    start = dict(word.split("=") for option, word in pairwise(words) if option == "--set")
    at_start = file.with_values({key: float(value) for key, value in start.items()})
    fit = identify(run, at_start, free)
    assert fit.verdict == "USABLE", fit.reasons
    slope_rad, heading_rad = (fit.names.index(name.removeprefix("+")) for name in free)
    assert abs(fit.estimate[slope_rad] - 0.035) < 4.0 * fit.std[slope_rad] < 0.004
    assert abs(wrap(fit.estimate[heading_rad] - uphill_rad)) < 4.0 * fit.std[heading_rad] < 0.2


def test_a_level_floor_is_not_called_a_slope():
    fit = identify(drive(0.0, 0.0), parse(FILE, "cart.toml"))
    assert fit.verdict == "USABLE", fit.reasons
