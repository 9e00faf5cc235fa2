"""Case study I and the small vehicle, driven by random steps."""

import numpy as np
import pytest

from baqueano.identify import random_steps
from baqueano.simulate import simulate
from baqueano.vehicle_file import load


@pytest.fixture(scope="session")
def case():
    """The vehicle file of the paper's case study I."""
    return load("case-study-1")


@pytest.fixture(scope="session")
def case_run(case):
    """(seed, seconds) → a run of case study I."""

    def drive(seed, duration_s=60.0, file=case, **options):
        u = random_steps(file.command.limit, duration_s, file.rate_hz, seed)
        return simulate(file, u, seed, **options)

    return drive


@pytest.fixture(scope="session")
def small():
    """The garage's small vehicle."""
    return load("small")


@pytest.fixture(scope="session")
def off():
    """(fit, file) → (estimate − truth) / sd of what was seen."""

    def errors(fit, file):
        truth = np.array([file.value(name) for name in fit.names])
        z = (fit.estimate - truth) / fit.sd
        return z[np.isfinite(z)]

    return errors
