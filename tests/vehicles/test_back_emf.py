"""A back-EMF behind the lag of the motors, compared with SciPy's solution of current and body."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from baqueano.estimators import AugmentedEkf, DeadReckoning, Ekf, Unscented
from baqueano.sensors import Imu
from baqueano.signals import Slot, Tick, sensor_slots
from baqueano.vehicles import Car, Drivetrain, Friction, Planar

MASS_KG, INERTIA, LAG_S, GAIN, DRAG = 0.6, 1.5e-3, 0.05, (3.0, 0.3), (3.3, 0.0115)
SIDE_DRAG = 30.0
COMMANDS = [(0.8, 0.2), (-0.6, 0.4), (0.0, -0.5), (0.7, 0.0)]  # each for TEST_DRIVE_S
TEST_DRIVE_S = 0.1
MOTORS = Drivetrain(mixing="two_wheels", lag_s=LAG_S, back_emf_share=1.0)


def robot(motors=MOTORS):
    friction = Friction(linear=np.array([DRAG[0], SIDE_DRAG, DRAG[1]]))
    gain = np.diag([GAIN[0], 0.0, GAIN[1]])
    return Planar(MASS_KG, INERTIA, gain, friction=friction, drivetrain=motors)


def final_speeds(share):
    """Return forward speed and yaw rate (2,) after the commands: currents that lag, and a body that slips sideways."""
    T, D, M = np.array(GAIN), np.array(DRAG), np.array([MASS_KG, INERTIA])
    x = np.zeros(5)
    for u in np.array(COMMANDS):

        def dot(t, x, u=u):
            current, (v, r), slip = x[:2], x[2:4], x[4]
            drag = D * np.array([v, r])
            turn = np.array([r * slip, 0.0])
            nu_dot = (T * current - (1.0 - share) * drag) / M + turn
            slip_dot = -SIDE_DRAG * slip / MASS_KG - r * v
            return np.concatenate([(u - share * drag / T - current) / LAG_S, nu_dot, [slip_dot]])

        x = solve_ivp(dot, (0.0, TEST_DRIVE_S), x, rtol=1e-11, atol=1e-13).y[:, -1]
    return x[2:4]


def simulated_speeds(model, ticks):
    state = model.init()
    for u_x, u_psi in COMMANDS:
        for _ in range(ticks):
            u = np.array([u_x, 0.0, u_psi])
            state, _ = model.step(state, u, TEST_DRIVE_S / ticks, np.zeros(3))
    return state.nu[[0, 2]]


@pytest.mark.parametrize("share", [0.4, 1.0])
def test_the_error_of_a_back_emf_falls_with_the_square_of_the_tick(share):
    model = robot(Drivetrain(mixing="two_wheels", lag_s=LAG_S, back_emf_share=share))
    exact = final_speeds(share)
    coarse, fine = (np.abs(simulated_speeds(model, ticks) - exact) for ticks in (10, 40))
    assert np.all(fine < coarse / 12.0), (coarse, fine)
    assert np.all(coarse < 0.003 * np.abs(final_speeds(0.0))), coarse
    assert np.all(np.abs(exact - final_speeds(0.0)) > 10.0 * coarse)


def test_a_back_emf_does_not_change_a_constant_speed():
    u, shares = np.array([0.6, 0.0, 0.2]), (0.0, 1.0)
    speeds = []
    for share in shares:
        model = robot(Drivetrain(mixing="two_wheels", lag_s=LAG_S, back_emf_share=share))
        state = model.init()
        for _ in range(300):
            state, _ = model.step(state, u, 0.01, np.zeros(3))
        speeds.append(state.nu)
    assert speeds[0] == pytest.approx(speeds[1], abs=1e-6)


def test_only_the_throttle_of_a_car_has_a_back_emf():
    motors = Drivetrain(commands=2, servos=1, lag_s=LAG_S, back_emf_share=1.0)
    car = Car(wheelbase_m=0.2, throttle_gain=5.0, steering_gain=0.4, linear_drag=2.0, drivetrain=motors)
    assert car.viscous_effort(np.array([0.5, 0.0, 3.0])) == pytest.approx([0.2, 0.0])


@pytest.mark.parametrize("filter_class", [AugmentedEkf, DeadReckoning, Ekf, Unscented])
def test_a_filter_without_readings_moves_as_the_vehicle_with_a_back_emf(filter_class):
    model, slots = robot(), sensor_slots(("imu",))
    noise = Imu(accel_noise_std=np.array([0.1, 0.1]), gyro_noise_std=0.01)
    options = {} if filter_class is AugmentedEkf else {"process_noise_cov": 1e-6 * np.eye(6)}
    estimator = filter_class(model, slots(noise), **options)
    belief, state, silent = estimator.init(), model.init(), slots(Slot(0.0, np.zeros(3)))
    for k in range(40):
        u = np.array([0.6 if k < 25 else -0.4, 0.0, 0.2])
        state, _ = model.step(state, u, 0.01, np.zeros(3))
        belief, estimate = estimator.step(belief, Tick((k + 1) * 10_000_000, u, silent))
    assert estimate.nu == pytest.approx(state.nu, abs=1e-3)
