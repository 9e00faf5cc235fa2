"""An accelerometer in g that is read in m/s² shows by its steps or its noise; a modern one in m/s² does not."""

from contextlib import suppress

import numpy as np
import pytest

from baqueano.errors import FileError
from baqueano.runs import import_run

ONLY_IMU = """format = 1
name = "board"
files.log = { time = "t", time_unit = "s" }
command = { names = ["u"], in_force = "from", u = [{ column = "u", unit = "1" }] }

[sensors.imu]
z = [{ column = "ax", unit = "m/s^2" }, { column = "ay", unit = "m/s^2" }, { column = "wz", unit = "rad/s" }]
"""


@pytest.mark.parametrize(
    ("noise_m_s2", "convert", "finding"),
    [
        (0.005, lambda g: np.round(g * 16384.0) / 16384.0, "counts per g"),
        (0.03, lambda g: np.round(g * 2048.0) / 2048.0, "counts per g"),
        (0.03, lambda g: np.round(g, 5), "quiet accelerometer"),
        (0.005, lambda g: np.round(g * 16384.0) / 16384.0 * 9.80665, None),
        (0.005, lambda g: np.round(g * 16384.0) / 16384.0 * 9.81, None),
        (0.005, lambda g: np.round(g * 9.80665, 4), None),
        (0.03, lambda g: np.round(g * 9.80665, 2), None),
        (0.005, lambda g: g * 9.80665, None),
    ],
)
def test_the_steps_or_the_noise_of_an_accelerometer_in_g_are_reported(tmp_path, noise_m_s2, convert, finding):
    """A slow robot with a modern accelerometer: 0.005 m/s² of noise and accelerations of at most 1 m/s²."""
    rng, t = np.random.default_rng(5), np.arange(1500) * 0.02
    u = np.where(t > 5.0, np.sin(t), 0.0)
    a = np.outer(np.gradient(u, t), [0.5, 0.2]) + noise_m_s2 * rng.standard_normal((len(t), 2))
    ax, ay = (convert(column / 9.80665) for column in a.T)
    columns = np.column_stack([t, u, ax, ay, u + 0.001 * rng.standard_normal(len(t))])
    np.savetxt(tmp_path / "log.csv", columns, delimiter=",", header="t,u,ax,ay,wz", comments="", fmt="%.17g")
    (tmp_path / "map.toml").write_text(ONLY_IMU)
    codes = [single.code for single in import_run(tmp_path / "map.toml", tmp_path / "log.csv").findings]
    for code in ("counts per g", "quiet accelerometer"):
        assert codes.count(code) == (2 if code == finding else 0), codes


def test_huge_cells_of_an_accelerometer_do_not_overflow(tmp_path):
    t = np.arange(300) * 0.02
    columns = np.column_stack([t, np.sin(t), np.sin(t), np.cos(t), np.sin(t)])
    columns[100:102, 2] = 1.7e308, -1.7e308
    np.savetxt(tmp_path / "log.csv", columns, delimiter=",", header="t,u,ax,ay,wz", comments="", fmt="%.17g")
    (tmp_path / "map.toml").write_text(ONLY_IMU)
    with np.errstate(over="raise"), suppress(FileError):
        import_run(tmp_path / "map.toml", tmp_path / "log.csv")
