"""A small robot that no file describes: strong dry friction in each gear, encoders of whole counts at 50 Hz.

The separate simulator has two wheels whose gears resist with 0.9 N and 0.75 N, so one wheel may rest while the other
rolls. The tyres slip a little sideways, and the floor disturbance is autocorrelated. Dead zones have a similar
effect only on a straight line.
"""

import math

import numpy as np
import pytest

from baqueano.runs.run import Channel, Run
from baqueano.selection.choose import choose
from baqueano.validation.held_out import validate
from baqueano.vehicle_file import parse

MASS_KG, INERTIA_KG_M2, TRACK_M, PUSH_N, DRAG, SCRUB, GRIP = 1.4, 0.011, 0.18, 5.2, 3.4, 0.004, 60.0
DRY_N = (0.9, 0.75)
TICK_M = 1.44e-4
FILE = """
format = 1
name = "stranger"
rate_hz = 50.0
[command]
names = ["u_x", "u_y", "u_psi"]
unit = "duty"
limit = [1.0, 0.0, 1.0]
[geometry]
track_m = 0.18
wheel_radius_m = 0.033
[model]
kind = "planar"
mass_kg = 1.4
inertia_kg_m2 = 0.009
actuator_matrix = [[8.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.7]]
[model.friction]
linear = [5.0, 20.0, 0.04]
coulomb_speed = [0.02, 0.02, 0.2]
[model.drivetrain]
mixing = "two_wheels"
[sensors.wheels]
kind = "wheels"
"""
CANDIDATES = ("dry friction forward", "dry friction turning", "dry friction of the wheels", "dead zone")


def drive(seed, seconds=40.0, tick_s=0.02, h=0.002):
    rng = np.random.default_rng(seed)
    count, step, fade = int(seconds / h), round(tick_s / h), math.exp(-h / 0.4)
    kick = (math.sqrt(1.0 - fade**2) * rng.standard_normal((count, 2)) * [0.05, 0.1]).tolist()
    v = side = r = e_x = e_psi = 0.0
    duty, change_s, ways_m = (0.0, 0.0), 1.0, [0.0, 0.0]
    readings, duties_sent = [], []
    for k in range(count):
        if k % step == 0 and k * h >= change_s:
            left, right = rng.uniform(-0.9, 0.9, 2).tolist()
            duty, change_s = (left, left if rng.random() < 0.4 else right), change_s + rng.uniform(0.3, 2.0)
        if k % step == 0:
            duties_sent.append(duty)
        e_x, e_psi = fade * e_x + kick[k][0], fade * e_psi + kick[k][1]
        rolls = (v - 0.5 * TRACK_M * r, v + 0.5 * TRACK_M * r)
        F = [
            PUSH_N * u - DRAG * w - d * math.tanh(w / 0.02)
            for u, w, d in zip(duty, rolls, DRY_N, strict=True)
        ]
        moves = math.tanh(5.0 * (abs(rolls[0]) + abs(rolls[1])))
        v_dot = (F[0] + F[1]) / MASS_KG + r * side + e_x * moves
        side_dot = -GRIP * side / MASS_KG - r * v
        r_dot = (0.5 * TRACK_M * (F[1] - F[0]) - SCRUB * r) / INERTIA_KG_M2 + e_psi * moves
        v, side, r = v + h * v_dot, side + h * side_dot, r + h * r_dot
        ways_m = [x + h * w for x, w in zip(ways_m, rolls, strict=True)]
        if (k + 1) % step == 0:
            readings.append([math.floor(x / TICK_M) * TICK_M for x in ways_m])
    t_ns = np.arange(1, len(readings) + 1, dtype=np.int64) * round(1e9 * tick_s)
    left, right = np.array(duties_sent).T
    u = np.stack([0.5 * (left + right), 0.0 * left, 0.5 * (right - left)], axis=1)
    rate, middle = np.diff(np.array(readings), axis=0) / tick_s, t_ns[1:] - round(0.5e9 * tick_s)
    return Run(f"stranger {seed}", None, t_ns, u, sensors={"wheels": Channel(middle, middle, rate)})


@pytest.fixture(scope="module")
def choice():
    return choose([drive(1), drive(2)], parse(FILE, "stranger.toml"), candidates=CANDIDATES)


def test_wheel_friction_terms_are_chosen_and_dead_zones_are_not(choice):
    assert choice.selected_terms == ("dry friction of the wheels",)


def test_the_fit_of_an_unknown_robot_predicts_unseen_runs(choice):
    validation = validate(choice.fit, [drive(3), drive(4)])
    assert validation.verdict == "USABLE"
