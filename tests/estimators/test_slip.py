"""Wheels that slip for a while: the covariance of the recommended filter covers the errors."""

from dataclasses import replace

import numpy as np
import pytest

from baqueano.estimators import AugmentedEkf
from baqueano.estimators.readings.sensor_numbers import slip_statistics
from baqueano.sensors import Encoders, Odometer, Wheels
from baqueano.signals import Slot, Tick, sensor_slots
from baqueano.symbolic import scan
from baqueano.vehicles import Friction, Planar

DT, SECONDS, DRIVES = 0.01, 10.0, 60
MASS, DRAG, PUSH, FLOOR = 0.6, 1.0, 1.0, 0.2
SLIP, FADE_S, NOISE = 0.05, 0.4, 0.01
ODOMETER = Odometer(noise_std=NOISE, scale_std=0.0, slip_std=SLIP, slip_fade_s=FADE_S)
CAR = Planar(
    mass_kg=MASS, inertia_kg_m2=0.01, actuator_matrix=np.diag([PUSH, 0.0, 0.1]),
    friction=Friction(linear=np.array([DRAG, 40.0, 0.1])),
)  # fmt: skip


def filter_of(odometer):
    return AugmentedEkf(
        CAR, sensor_slots(("odometer",))(odometer), use=("odometer",), course_std=0.0,
        disturbance_std=np.array([1e-6, 1e-6]), velocity_walk_std=np.array([FLOOR, 1e-6, 1e-6]),
    )  # fmt: skip


def errors_and_claims(odometer):
    """Return errors of distance and speed and their claimed variances at the end of straight drives: (DRIVES, 2)."""
    n, rng, block = round(SECONDS / DT), np.random.default_rng(7), filter_of(odometer)
    slots = type(block.sensors)
    example = Tick(1, np.zeros(3), slots(Slot(0.0, np.zeros(1))))

    def step(belief, tick):
        belief, estimate = block.row(belief, tick)
        return belief, (estimate.eta[0], estimate.nu[0], estimate.cov[0, 0], estimate.cov[3, 3])

    kernel, out = scan(step, block.init(), example), []
    u = np.tile([0.8, 0.0, 0.0], (n, 1))
    keep = np.exp(-DT / FADE_S)
    for _ in range(DRIVES):
        x, v, slip = 0.0, 0.01 * rng.standard_normal(), SLIP * rng.standard_normal()
        z = np.empty((n, 1))
        for k in range(n):
            before = v
            v += DT * (PUSH * 0.8 - DRAG * v) / MASS + FLOOR * np.sqrt(DT) * rng.standard_normal()
            x += 0.5 * DT * (before + v)
            slip = keep * slip + SLIP * np.sqrt(1.0 - keep**2) * rng.standard_normal()
            z[k] = v * (1.0 + slip) + NOISE * rng.standard_normal()
        ticks = Tick(10_000_000 * np.arange(1, n + 1), u, slots(Slot(np.ones(n), z, np.zeros(n))))
        path_m, speed, var_x, var_v = (np.asarray(column)[-1] for column in kernel.run(ticks)[1])
        out.append(([path_m - x, speed - v], [var_x, var_v]))
    return tuple(np.array(column) for column in zip(*out, strict=True))


@pytest.fixture(scope="module")
def with_slip():
    return errors_and_claims(ODOMETER)


def test_distance_and_speed_errors_match_their_covariance_under_wheel_slip(with_slip):
    """χ² of 60 drives divided by 60 lies between 0.55 and 1.6 in all but 1 of 1000 cases."""
    error, claim = with_slip
    for nees in np.mean(error**2 / claim, axis=0):
        assert 0.55 < nees < 1.6


def test_the_covariance_is_too_small_if_slip_is_modelled_as_white_noise():
    error, claim = errors_and_claims(replace(ODOMETER, slip_std=0.0))
    assert np.all(np.mean(error**2 / claim, axis=0) > 3.0)


@pytest.mark.parametrize(("sensor", "wheels"), [(Odometer(), 1), (Wheels(0.1), 2), (Encoders(0.1, 1e-4), 2)])
def test_the_two_wheels_slip_independently(sensor, wheels):
    variance, fade_s, period_s = slip_statistics(
        sensor_slots(("wheels",))(sensor), {"wheels": tuple(range(sensor.size))}
    )
    assert variance == pytest.approx(sensor.slip_std**2 / wheels)
    assert (fade_s, period_s) == (sensor.slip_fade_s, 1.0 / sensor.rate_hz)
