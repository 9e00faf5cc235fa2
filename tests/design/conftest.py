"""Fixtures: the small vehicle."""

import pytest

from baqueano.vehicle_file import load


@pytest.fixture(scope="session")
def small():
    """Return the small vehicle of the garage."""
    return load("small")
