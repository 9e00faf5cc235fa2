"""`compare` on fits: their parameters side by side, and the ones that changed."""

from dataclasses import replace

import numpy as np
import pytest

import baqueano as bq
from baqueano.errors import Misuse, UsageError


def test_fits_are_compared_by_their_parameters():
    small = bq.load("small")
    run = bq.experiment(small, bq.excitation("random_steps", small.command.limit, 10.0, small.rate_hz))
    fit = bq.identify(run, small, ["model.actuator_matrix[0,0]", "model.friction.linear[0]"])
    short = replace(fit, names=fit.names[1:], units=fit.units[1:], estimate=2.0 * fit.estimate[1:], std=fit.std[1:],
                    cov=fit.cov[1:, 1:])  # fmt: skip
    history = bq.compare([fit, short], names=["empty", "loaded"])
    assert history.runs == ("empty", "loaded")
    assert np.isnan(history.single[1, 0])
    assert history.changes
    for comparison in (bq.compare(fit, short), bq.compare({"empty": fit, "loaded": short})):
        assert np.array_equal(comparison.single, history.single, equal_nan=True)
    with pytest.raises(UsageError) as error:
        bq.compare([fit])
    assert error.value.diagnostic.code == "compare.few-fits"
    with pytest.raises(Misuse) as error_info:
        bq.compare(fit, run)
    assert error_info.value.diagnostic.code == "compare.mixed"
