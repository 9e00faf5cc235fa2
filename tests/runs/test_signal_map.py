"""Signed permutations and units of channels are identified; slow signals that correlate by chance are not."""

import numpy as np
import pytest

from baqueano.runs.diagnostics.signal_map import MappedChannel, channel_regression, signal_map, unit_ratios

UNITS = unit_ratios("acceleration", "m/s^2")


def slow(rng, *shape, a=0.9):
    """Return a first-order process: 200 windows have the information of ten independent windows."""
    e, x = rng.normal(size=shape), np.zeros(shape)
    for k in range(1, len(x)):
        x[k] = a * x[k - 1] + e[k]
    return x


@pytest.mark.parametrize("is_swapped", [False, True])
@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("ratio", [1.0, *(r for r in UNITS if r != 1000.0 / 9.80665)])
def test_swapped_or_inverted_channels_and_their_units_are_identified(is_swapped, sign, ratio):
    h = slow(np.random.default_rng(1), 300, 2)
    z = (h[:, ::-1] if is_swapped else h) * sign * ratio + 0.1 * ratio * np.random.default_rng(2).normal(
        size=(300, 2)
    )
    channels = signal_map(z, h, [MappedChannel(0.4, 2.5, UNITS)] * 2)
    for i, channel in enumerate(channels):
        assert channel.prediction_index == (1 - i if is_swapped else i)
        assert np.sign(channel.regression.slope) == sign
        assert channel.ratio == ratio


@pytest.mark.parametrize("silent", [np.nan, 0.0])
def test_a_channel_is_not_swapped_with_a_silent_channel(silent):
    """A turned mount shows a part of the sideways acceleration; only the other channel could confirm a swap."""
    h = slow(np.random.default_rng(1), 300, 2)
    z = np.stack([h[:, 1] + 0.1 * np.random.default_rng(2).normal(size=300), np.full(300, silent)], axis=1)
    assert [channel.code for channel in signal_map(z, h, [MappedChannel()] * 2)] == ["", ""]


def test_at_most_one_percent_of_unrelated_slow_signals_are_called_related():
    """Of 400 unrelated pairs, one of seven correlates beyond 0.3; only two are called related."""
    channel_regressions = [
        channel_regression(*slow(np.random.default_rng(seed), 200, 2).T) for seed in range(400)
    ]
    assert sum(abs(pair.correlation) > 0.3 for pair in channel_regressions) > 40
    assert sum(pair.is_clear(0.05) for pair in channel_regressions) <= 4


@pytest.mark.parametrize(
    ("factor", "noise", "code"),
    [
        (-1.0, 1.5, "inverted"),
        (1.0 / 9.80665, 1.5, "unit"),
        (9.0, 1.5, ""),
        (9.0, 0.1, "scale"),
        (1.0, 1.5, ""),
    ],
)
def test_an_unknown_scale_needs_a_stronger_relation_than_a_sign_or_a_unit(factor, noise, code):
    """With this noise the prediction explains a third of the variance."""
    h, e = np.random.default_rng(4).normal(size=(2, 2000, 1))
    (channel,) = signal_map(factor * (h + noise * e), h, [MappedChannel(0.4, 2.5, UNITS)])
    assert channel.code == code


def test_a_slope_reduced_by_noise_of_the_prediction_is_not_reported_as_a_unit():
    """The slope is 0.24, near that of a reading in g, although the scale is 1."""
    x, e = np.random.default_rng(5).normal(size=(2, 2000, 1))
    (channel,) = signal_map(x, x + 1.8 * e, [MappedChannel(0.4, 2.5, UNITS)])
    assert channel.code == ""
    assert channel.regression.is_clear()
    assert channel.regression.slope == pytest.approx(0.24, abs=0.02)
