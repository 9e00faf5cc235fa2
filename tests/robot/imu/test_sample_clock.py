"""The clock of a chip is estimated only from sample counts, within the stated bounds."""

import numpy as np
import pytest

from baqueano.robot.imu.sample_clock import SampleClock


def looks(ppm, seconds, rng, jitter_s, rate_hz=200.0, every_s=0.01):
    """Return times and counts of polls of a chip that is `ppm` fast: (newest, before, after), and its period and
    phase."""
    period, phase = 1e9 / rate_hz / (1.0 + ppm * 1e-6), 3_217_113.0
    samples = []
    for i in range(round(seconds / every_s)):
        before = round(1e9 * (i + 1) * every_s + rng.exponential(jitter_s * 1e9))
        after = before + round(150e3 + rng.exponential(50e3))
        samples.append((int((rng.uniform(before, after) - phase) // period), before, after))
    return samples, period, phase


@pytest.mark.parametrize("ppm", [-40_000, -700, 8_000, 40_000])
@pytest.mark.parametrize("jitter_s", [1e-4, 1e-3])
@pytest.mark.parametrize("seed", [11, 12])
def test_errors_of_period_and_phase_are_within_their_stated_bounds(ppm, jitter_s, seed):
    samples, period, phase = looks(ppm, 15.0, np.random.default_rng(seed), jitter_s)
    clock = SampleClock(5e6)
    for n, (last_sample, before, after) in enumerate(samples):
        clock.add_reading(last_sample, before, after)
        assert abs(clock.rate_hz - 1e9 / period) <= clock.rate_error_hz * 1.001 + 1e-6 or n < 100
        stamp = clock.stamps(last_sample, 1)[0]
        if n > 300:
            assert abs(stamp - (phase + period * last_sample)) <= clock.phase_error_ns + 0.2e6
    assert clock.contradiction_count == 0
    assert clock.rate_hz == pytest.approx(1e9 / period, rel=150e-6)


def test_the_sample_phase_is_estimated_to_a_hundredth_of_a_period():
    samples, period, phase = looks(8_000, 20.0, np.random.default_rng(3), 1e-4)
    clock, errors = SampleClock(5e6), []
    for last_sample, before, after in samples:
        clock.add_reading(last_sample, before, after)
        errors.append(clock.stamps(last_sample, 1)[0] - (phase + period * last_sample))
    assert np.std(errors[500:]) < 50e3
    assert np.max(np.abs(errors[500:])) < 200e3


def test_the_phase_stays_unknown_if_polling_is_synchronous_with_the_chip():
    samples, period, _ = looks(0, 10.0, np.random.default_rng(4), 0.0)
    clock = SampleClock(5e6)
    for look in samples:
        clock.add_reading(*look)
    assert clock.phase_error_ns > 0.4 * period


@pytest.mark.parametrize(
    ("ppm", "seed", "first", "lost", "settled", "max_error_ns", "rel"),
    [(20.0, 6, 1_000, 3, 1_300, 0.3e6, 1e-4), (5.0, 9, 4, 2, 200, 0.5e6, 1e-3)],
)
def test_lost_samples_are_detected_and_the_clock_estimate_recovers(
    ppm, seed, first, lost, settled, max_error_ns, rel
):
    samples, period, phase = looks(5_000, ppm, np.random.default_rng(seed), 1e-4)
    clock, errors = SampleClock(5e6), []
    for n, (last_sample, before, after) in enumerate(samples):
        sample = last_sample - (lost if n >= first else 0)
        clock.add_reading(sample, before, after)
        errors.append(clock.stamps(sample, 1)[0] - (phase + period * last_sample))
    assert clock.contradiction_count >= 1
    assert np.max(np.abs(errors[settled:])) < max_error_ns
    assert clock.rate_hz == pytest.approx(1e9 / period, rel=rel)


def test_a_slow_clock_drift_is_tracked():
    rng = np.random.default_rng(7)
    clock, sample, last_sample, period, errors = SampleClock(5e6), 2e6, 0, 5e6 * 0.99, []
    for i in range(6000):
        look = 10_000_000 * (i + 1) + round(rng.exponential(1e5))
        while sample + period <= look:
            sample += period
            last_sample += 1
            period *= 1.0 + 3e-6 * 5e-3  # 3 ppm a second: 180 ppm in the minute
        clock.add_reading(last_sample, look - 100_000, look + 100_000)
        errors.append(clock.stamps(last_sample, 1)[0] - sample)
    assert np.max(np.abs(errors[300:])) < 0.3e6


def test_timestamps_increase_by_about_one_period_during_phase_estimation():
    samples, period, _ = looks(-20_000, 5.0, np.random.default_rng(8), 1e-3)
    clock, stamps, last_ns = SampleClock(5e6), [], samples[0][0]
    for last_sample, before, after in samples:
        clock.add_reading(last_sample, before, after)
        stamps += clock.stamps(last_ns + 1, last_sample - last_ns)
        last_ns = last_sample
    steps = np.diff(stamps) / period
    assert 0.85 < steps.min() <= steps.max() < 1.15
