"""An emulated chip on an emulated bus."""

import pytest


@pytest.fixture
def bench(monkeypatch, tmp_path):
    """Return `bench(**chip)`, which puts a chip with these properties on a bus."""
    from tests.emulated.i2c_ioctl import Bench  # needs smbus2

    return lambda **chip: Bench(monkeypatch, tmp_path, **chip)
