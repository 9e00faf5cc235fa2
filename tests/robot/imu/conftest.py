"""An emulated chip on an emulated bus."""

import pytest


@pytest.fixture
def bench(monkeypatch, tmp_path):
    """Return `bench(**chip)`, which puts a chip with these properties on a bus."""
    from tests.emulated.i2c_ioctl import Bench  # needs smbus2

    return lambda **chip: Bench(monkeypatch, tmp_path, **chip)


@pytest.fixture
def start_imu(bench):
    """Return `start_imu(**chip)`, which returns a bench with this chip, and its IMU that has been read for `read_s`."""
    from tests.emulated.i2c_ioctl import loop, start

    def make(read_s=0.0, **chip):
        b = bench(**chip)
        device = start(b)
        loop(b, device, read_s)
        return b, device

    return make
