"""The step of a vehicle compared with a fine integration of its equations, written again here, with every change as
an event.
"""

from functools import partial
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from baqueano.sensors import Imu
from baqueano.symbolic import jacobian, with_value
from baqueano.vehicles import AccelerationModel, Car, Drivetrain, Friction, Kinematic, Planar

M, I, C = 0.6, 1.5e-3, 0.01
LINEAR, DRY, DRY_SPEED = np.array([4.0, 20.0, 0.0155]), np.array([0.4, 0.0, 0.01]), 0.3
FX, FN = 3.7, 0.22
ZONE, GAIN, LAG_S = np.array([0.1, 0.15]), np.array([0.95, 1.05]), 0.045
LEVER, BIAS, LOW_PASS_HZ = np.array([0.03, -0.01]), np.array([0.1, -0.2, 0.02]), 44.0
DURATION_S, SERVO_LAG_S = 0.6, 0.05


def channels(u):
    """Return left and right wheel behind the dead zone and with their gains."""
    w = np.array([u[0] - u[2], u[0] + u[2]])
    return GAIN * (np.maximum(w - ZONE, 0.0) + np.minimum(w + ZONE, 0.0))


def accelerations(nu, wheels):
    """Return ν̇ (3,) of the two-wheeled vehicle by Newton and Euler."""
    e_x, e_r = 0.5 * (wheels[0] + wheels[1]), 0.5 * (wheels[1] - wheels[0])
    force = LINEAR * nu + DRY * np.tanh(nu / DRY_SPEED)
    X, Y, N = FX * e_x - force[0], -force[1], FN * e_r - force[2]
    r_dot = (N - C * Y) / I
    return np.array([X / M + nu[2] * nu[1] + C * nu[2] ** 2, Y / M - nu[2] * nu[0] - C * r_dot, r_dot])


def imu_reading(nu, nu_dot):
    """Return the reading of an IMU at LEVER."""
    lx, ly = LEVER
    return BIAS + np.array(
        [
            nu_dot[0] - nu[2] * nu[1] - lx * nu[2] ** 2 - ly * nu_dot[2],
            nu_dot[1] + nu[2] * nu[0] - ly * nu[2] ** 2 + lx * nu_dot[2],
            nu[2],
        ]
    )


def exact(changes, delay_s, lag_s, times):
    """Return (η, ν, the IMU reading, and the reading behind its low-pass) at `times`, integrated from change to
    change."""
    edges = sorted({0.0, DURATION_S, *times, *(t + delay_s for t, _ in changes if t + delay_s < DURATION_S)})
    x, out, tau_s = np.zeros(11), {}, 0.5 / np.pi / LOW_PASS_HZ
    x[8:] = BIAS
    for a, b in pairwise(edges):
        w = channels(
            [u for t, u in changes if t + delay_s <= a + 1e-12][-1] if a >= delay_s - 1e-12 else np.zeros(3)
        )

        def dot(t, x, w=w):
            psi, nu = x[2], x[3:6]
            drive = x[6:8] if lag_s else w
            nu_dot = accelerations(nu, drive)
            go = [np.cos(psi) * nu[0] - np.sin(psi) * nu[1], np.sin(psi) * nu[0] + np.cos(psi) * nu[1], nu[2]]
            follow = (w - x[6:8]) / lag_s if lag_s else np.zeros(2)
            return np.concatenate([go, nu_dot, follow, (imu_reading(nu, nu_dot) - x[8:]) / tau_s])

        x = solve_ivp(dot, (a, b), x, rtol=1e-11, atol=1e-13).y[:, -1]
        now = imu_reading(x[3:6], accelerations(x[3:6], x[6:8] if lag_s else w))
        out[b] = np.concatenate([x[:6], now, x[8:]])
    return np.array([out[t] for t in times])


def simulated_outputs(vehicle, imus, steps_s, changes):
    """Return the same outputs by the step of the vehicle, one command per tick."""
    state, states = vehicle.init(), [imu.init() for imu in imus]
    t, out = 0.0, []
    for dt_s in steps_s:
        u = [u for s, u in changes if s <= t + 1e-9][-1]
        state, motion = vehicle.step(state, u, dt_s, np.zeros(3))
        t, z = t + dt_s, []
        for k, imu in enumerate(imus):
            states[k], slot = imu.step(states[k], motion, dt_s, np.zeros(6))
            z.append(slot.z)
        out.append(np.concatenate([motion.eta, motion.nu, *z]))
    return np.array(out)


def vehicle_with(delay_s, lag_s, slots):
    return Planar(
        M, I, np.diag([FX, 0.0, FN]), centre_of_mass_x_m=C,
        friction=Friction(linear=LINEAR, coulomb=DRY, coulomb_speed=DRY_SPEED * np.ones(3)),
        drivetrain=Drivetrain(
            mixing="two_wheels", dead_zone_forward=ZONE, dead_zone_backward=ZONE, gain=GAIN,
            delay_s=delay_s, delay_slots=slots, lag_s=lag_s,
        ),
    )  # fmt: skip


IMUS = [Imu(rate_hz=1e5, lever_arm_m=LEVER, accel_bias=BIAS[:2], gyro_bias=BIAS[2])]
IMUS.append(
    Imu(rate_hz=1e5, lever_arm_m=LEVER, accel_bias=BIAS[:2], gyro_bias=BIAS[2], low_pass_hz=LOW_PASS_HZ)
)


def errors(delay_s, lag_s, dt_s):
    """Return (12,) the largest error of η, ν, the IMU, and the IMU behind its low-pass."""
    changes = [(0.02 * k, np.array([0.6 * np.sin(1.7 * k), 0.0, 0.4 * np.sin(2.3 * k)])) for k in range(30)]
    N = round(DURATION_S / dt_s)
    times = [float(t) for t in np.round(dt_s * np.arange(1, N + 1), 12)]
    slots = int(np.ceil(delay_s / dt_s)) + 1 if delay_s else 0
    readings = simulated_outputs(vehicle_with(delay_s, lag_s, slots), IMUS, np.full(N, dt_s), changes)
    return np.abs(readings - exact(changes, delay_s, lag_s, times)).max(axis=0)


@pytest.mark.parametrize("delay_s", [0.0, 0.013])
def test_with_a_lag_the_integration_error_is_of_fourth_order(delay_s):
    """Pose, velocity and IMU readings under commands that change in the middle of a tick."""
    ticks = np.array([0.01, 0.005, 0.0025])
    differences = np.array([errors(delay_s, LAG_S, dt_s) for dt_s in ticks])
    slopes = [np.polyfit(np.log(ticks), np.log(column), 1)[0] for column in differences[:, :9].T]
    assert min(slopes) > 3.4
    assert np.all(differences[0] < [1e-6, 1e-6, 1e-4, 1e-6, 1e-5, 5e-4, 5e-4, 5e-4, 5e-4, 2e-2, 2e-2, 5e-3])
    # behind the low-pass
    assert np.polyfit(np.log(ticks), np.log(differences[:, 9:].max(axis=1)), 1)[0] > 2.5


def test_without_a_lag_a_command_within_a_tick_increases_the_error():
    whole_steps, in_two_parts = errors(0.0, 0.0, 0.01), errors(0.013, 0.0, 0.01)
    assert np.all(whole_steps[:9] < 1e-3)
    assert np.all(in_two_parts[:9] < 5e-3)
    assert in_two_parts[:9].sum() > whole_steps[:9].sum()


def test_the_acceleration_at_the_tick_end_uses_the_instantaneous_effort():
    """A command acts 3 ms after the start of the tick: the full acceleration is present at the end."""
    vehicle = vehicle_with(0.003, 0.0, 1)
    _, motion = vehicle.step(vehicle.init(), np.array([0.8, 0.0, 0.0]), 0.01, np.zeros(3))
    expected = accelerations(motion.nu, channels(np.array([0.8, 0.0, 0.0])))
    assert motion.nu_dot == pytest.approx(expected, abs=1e-9)


def test_with_uneven_ticks_a_command_acts_at_the_correct_time():
    """The same changes by uneven ticks, each with its own command."""
    rng = np.random.default_rng(2)
    steps_s = rng.uniform(0.006, 0.014, 50)
    begins = np.concatenate([[0.0], np.cumsum(steps_s)[:-1]])
    changes = [(float(t), rng.uniform(-1.0, 1.0, 3) * (k % 4 == 0)) for k, t in enumerate(begins)]
    changes[0] = (0.0, np.zeros(3))
    times = [float(t) for t in np.cumsum(steps_s) if t < DURATION_S]
    readings = simulated_outputs(vehicle_with(0.013, LAG_S, 4), IMUS, steps_s, changes)[: len(times)]
    assert np.all(np.abs(readings - exact(changes, 0.013, LAG_S, times)).max(axis=0)[:9] < 5e-4)


class Hovercraft(AccelerationModel):
    """A user vehicle that slides and turns into the wind of its own speed."""

    def nu_dot(self, nu, effort, psi=0.0):
        return np.array([3.0, 2.0, 20.0]) * effort - slowed(nu)


def slowed(nu):
    """Return the drag of the air (3,)."""
    return np.array([1.5 * nu[0] - nu[2] * nu[1], 2.5 * nu[1] + nu[2] * nu[0], 4.0 * nu[2] + 3.0 * nu[0]])


def hovercraft_dot(nu, effort):
    return np.array([3.0, 2.0, 20.0]) * effort - slowed(nu)


def car_dot(nu, effort):
    """Return the derivatives of a car whose origin is 7 cm ahead of its rear axle, under throttle and servo."""
    v_dot = 4.0 * effort[0] - (2.0 + 0.5 * np.abs(nu[2])) * nu[0]
    r_dot = (nu[0] * np.tan(0.4 * effort[1]) / 0.15 - nu[2]) / 0.06
    r_dot += nu[2] * nu[0] * v_dot / (nu[0] ** 2 + 0.01)
    return np.array([v_dot, 0.07 * r_dot, r_dot])


def line(delay_s, dt_s, commands=3, servo_lag_s=0.0):
    slots = int(np.ceil(delay_s / dt_s)) + 1 if delay_s else 0
    return Drivetrain(
        commands=commands, delay_s=delay_s, delay_slots=slots, lag_s=LAG_S, servo_lag_s=servo_lag_s
    )


def car_with_servo_lag(servo_lag_s, delay_s, dt_s):
    return Car(
        wheelbase_m=0.15, throttle_gain=4.0, steering_gain=0.4, rear_axle_m=0.07, linear_drag=2.0,
        cornering_drag=0.5, yaw_lag_s=0.06, drivetrain=line(delay_s, dt_s, 2, servo_lag_s),
    )  # fmt: skip


def car_command(k):
    """Return throttle and servo, to the left, because |ν_ψ| has a kink at 0."""
    return np.array([0.6 + 0.3 * np.sin(1.7 * k), 0.6 + 0.4 * np.sin(2.3 * k)])


VELOCITY = np.diag([0.6, 0.0, 8.0])  # of the kinematic vehicle
OTHERS = {  # a vehicle behind a delay and a lag, ν̇ by hand, and commands
    "car": (partial(car_with_servo_lag, 0.0), car_dot, car_command),
    "slow servo": (partial(car_with_servo_lag, 0.08), car_dot, car_command),
    "kinematic": (
        lambda delay_s, dt_s: Kinematic(VELOCITY, drivetrain=line(delay_s, dt_s)),
        None,
        lambda k: np.array([0.6 * np.sin(1.7 * k), 0.0, 0.4 * np.sin(2.3 * k)]),
    ),
    "own": (
        lambda delay_s, dt_s: Hovercraft(drivetrain=line(delay_s, dt_s)),
        hovercraft_dot,
        lambda k: np.array([0.6 * np.sin(1.7 * k), 0.5 * np.sin(k), 0.4 * np.sin(2.3 * k)]),
    ),
}  # fmt: skip


def fine(accelerate, changes, delay_s, times, motors):
    """Return (η, ν) and the accelerometers at `times`, integrated from change to change. Without `accelerate` the
    velocity follows the effort. The last channels are servos, with a lag of their own or without one."""
    edges = sorted({0.0, *times, *(t + delay_s for t, _ in changes if t + delay_s < times[-1])})
    x, out, n = np.zeros(6 + len(changes[0][1])), {}, len(changes[0][1])
    lag_s = np.where(np.arange(n) < n - motors.servos, LAG_S, motors.servo_lag_s or 1.0)
    direct = 0 if motors.servo_lag_s else motors.servos
    for a, b in pairwise(edges):
        inputs_sent = [u for t, u in changes if t + delay_s <= a + 1e-12]
        w = inputs_sent[-1] if inputs_sent else np.zeros(n)
        x[len(x) - direct :] = w[n - direct :]

        def dot(t, x, w=w):
            psi, nu = x[2], x[3:6] if accelerate else VELOCITY @ x[6:]
            go = [np.cos(psi) * nu[0] - np.sin(psi) * nu[1], np.sin(psi) * nu[0] + np.cos(psi) * nu[1], nu[2]]
            rise = accelerate(nu, x[6:]) if accelerate else VELOCITY @ (w - x[6:]) / LAG_S
            return np.concatenate([go, rise, (w - x[6:]) / lag_s])

        x = solve_ivp(dot, (a, b), x, rtol=1e-11, atol=1e-13).y[:, -1]
        nu = x[3:6] if accelerate else VELOCITY @ x[6:]
        nu_dot = accelerate(nu, x[6:]) if accelerate else VELOCITY @ (w - x[6:]) / LAG_S
        out[b] = np.concatenate([x[:3], nu, (nu_dot + np.cross([0.0, 0.0, nu[2]], nu))[:2]])
    return np.array([out[t] for t in times])


@pytest.mark.parametrize("delay_s", [0.0, 0.013])
@pytest.mark.parametrize("kind", OTHERS)
def test_the_integration_error_of_every_vehicle_is_of_fourth_order(kind, delay_s):
    make, accelerate, command = OTHERS[kind]
    changes, ticks = [(0.02 * k, command(k)) for k in range(30)], np.array([0.01, 0.005, 0.0025])
    moments = [float(t) for t in np.round(ticks[0] * np.arange(1, round(DURATION_S / ticks[0]) + 1), 12)]
    exactly, differences = fine(accelerate, changes, delay_s, moments, make(0.0, 1.0).drivetrain), []
    for dt_s in ticks:
        x = round(ticks[0] / dt_s)
        steps_s = np.full(x * len(moments), dt_s)
        had = simulated_outputs(make(delay_s, dt_s), [Imu(rate_hz=1e5)], steps_s, changes)[x - 1 :: x]
        differences.append(np.abs(had[:, : exactly.shape[1]] - exactly).max(axis=0))
    worst = np.array(differences)
    is_moving = worst[0] > 1e-11  # otherwise only rounding errors remain
    slopes = np.polyfit(np.log(ticks), np.log(worst[:, is_moving]), 1)[0]
    if kind == "car" and delay_s:
        # the servo jumps within a tick, and tan δ of the line is not the mean of tan δ
        assert slopes.min() > 0.9
        assert np.all(worst[0, :6] < [1e-4, 2e-4, 1e-3, 2e-4, 2e-4, 3e-3])
        return
    assert slopes.min() > (2.7 if kind == "slow servo" and delay_s else 3.4)  # tan δ of the line, as above
    assert np.all(worst[0, :6] < 1e-5)


def car_without_tyres(dt_s, lag_s=0.0):
    return Car(
        wheelbase_m=0.15, throttle_gain=4.0, steering_gain=0.4, rear_axle_m=0.07, linear_drag=2.0, understeer=0.01,
        yaw_lag_s=lag_s, drivetrain=line(0.013, dt_s, 2, SERVO_LAG_S),
    )  # fmt: skip


def exact_without_tyres(changes, times):
    """Return (η, ν, ν̇_ψ) at `times`: the steering angle is that of the servo, and the path has its curvature."""
    edges = sorted({0.0, *times, *(t + 0.013 for t, _ in changes if t + 0.013 < times[-1])})
    x, out = np.array([0.07, 0.0, 0.0, 0.5, 0.0, 0.0]), {}

    def dot(t, x, w):
        (psi, v), delta, L = x[2:4], 0.4 * x[5], 0.15 + 0.01 * x[3] ** 2
        r, v_dot, servo_dot = v * np.tan(delta) / L, 4.0 * x[4] - 2.0 * v, (w[1] - x[5]) / SERVO_LAG_S
        r_dot = r * v_dot * (1.0 / v - 0.02 * v / L) + v * 0.4 * servo_dot / np.cos(delta) ** 2 / L
        go = v * np.cos(psi) - 0.07 * r * np.sin(psi), v * np.sin(psi) + 0.07 * r * np.cos(psi)
        return np.array([*go, r, v_dot, (w[0] - x[4]) / LAG_S, servo_dot, r_dot])

    for a, b in pairwise(edges):
        w = np.array([u for t, u in [(-1.0, np.zeros(2)), *changes] if t + 0.013 <= a + 1e-12][-1])
        x = solve_ivp(lambda t, x, w=w: dot(t, x, w)[:6], (a, b), x, rtol=1e-11, atol=1e-13).y[:, -1]
        r, r_dot = dot(b, x, w)[[2, 6]]
        out[b] = np.array([*x[:4], 0.07 * r, r, r_dot])
    return np.array([out[t] for t in times])


def rows_without_tyres(dt_s, changes, count, lag_s=0.0):
    car, rows = car_without_tyres(dt_s, lag_s), []
    state, per_command = car.init(np.array([0.07, 0.0, 0.0]), np.array([0.5, 0.0, 0.0])), round(0.02 / dt_s)
    for k in range(count * per_command):
        state, motion = car.step(state, changes[k // per_command][1], dt_s, np.zeros(3))
        rows.append(np.concatenate([motion.eta, motion.nu, motion.nu_dot[2:]]))
    return np.array(rows)[per_command - 1 :: per_command]


def test_without_a_lag_of_the_tyres_the_integration_error_is_of_fourth_order():
    changes, ticks = [(0.02 * k, car_command(k) * [1.0, (-1.0) ** k]) for k in range(20)], [0.02, 0.01, 0.005]
    exact = exact_without_tyres(changes, [float(t) for t in np.round(0.02 * np.arange(1, 21), 12)])
    errors = np.array([np.abs(rows_without_tyres(t, changes, 20) - exact).max(axis=0) for t in ticks])
    slopes = np.polyfit(np.log(ticks), np.log(errors), 1)[0]
    assert slopes[:6].min() > 2.7  # tan δ of the line, as above
    assert slopes[6] > 1.2  # of the yaw acceleration, where the command changes within the tick
    assert np.all(errors[1] < [1e-8, 1e-7, 6e-7, 1e-8, 2e-10, 3e-9, 0.1])


def test_a_car_changes_smoothly_until_the_lag_of_its_tyres_is_zero():
    """The yaw rate is y − λ ẏ for a short lag, so its derivative at 0 is −ẏ; a lag of 0.1 ms agrees with it."""
    changes = [(0.02 * k, car_command(k)) for k in range(10)]
    zero, short = (rows_without_tyres(0.02, changes, 10, lag_s) for lag_s in (0.0, 1e-4))

    def end(x):
        car = with_value(car_without_tyres(0.02), "yaw_lag_s", x[0])
        state = car.init(np.array([0.07, 0.0, 0.0]), np.array([0.5, 0.0, 0.0]))
        for _, u in changes:
            state, _ = car.step(state, u, 0.02, np.zeros(3))
        return np.concatenate([state.eta, state.nu])

    derivative = jacobian(end)(np.zeros(1))[:, 0]
    assert derivative == pytest.approx((short - zero)[-1, :6] / 1e-4, rel=0.05, abs=1e-2)
    v, r_dot = zero[-1, 3], zero[-1, 6]
    assert derivative[5] == pytest.approx(-r_dot, abs=0.2 * abs(r_dot))
    assert v > 0.5


@pytest.mark.parametrize(("delay_s", "tolerance"), [(0.0, 1e-4), (0.003, 0.04)])
def test_a_low_pass_follows_the_acceleration_of_a_kinematic_vehicle_with_a_lag(delay_s, tolerance):
    """V e^(−t/λ)/λ behind a low-pass τ is V (e^(−t/λ) − e^(−t/τ))/(λ − τ)."""
    motors = Drivetrain(delay_s=delay_s, delay_slots=int(delay_s > 0.0), lag_s=LAG_S)
    imu, steps_s = Imu(rate_hz=1e5, low_pass_hz=LOW_PASS_HZ), np.full(20, 0.01)
    changes = [(0.0, np.zeros(3)), (0.01, np.array([0.8, 0.0, 0.0]))]
    readings = simulated_outputs(Kinematic(VELOCITY, drivetrain=motors), [imu], steps_s, changes)[1:, 6]
    t_s, tau_s = np.cumsum(steps_s)[:-1] - delay_s, 0.5 / np.pi / LOW_PASS_HZ
    expected = 0.8 * VELOCITY[0, 0] * (np.exp(-t_s / LAG_S) - np.exp(-t_s / tau_s)) / (LAG_S - tau_s)
    assert readings == pytest.approx(expected, abs=tolerance * expected.max())


def test_an_eight_bit_timer_quantises_the_duty():
    d = Drivetrain(commands=1, duty_step=1.0 / 255.0)
    for u in (0.1234, -0.1234, 0.0019, 1.0):
        _, effort = d.step(d.init(), np.array([u]), 0.01)
        assert effort.last[0] == pytest.approx(np.round(255.0 * u) / 255.0, abs=1e-12)
