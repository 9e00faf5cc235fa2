"""The same code under NumPy, as Python and as C: equal to 1e-12 of the larger of one and the value."""

from typing import NamedTuple

import numpy as np
import pytest

from baqueano.symbolic import scan
from baqueano.vehicles import Car, Drivetrain, Friction, Kinematic, Planar

MOTORS = Drivetrain(
    mixing="two_wheels",
    limit=np.array([1.0, 1.0]),
    dead_zone_forward=np.array([0.05, 0.06]),
    dead_zone_backward=np.array([0.04, 0.05]),
    gain=np.array([0.95, 1.05]),
    delay_s=0.013,
    delay_slots=2,
    lag_s=0.03,
    battery_v=5.5,
    sag=0.05,
)
FRICTION = Friction(
    linear=np.array([4.0, 40.0, 0.0155]),
    quadratic=np.array([0.5, 0.0, 0.001]),
    coulomb=np.array([0.66, 0.0, 0.02]),
    coulomb_speed=np.array([0.03, 0.05, 0.3]),
    cornering=0.1,
)
T = np.array([[3.7, 0.0, 0.11], [0.0, 0.0, 0.0], [0.0066, 0.0, 0.22]])
STD = np.array([0.02, 0.01, 0.1])
VEHICLES = {
    "planar": Planar(
        0.61,
        1.5e-3,
        T,
        centre_of_mass_x_m=0.01,
        friction=FRICTION,
        drivetrain=MOTORS,
        slope_rad=0.05,
        process_noise_std=STD,
    ),
    "paper": Planar(
        1.47,
        810.44,
        np.diag([1.0, 1.0, 29.99]),
        friction=Friction(linear=np.array([7.0, 7.0, 500.553]), quadratic=np.array([3.5, 3.5, 250.0])),
    ),
    "kinematic": Kinematic(np.diag([0.6, 0.0, 11.0]), drivetrain=MOTORS, process_noise_std=STD),
    "car": Car(
        wheelbase_m=0.15,
        throttle_gain=4.0,
        steering_gain=0.3,
        rear_axle_m=0.07,
        linear_drag=2.0,
        coulomb_m_s2=0.4,
        cornering_drag=0.8,
        understeer=0.02,
        drivetrain=Drivetrain(
            commands=2, delay_s=0.02, delay_slots=3, dead_zone_forward=np.array([0.1, 0.0])
        ),
        process_noise_std=STD,
    ),
}


class Input(NamedTuple):
    u: np.ndarray  # (n,)
    dt_s: float
    noise: np.ndarray  # (3,)


def flat(tree, rows=None) -> np.ndarray:
    """Return all numbers of a tree, (size,), or (rows, size)."""
    if tree is None:
        return np.zeros(0 if rows is None else (rows, 0))
    if isinstance(tree, tuple):
        return np.concatenate([flat(leaf, rows) for leaf in tree], axis=-1)
    return np.reshape(np.asarray(tree, dtype=float), -1 if rows is None else (rows, -1))


@pytest.mark.parametrize("name", VEHICLES)
def test_a_simulated_drive_is_the_same_in_every_back_end(name):
    vehicle, rng, N = VEHICLES[name], np.random.default_rng(3), 200
    inputs = Input(
        rng.uniform(-1.2, 1.2, (N, vehicle.commands)),
        rng.uniform(0.005, 0.015, N),
        rng.standard_normal((N, 3)),
    )

    def step(state, x):
        return vehicle.step(state, x.u, x.dt_s, x.noise)

    state, motions = vehicle.init(np.array([0.1, 0.2, 3.0])), []
    example = Input(inputs.u[0], inputs.dt_s[0], inputs.noise[0])
    start = state
    for k in range(N):
        state, motion = step(state, Input(inputs.u[k], inputs.dt_s[k], inputs.noise[k]))
        motions.append(flat(motion))
    plain = np.array(motions)
    bound = 1e-12 * np.maximum(1.0, np.abs(plain))
    for backend in ("python", "c"):
        end, outputs = scan(step, start, example, backend=backend).run(inputs)
        result = flat(outputs, N)
        assert np.all(np.abs(result - plain) <= bound), backend
        assert np.all(np.abs(flat(end) - flat(state)) <= 1e-12 * np.maximum(1.0, np.abs(flat(state)))), (
            backend
        )
