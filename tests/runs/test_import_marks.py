"""Position sensors with few readings and a separate clock are imported as documented."""

import numpy as np
import pytest

from .conftest import MAP, write_csv

TABLES = """
[files.reader]
path = "reader.csv"
time = "t"
time_unit = "s"
[sensors.tags]
file = "reader"
kind = "tags"
shift_s = -0.1
z = [{ column = "px", unit = "m" }, { column = "py", unit = "m" }]
[sensors.mark]
file = "reader"
kind = "mark"
z = [{ constant = 0.0 }]
[sensors.beacon]
file = "reader"
kind = "beacon"
z = [{ column = "range", unit = "cm" }]
[sensors.rangefinder]
file = "reader"
kind = "rangefinder"
z = [{ column = "range", unit = "cm" }]
[sensors.compass]
file = "reader"
kind = "compass"
z = [{ column = "heading", unit = "deg" }]
[sensors.encoders]
file = "reader"
kind = "encoders"
z = [
  { column = "left", unit = "counts", counts_per_turn = 100, radius_m = 0.05, derivative = true, wraps = 65536 },
  { column = "right", unit = "counts", counts_per_turn = 100, radius_m = 0.05, derivative = true, wraps = 65536 },
]
"""


@pytest.fixture
def run(lab):
    t = np.array([2.0, 5.5, 9.0, 14.0])
    reader = {
        "t": t, "px": t - 1.0, "py": 2.0 * t, "range": 100.0 * t, "heading": 10.0 * t,
        "left": np.mod(65500.0 + 100.0 * t, 65536.0), "right": 200.0 * t,
    }  # fmt: skip
    write_csv(lab.folder / "reader.csv", reader)
    lab.map = MAP + TABLES
    return lab.run().run


def test_position_sensors_are_imported_in_si_with_their_timestamps(run):
    t = np.array([2.0, 5.5, 9.0, 14.0])
    channels = run.sensors
    assert channels["tags"].z == pytest.approx(np.column_stack([t - 1.0, 2.0 * t]))
    assert channels["tags"].t_ns == pytest.approx(1_000_000_000 + 1e9 * (t - 0.1))
    assert channels["mark"].z == pytest.approx(np.zeros((4, 1)))
    for name in ("beacon", "rangefinder"):
        assert channels[name].z[:, 0] == pytest.approx(t)
    assert channels["compass"].z[:, 0] == pytest.approx(np.radians(10.0 * t))


def test_a_speed_from_counts_is_timestamped_midway_between_two_rows(run):
    metres = 2.0 * np.pi * 0.05
    assert run.sensors["encoders"].z == pytest.approx(np.tile([metres, 2.0 * metres], (3, 1)))
    assert run.sensors["encoders"].t_ns[0] == pytest.approx(1_000_000_000 + 3.75e9)
