"""Column layouts of boards, described in the map: two columns of time, overflowing counters, a direction pin."""

from pathlib import Path

import numpy as np
import pytest

from baqueano.errors import FileError
from baqueano.runs.importing import import_run
from baqueano.runs.importing.rates import counter_period
from baqueano.runs.maps.units import unit
from tests.codes import includes, refused

MAP = """
format = 1
name = "board"
[files.log]
time = "sec"
time_unit = "s"
time_rest = { column = "nanosec", unit = "ns" }
[command]
in_force = "from"
wheels = [
  { column = "pwm_l", unit = "raw", scale = 0.01, backward = { dir_l = "B" } },
  { column = "pwm_r", unit = "raw", scale = 0.01, backward = { dir_r = 1 } },
]
[sensors.wheels]
z = [
  { column = "ticks_l", unit = "raw", scale = 0.001, derivative = true, wraps = 65536 },
  { column = "ticks_r", unit = "raw", scale = 0.001, derivative = true, wraps = 65536 },
]
"""
START_S = 1_539_614_088


@pytest.fixture
def board(tmp_path):
    """Return a board that accelerates forward on the left and backward on the right; 50 Hz, a 16-bit counter."""
    t = 0.3 + 0.02 * np.arange(400)
    way_ticks = 1000.0 * (0.5 * t + 0.05 * t**2)  # ticks of 1 mm
    left = np.floor(65000 + way_ticks).astype(int) % 65536
    right = np.floor(300 - way_ticks).astype(int) % 65536
    lines = ["sec,nanosec,pwm_l,dir_l,pwm_r,dir_r,ticks_l,ticks_r"]
    for k, t_s in enumerate(t):
        second = int(t_s)
        ns = round((t_s - second) * 1e9)
        way_l, way_r = ("B" if k % 2 else "F"), int(k % 3 == 0)
        lines.append(f"{START_S + second},{ns},40,{way_l},30,{way_r},{left[k]},{right[k]}")
    (tmp_path / "log.csv").write_text("\n".join(lines), encoding="utf-8")
    (tmp_path / "board.toml").write_text(MAP, encoding="utf-8")
    return tmp_path


def run_of_board(folder: Path, old="", new=""):
    path = folder / "board.toml"
    path.write_text(MAP.replace(old, new), encoding="utf-8")
    return import_run(path, [folder / "log.csv"]).run


def test_a_counter_that_begins_again_needs_its_period(board):
    with refused("recording.counter-wraps", FileError, counts=65536):
        run_of_board(board, ", wraps = 65536", "")


@pytest.mark.parametrize(
    ("counts", "period"),
    [
        (np.arange(-40, 400, 11) % 256, 256),
        ((np.arange(32000, 33500, 20) + 32768) % 65536 - 32768, 65536),
        (np.concatenate([np.arange(0, 40000, 50), np.arange(0, 500, 50)]), 0),  # it was set to zero
        (np.arange(0, 5_000_000, 90_000), 0),
        (np.random.default_rng(0).integers(0, 256, 300), 0),
    ],
)
def test_a_counter_that_begins_again_is_recognised(counts, period):
    assert counter_period(counts.astype(float)) == period


def test_columns_of_seconds_and_nanoseconds_are_added(board):
    run = run_of_board(board)
    assert run.t_ns[0] == START_S * 10**9 + 320_000_000  # the first row has no command before it
    np.testing.assert_allclose(np.diff(run.t_ns), 20_000_000, atol=1)


def test_an_overflow_of_a_counter_causes_no_jump_of_the_speed(board):
    wheels = run_of_board(board).sensors["wheels"]
    assert np.all(wheels.z[:, 0] > 0.4)
    assert np.all(wheels.z[:, 1] < -0.4)


def test_a_rate_is_timestamped_midway_between_its_rows(board):
    wheels = run_of_board(board).sensors["wheels"]
    t_s = (wheels.t_ns - START_S * 10**9) * 1e-9
    np.testing.assert_allclose(t_s[:3], [0.31, 0.33, 0.35], atol=1e-6)
    np.testing.assert_allclose(wheels.arrival_ns - wheels.t_ns, 10_000_000, atol=1)  # with the later count
    delay_s = np.mean(wheels.z[:, 0] - (0.5 + 0.1 * t_s)) / 0.1  # v = 0.5 + 0.1 t
    assert abs(delay_s) < 0.005  # of a step of 20 ms


def test_a_direction_pin_inverts_the_sign(board):
    # row k contains the command of row k: from the row before its tick
    applied_commands = run_of_board(board).applied_commands
    left, right = (
        applied_commands[:, 0] - applied_commands[:, 2],
        applied_commands[:, 0] + applied_commands[:, 2],
    )
    np.testing.assert_allclose(left, np.where(np.arange(len(left)) % 2, -0.4, 0.4))
    np.testing.assert_allclose(right, np.where(np.arange(len(right)) % 3 == 0, -0.3, 0.3))


def test_unsuitable_layout_keys_are_refused_with_a_remedy(board):
    with refused("expect.time-rest", FileError):
        run_of_board(board, 'unit = "ns" }', 'unit = "deg" }')
    with refused("expect.wraps", FileError):
        run_of_board(board, "derivative = true, wraps", "wraps")


def wheels_by(board, entry):
    text = MAP
    for side in "lr":
        old = f'{{ column = "ticks_{side}", unit = "raw", scale = 0.001, derivative = true, wraps = 65536 }}'
        assert old in text
        text = text.replace(old, f'{{ column = "ticks_{side}", {entry} }}')
    path = board / "board.toml"
    path.write_text(text, encoding="utf-8")
    return import_run(path, [board / "log.csv"]).run.sensors["wheels"].z


COUNTER = "radius_m = 0.04, derivative = true, wraps = 65536"


@pytest.mark.parametrize(
    "reading",
    [
        'unit = "counts", counts_per_turn = 600',
        'unit = "ticks", counts_per_turn = 600',
        'unit = "counts", counts_per_turn = 1200, scale = 2.0',
        'unit = "raw", scale = 0.010471975511966',
        'unit = "rad", scale = 0.010471975511966',
        'unit = "deg", scale = 0.6',
        'unit = "rev", scale = 0.00166666666666666667',
    ],
)
def test_encoder_readings_in_every_unit_give_the_same_rim_speed(board, reading):
    expected = run_of_board(board).sensors["wheels"].z / 0.001 * (2.0 * np.pi / 600.0) * 0.04
    assert np.max(np.abs(expected)) > 0.5
    np.testing.assert_allclose(wheels_by(board, f"{reading}, {COUNTER}"), expected, rtol=1e-9)


def test_an_angle_that_exceeds_one_turn_is_not_unwrapped(board):
    log = board / "log.csv"
    lines = log.read_text(encoding="utf-8").splitlines()
    counts = 200.0 * (0.02 * np.arange(400))  # 4 rad from row to row: beyond half a turn
    rows = [f"{line.rsplit(',', 2)[0]},{a:.6f},{-a:.6f}" for line, a in zip(lines[1:], counts, strict=True)]
    log.write_text("\n".join([lines[0], *rows]), encoding="utf-8")
    z = wheels_by(board, 'unit = "rad", radius_m = 0.04, derivative = true')
    np.testing.assert_allclose(z, np.tile([8.0, -8.0], (len(z), 1)), rtol=1e-4)


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        (f'unit = "counts", {COUNTER}', ("map.missing", {})),
        (f'unit = "counts", counts_per_turn = 0.0, {COUNTER}', ("map.wrong", {"value": "0.0"})),
        (f'unit = "rad", counts_per_turn = 600, {COUNTER}', ("expect.no-counts", {})),
        ('unit = "counts", counts_per_turn = 600', ("expect.measures-or-rate-of-rolling", {})),
        ('unit = "counts", counts_per_turn = 600, radius_m = 0.04', ("expect.measures-or-rate", {})),
        ('unit = "counts", counts_per_turn = 600, derivative = true', ("expect.measures-or-rolls", {})),
        (f'unit = "pulse", counts_per_turn = 600, {COUNTER}', ("expect.listed-unit-of", {})),
        (f'unit = "m", {COUNTER}', ("expect.radius", {})),
    ],
)
def test_incomplete_encoder_settings_are_refused_with_a_remedy(board, entry, message):
    with refused(message[0], FileError, **message[1]):
        wheels_by(board, entry)


def test_an_infinite_count_is_treated_as_missing(board):
    log = board / "log.csv"
    lines = log.read_text(encoding="utf-8").splitlines()
    lines[10] = lines[10].rsplit(",", 1)[0] + ",inf"
    log.write_text("\n".join(lines), encoding="utf-8")
    z = wheels_by(board, f'unit = "counts", counts_per_turn = 600, {COUNTER}')
    assert len(z) == 397  # the first row lacks a rate, and two rates need the lost count
    assert np.isfinite(z).all()


@pytest.mark.parametrize(
    ("name", "si"),
    [
        ("rps", 2.0 * np.pi),
        ("rev/s", 2.0 * np.pi),
        ("turn", 2.0 * np.pi),
        ("r/min", np.pi / 30.0),
        ("deg/sec", np.pi / 180.0),
        ("RPM", np.pi / 30.0),
        ("U/min", np.pi / 30.0),
        ("KM/H", 1.0 / 3.6),
    ],
)
def test_common_unit_names_of_boards_are_accepted(name, si):
    assert unit(name).si_factor == pytest.approx(si)


@pytest.mark.parametrize("name", ["MV", "MS", "M", "foo"])
def test_short_unit_names_are_case_sensitive(name):
    assert unit(name) is None


def test_an_unknown_unit_is_refused_with_suitable_units(board):
    with refused("expect.measures", FileError, measures="speed"):
        wheels_by(board, 'unit = "ppr"')


def test_interpolation_does_not_unwrap_the_rate_of_an_angle(tmp_path):
    yaw_deg = np.cumsum(np.tile([25.0, 25.0, -25.0, -25.0], 15))  # ± 4.4 rad/s: steps of more than π
    rows = "".join(f"{0.1 * k:.1f},{k % 5 / 10},{yaw:g}\n" for k, yaw in enumerate(yaw_deg))
    (tmp_path / "log.csv").write_text("t,u,yaw\n" + rows, encoding="utf-8")
    gyro = '{ column = "yaw", unit = "deg", derivative = true }'
    z = f'z = [{{ constant = nan }}, {{ constant = nan }}, {gyro}]\nsample = "linear"'
    (tmp_path / "log.toml").write_text(
        'format = 1\n[files.log]\ntime = "t"\ntime_unit = "s"\n'
        '[command]\nin_force = "from"\nnames = ["u"]\nu = [{ column = "u", unit = "1" }]\n'
        f"[sensors.imu]\n{z}\n",
        encoding="utf-8",
    )
    rates = import_run(tmp_path / "log.toml", [tmp_path / "log.csv"]).run.sensors["imu"].z[:, 2]
    assert abs(np.mean(rates)) < 0.1


@pytest.mark.parametrize("lowest_us", [0, -(2**31)])
def test_a_counter_of_microseconds_that_overflows_is_unwrapped(lab, lowest_us):
    first = lab.run().run
    count = np.round(lab.board["t"] * 1e6).astype(np.int64)
    shift_s = (2**32 + lowest_us - int(count[700])) * 1e-6
    lab.board["t"] = [str((k + 2**32 - int(count[700])) % 2**32 + lowest_us) for k in count.tolist()]
    lab.camera["t"] = lab.camera["t"] + shift_s
    board_unit = (
        'time = "t"\ntime_unit = "s"\n[files.camera]',
        'time = "t"\ntime_unit = "us"\n[files.camera]',
    )
    run, findings = lab.edit("start_ns = 1000000000", "start_ns = 3000000000000").edit(*board_unit).run()
    assert findings[0].code == "counter overflow"
    assert includes(findings[0].reason, "recording.counter-overflow", table="board.csv", count=1, line=702)
    assert len(run.t_ns) == len(first.t_ns)
    assert np.abs(run.t_s - first.t_s).max() < 2e-6
