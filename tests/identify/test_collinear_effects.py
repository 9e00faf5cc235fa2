"""An effect that would be larger than the measured signal does not widen the intervals of the parameters."""

import numpy as np
import pytest

from baqueano.identify.diagnostics.score_test import FitResiduals, score_test

ROWS = 1200


def effect_on(own_fraction):
    """Return the test of an effect, of which the free parameter explains all but `own_fraction`, and its misfit."""
    t = np.linspace(0.0, 60.0, ROWS)
    rng = np.random.default_rng(4)
    d = np.sin(2.0 * t)
    own = np.cos(0.7 * t)
    own -= d * (own @ d) / (d @ d)
    own *= np.linalg.norm(d) / np.linalg.norm(own)
    misfit = 0.3 * own + 0.5 * rng.standard_normal(ROWS)  # motion outside the model, below its noise
    psi, w, d = np.clip(misfit, -1.345, 1.345), (np.abs(misfit) < 1.345).astype(float), d[None, :]
    power, blocks = float(psi @ psi / w.sum()), np.arange(0, ROWS, 20)
    fit = FitResiduals(
        [misfit[:, None]], psi, w, d, d @ psi, [], np.zeros(ROWS, int), blocks,
        np.linalg.inv((d * w) @ d.T), np.vstack([d * w, psi]), power, float(np.sum(d**2)),
    )  # fmt: skip
    D = np.sqrt(1.0 - own_fraction) * d + np.sqrt(own_fraction) * own
    return score_test(fit, D)[0]


@pytest.mark.parametrize("own_fraction", [1e-5, 1e-4, 5e-3])
def test_a_collinear_effect_of_impossible_size_does_not_shift_a_parameter(own_fraction):
    assert np.all(effect_on(own_fraction).shift == 0.0)


def test_an_effect_with_a_part_of_its_own_shifts_the_parameter_by_its_size():
    test = effect_on(0.5)
    assert test.z > 4.6
    assert abs(test.shift[0]) == pytest.approx(0.3, rel=0.3)
