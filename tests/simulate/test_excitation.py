"""Excitation signals: within the limits, determined by the seed, rich enough, and with errors for invalid input."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from baqueano.errors import UsageError
from baqueano.identify import KINDS, excitation, random_steps
from tests.codes import of_code

LIMIT = [20.0, 0.0, 60.0]


@pytest.mark.parametrize("kind", KINDS)
@given(seed=st.integers(0, 2**32), duration_s=st.floats(8.0, 40.0))
def test_every_signal_stays_within_its_limits_and_zero_limits_give_zero(kind, seed, duration_s):
    u = excitation(kind, LIMIT, duration_s, 50.0, seed)
    assert u.shape == (round(duration_s * 50.0), 3)
    assert np.all(np.abs(u) <= np.array(LIMIT) * (1.0 + 1e-12))
    assert np.all(u[:, 1] == 0.0)


@pytest.mark.parametrize("kind", KINDS)
def test_a_signal_is_determined_by_its_seed(kind):
    first, repetition, other_seed = (excitation(kind, LIMIT, 20.0, 50.0, seed) for seed in (3, 3, 4))
    assert np.array_equal(first, repetition)
    assert not np.array_equal(first, other_seed)


@pytest.mark.parametrize("kind", KINDS)
def test_the_channels_of_a_signal_are_nearly_uncorrelated(kind):
    u = excitation(kind, LIMIT, 120.0, 50.0, 1)
    assert abs(np.corrcoef(u[:, 0], u[:, 2])[0, 1]) < 0.4


def test_random_steps_stay_constant_for_their_duration():
    u = random_steps([1.0], 10.0, 100.0, 0, hold_s=0.5)
    assert np.count_nonzero(np.diff(u[:, 0])) == 19


def test_multisine_reaches_its_limit_and_has_no_power_outside_its_band():
    u = excitation("multisine", [2.0, 1.0], 40.0, 50.0, 0, low_hz=0.5, high_hz=4.0)
    assert np.max(np.abs(u), axis=0) == pytest.approx([2.0, 1.0])
    f = np.fft.rfftfreq(len(u), 1 / 50.0)
    power = np.abs(np.fft.rfft(u, axis=0)) ** 2
    assert np.max(power[(f < 0.49) | (f > 4.01)]) < 1e-12 * np.max(power)
    assert np.max(np.minimum(power[:, 0], power[:, 1])) < 1e-12 * np.max(power)  # no frequency is shared


def test_prbs_is_always_at_full_command():
    assert np.all(np.abs(excitation("prbs", [3.0], 10.0, 100.0, 0)) == 3.0)


def test_ramps_begin_and_end_slowly_and_go_both_ways():
    u = excitation("ramps", [1.0], 40.0, 100.0, 0)[:, 0]
    assert np.max(np.abs(np.diff(u))) < 0.011
    assert u.min() < -0.3
    assert u.max() > 0.3


def test_a_signal_begins_and_ends_with_rest():
    u = excitation("prbs", [1.0], 10.0, 100.0, 0, rest_s=2.0)
    assert len(u) == 1000
    assert not u[:200].any()
    assert not u[-200:].any()
    assert np.all(u[200:-200] != 0.0)


@pytest.mark.parametrize(
    ("call", "code"),
    [
        (lambda: excitation("sine", LIMIT, 10.0, 50.0), "signal.unknown"),
        (lambda: excitation("random steps", LIMIT, 10.0, 50.0), "signal.unknown"),
        (lambda: excitation("design", LIMIT, 10.0, 50.0), "signal.unknown"),
        (lambda: excitation("square", LIMIT, 10.0, 50.0), "signal.unknown"),
        (lambda: excitation("prbs", LIMIT, 10.0, 50.0, rest_s=5.0), "signal.all-rest"),
        (lambda: random_steps([np.inf], 10.0, 50.0), "signal.limit"),
        (lambda: random_steps([-1.0], 10.0, 50.0), "signal.limit"),
        (lambda: random_steps(LIMIT, 0.0, 50.0), "signal.no-tick"),
        (lambda: random_steps(LIMIT, 10.0, 50.0, hold_s=0.0), "signal.short"),
        (lambda: excitation("multisine", LIMIT, 10.0, 50.0, high_hz=30.0), "signal.band"),
        (lambda: excitation("multisine", LIMIT, 1.0, 50.0, high_hz=1.0), "signal.few-sines"),
    ],
)
def test_an_invalid_signal_is_refused_with_a_reason(call, code):
    with pytest.raises(UsageError, check=of_code(code)):
        call()
