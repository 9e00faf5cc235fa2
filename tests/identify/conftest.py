"""Fixtures: case study I and the small vehicle, driven by random steps."""

import numpy as np
import pytest

from baqueano.identify import random_steps
from baqueano.simulate import simulate
from baqueano.vehicle_file import load


@pytest.fixture(scope="session")
def case():
    """Return the vehicle file of case study I of the paper."""
    return load("case-study-1")


@pytest.fixture(scope="session")
def case_run(case):
    """Return the function (seed, seconds) → a run of case study I."""

    def drive(seed, duration_s=60.0, file=case, **options):
        u = random_steps(file.command.limit, duration_s, file.rate_hz, seed)
        return simulate(file, u, seed, **options)

    return drive


@pytest.fixture(scope="session")
def small():
    """Return the small vehicle of the garage."""
    return load("small")


@pytest.fixture(scope="session")
def normalised_errors():
    """Return the function (fit, file) → (estimate − truth) / std of the observable parameters."""

    def errors(fit, file):
        truth = np.array([file.value(name) for name in fit.names])
        z = (fit.estimate - truth) / fit.std
        return z[np.isfinite(z)]

    return errors
