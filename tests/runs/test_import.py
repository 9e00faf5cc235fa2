"""An import follows its map and refuses data outside the map, with a remedy."""

import numpy as np
import pytest

from baqueano.errors import FileError
from baqueano.messages import text
from baqueano.runs import import_run, read_run, write_run
from baqueano.runs.maps.column_map import load_map, maps_folder
from tests.codes import includes, refused


def test_a_clean_recording_gives_no_warning(lab):
    run, findings = lab.run()
    assert [d.code for d in findings] == ["no command yet"]
    assert len(run.t_ns) == 1499
    assert run.t_ns[0] == 1_020_000_000
    assert run.applied_commands[0].tolist() == [
        float(format(lab.board[c][0], ".9g")) for c in ("throttle", "steer")
    ]
    assert run.sensors["imu"].t_ns[0] == 1_000_000_000
    assert run.truth.t_ns[0] == 1_005_000_000
    assert run.truth.eta[5, 0] == float(format(lab.camera["x"][5], ".9g"))
    assert np.isnan(run.truth.nu).all()
    assert np.isnan(run.truth.nu_dot).all()


def test_an_imported_run_is_stored_with_its_map(lab, tmp_path):
    run = lab.run().run
    read_back = read_run(write_run(run, tmp_path / "0001-import.mcap"))
    assert read_back == run
    assert read_back.metadata["kind"] == "import"
    assert read_back.metadata["map_text"] == lab.map
    assert read_back.metadata["files"] == "board.csv, camera.csv"
    assert includes(read_back.events[0].diagnostic, "recording.no-command-yet", count=1)


def test_a_command_valid_until_the_time_of_its_row_acts_one_tick_earlier(lab):
    run = lab.run().run
    until_run = lab.edit('in_force = "from"', 'in_force = "until"').run().run
    assert until_run.t_ns[1] == run.t_ns[0]
    assert np.array_equal(until_run.applied_commands[:-1], run.applied_commands)


def test_units_scales_offsets_and_switches_are_applied_at_import(lab):
    lab.board["wz"] = np.degrees(lab.board["wz"])
    lab.board["speed"] = lab.board["speed"] * 3.6
    lab.board["ay"] = -lab.board["ay"] / 9.80665 * 1000
    lab.board["safe"] = np.repeat([1.0, 0.0], 750)
    lab.edit('"wz", unit = "rad/s"', '"wz", unit = "°/s"').edit(
        '"speed", unit = "m/s"', '"speed", unit = "km/h"'
    )
    lab.edit('"ay", unit = "m/s^2"', '"ay", unit = "mg", scale = -1, offset = 0.5')
    lab.edit('"throttle", unit = "1"', '"throttle", unit = "1", times = "safe"')
    run, findings = lab.run()
    fresh = lab.fresh().run().run
    assert [d.code for d in findings] == ["no command yet"]
    expected = fresh.sensors["imu"].z + np.array([0.0, 0.5, 0.0])
    assert run.sensors["imu"].z == pytest.approx(expected, abs=1e-6)
    assert run.sensors["odometer"].z == pytest.approx(fresh.sensors["odometer"].z, abs=1e-7)
    assert np.all(run.applied_commands[751:, 0] == 0.0)
    assert np.all(run.applied_commands[:749, 0] != 0.0)


def test_only_selected_rows_are_read_and_repeated_rows_are_removed(lab):
    board = {name: np.repeat(column, 2) for name, column in lab.board.items()}
    board["count"] = np.floor(np.arange(3000) / 2)
    board["t"] = np.arange(3000) * 0.01
    lab.board = {name: np.concatenate([column, column]) for name, column in board.items()}
    lab.board["id"] = np.repeat([3.0, 4.0], 3000)
    lab.edit('path = "board.csv"', 'path = "board.csv"\nwhere = { id = 3 }\nnew_when = "count"')
    run, findings = lab.run()
    assert [d.code for d in findings] == ["no command yet"]
    assert len(run.sensors["imu"].t_ns) == 1500


@pytest.mark.parametrize(
    ("limits", "count"), [("{ min = 1.0 }", 1450), ("{ max = 0.99 }", 50), ("{ not = 0.0 }", 1499)]
)
def test_the_where_key_accepts_minimum_maximum_and_excluded_value(lab, limits, count):
    lab.edit('path = "board.csv"', f'path = "board.csv"\nwhere = {{ t = {limits} }}').edit(
        "start_ns = 1000", "start_ns = 2000"
    )
    assert len(lab.run().run.sensors["imu"].t_ns) == count


def test_a_slow_signal_is_repeated_or_interpolated_at_the_ticks(lab):
    lab.camera = {name: column[::10] for name, column in lab.camera.items()}
    measured_run = lab.run().run
    assert len(measured_run.truth.t_ns) == 150
    lab.edit("[truth]", '[truth]\nsample = "hold"')
    imported_run = lab.run().run
    assert set(imported_run.truth.t_ns) <= set(measured_run.t_ns)
    assert set(imported_run.truth.eta[:, 0]) <= set(measured_run.truth.eta[:, 0])
    lab.edit('sample = "hold"', 'sample = "linear"')
    slow_run = lab.run().run
    truth = np.interp(
        slow_run.truth.t_ns, 1e9 + 1e9 * (lab.recording()[1]["t"] + 0.002), lab.recording()[1]["x"]
    )
    assert slow_run.truth.eta[:, 0] == pytest.approx(truth, abs=0.02)
    assert np.abs(slow_run.truth.eta[:, 2]).max() <= np.pi


def test_a_rate_is_derived_from_an_angle_across_pi(lab):
    psi = np.cumsum(lab.board["wz"]) * 0.02
    lab.board["imu yaw"] = np.degrees(np.mod(psi, 2 * np.pi))
    steps = lab.run().run.sensors["imu"].z[1:, 2]
    lab.edit('"wz", unit = "rad/s"', '"imu yaw", unit = "deg", derivative = true')
    imu = lab.run().run.sensors["imu"]
    assert imu.z[:, 2] == pytest.approx(0.5 * (steps[:-1] + steps[1:]), abs=1e-5)
    assert np.array_equal(imu.arrival_ns[:-1], imu.t_ns[1:])  # the rate at a row needs the next row


def test_a_rate_of_a_scaled_wrapped_angle_is_correct_across_pi(lab):
    psi = np.cumsum(lab.board["wz"]) * 0.02
    lab.board["imu yaw"] = np.degrees(np.mod(psi, 2 * np.pi))
    lab.board["imu yaw"][40] = 999.0  # one bad row is not an angle beyond a turn
    steps = lab.run().run.sensors["imu"].z[1:, 2]
    lab.edit('"wz", unit = "rad/s"', '"imu yaw", unit = "deg", derivative = true, scale = 1.02')
    sound = np.delete(np.arange(1498), [38, 39, 40])
    rate = lab.run().run.sensors["imu"].z[:, 2]
    assert rate[sound] == pytest.approx(0.51 * (steps[:-1] + steps[1:])[sound], abs=1e-5)


def test_the_velocity_of_a_truth_by_derivative_is_that_of_its_own_instant(lab):
    """ν̇ = 0.8 m/s², in steps of 5 and 20 ms: a parabola, for which the derivative is exact."""
    t_s = np.cumsum(np.tile([0.005, 0.02], 500))
    lab.camera = {"t": t_s, "x": 0.4 * t_s**2, "y": 0.0 * t_s, "yaw": 0.0 * t_s}
    rate = '[{ column = "x", unit = "m", derivative = true }, { constant = 0.0 }, { constant = 0.0 }]'
    lab.edit("[truth]\n", f"[truth]\nnu = {rate}\n")
    truth = lab.run().run.truth
    assert truth.nu[:, 0] == pytest.approx(0.8 * (truth.t_ns * 1e-9 - 1.002), abs=1e-5)


def test_a_heading_is_computed_from_a_quaternion(lab):
    half = 0.5 * lab.camera.pop("yaw")
    lab.camera |= {"qx": 0 * half, "qy": 0 * half, "qz": np.sin(half), "qw": np.cos(half)}
    lab.edit('{ column = "yaw", unit = "rad" }', '{ quaternion = ["qx", "qy", "qz", "qw"] }')
    assert lab.run().run.truth.eta[:, 2] == pytest.approx(lab.recording()[1]["yaw"], abs=1e-8)


def test_integer_nanoseconds_are_read_exactly(lab):
    start = 1_539_614_088_900_197_999
    for columns in (lab.board, lab.camera):
        columns["t"] = [str(start + 20_000_001 * k) for k in range(1500)]
    lab.edit('time_unit = "s"', 'time_unit = "ns"').edit("shift_s = 0.002", "").edit(
        "start_ns = 1000000000", ""
    )
    assert lab.run().run.sensors["imu"].t_ns[:2].tolist() == [start, start + 20_000_001]


def test_milliseconds_since_1970_that_are_declared_as_seconds_are_refused_with_their_unit(lab):
    lab.board["t"] = [str(1_700_000_000_000 + 20 * k) for k in range(1500)]
    lab.refused("import.beyond-2038", unit_name="s")


def test_a_truth_of_one_pose_is_imported(lab):
    lab.camera = {name: column[10:11] for name, column in lab.camera.items()}
    assert len(lab.run().run.truth.t_ns) == 1


def test_dates_are_accepted_as_times(lab):
    for columns in (lab.board, lab.camera):
        columns["t"] = [
            str(np.datetime64("2024-01-22T11:39:01") + np.timedelta64(20 * k, "ms")) for k in range(1500)
        ]
    lab.edit('time_unit = "s"', 'time_unit = "iso8601"').edit("start_ns = 1000000000", "")
    assert lab.run().run.sensors["imu"].t_ns[0] == 1_705_923_541_000_000_000
    lab.board["t"][1] = ""
    (missing_time,) = (d.reason for d in lab.run().findings if d.code == "no time")
    assert includes(missing_time, "recording.no-time", count=1)
    lab.board["t"][0] = "yesterday"
    lab.refused("import.iso8601", column="t", value="yesterday")


@pytest.mark.parametrize(
    "date_text",
    [
        lambda t: t.replace("T", " ").replace(".", ","),  # the logging of Python
        lambda t: f"{t[8:10]}/{t[5:7]}/{t[:4]} {t[11:]}",
        lambda t: (
            f"{int(t[5:7])}/{int(t[8:10])}/{t[:4]} {int(t[11:13]) % 12 or 12}{t[13:]} "
            + ("PM" if int(t[11:13]) >= 12 else "AM")
        ),
        lambda t: t[11:],  # a time of day
    ],
)
def test_dates_of_loggers_and_spreadsheets_are_accepted_as_times_also_across_midnight(lab, date_text):
    expected = lab.run().run
    for columns in (lab.board, lab.camera):
        first = np.datetime64("2024-05-03T23:59:51.000") + np.timedelta64(round(1e3 * columns["t"][0]), "ms")
        columns["t"] = [f'"{date_text(str(first + np.timedelta64(20 * k, "ms")))}"' for k in range(1500)]
    lab.edit('time_unit = "s"', 'time_unit = "iso8601"').edit("start_ns = 1000000000", "")
    run = lab.run().run
    assert np.array_equal(np.diff(run.t_ns), np.diff(expected.t_ns))
    assert np.array_equal(run.applied_commands, expected.applied_commands)
    assert len(run.truth.t_ns) == len(expected.truth.t_ns)


def test_times_in_whole_seconds_are_refused_with_the_rate_of_the_rows(lab):
    lab.board["t"] = np.floor(lab.board["t"])
    lab.refused("import.coarse-time", count=30, rows=1500, rate_hz=50.0, file="board")


@pytest.mark.parametrize(
    ("zone", "away_h"),
    [
        ("Z", 0.0),
        ("z", 0.0),
        (" UTC", 0.0),
        ("+00:00", 0.0),
        ("-03:00", -3.0),
        (" -0300", -3.0),
        ("+0530", 5.5),
        ("+02", 2.0),
        (" ", 0.0),
    ],
)
def test_dates_with_different_time_zones_give_the_same_instant(lab, zone, away_h):
    for columns in (lab.board, lab.camera):
        first = np.datetime64("2024-01-22T11:39:01") + np.timedelta64(round(60 * away_h), "m")
        columns["t"] = [f"{first + np.timedelta64(20 * k, 'ms')}{zone}" for k in range(1500)]
    lab.edit('time_unit = "s"', 'time_unit = "iso8601"').edit("start_ns = 1000000000", "")
    assert lab.run().run.sensors["imu"].t_ns[0] == 1_705_923_541_000_000_000


PATH, RATE, YAW = 'path = "board.csv"', '"wz", unit = "rad/s"', '{ column = "yaw", unit = "rad" }'


GYRO, SECONDS = "sensors.imu.z[2]", 'time_unit = "s"'


def map_error(place, value, expected, **figures):
    """A value that the map does not permit, and the expected value."""
    return "map.wrong", {"map": "lab.toml", "place": place, "value": value}, expected, figures


def missing(place, expected, **figures):
    return "map.missing", {"map": "lab.toml", "place": place}, expected, figures


def unknown(place, suggestion):
    return "map.unknown-key", {"map": "lab.toml", "place": place}, "name.near", {"match": suggestion}


def case(code, **figures):
    return code, figures, code, figures


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ("format = 1", "format = 2", map_error("format", "2", "expect.format")),
        ("format = 1", "", missing("format", "expect.format")),
        ("format = 1", "format = = 1", case("map.not-toml", error="Invalid value (at line 2, column 10)")),
        ("[command]", "[comand]", unknown("comand", "command")),
        ("[files.board]", "[files]\nboard = 3\n[files.bord]",
         map_error("[files.board]", "3", "expect.table", key="files.board")),
        (SECONDS, "", missing("[files.board] time_unit", "expect.time-unit", valid="s, ms, us, ns, min")),
        (SECONDS, 'time_unit = "hours"',
         map_error("[files.board] time_unit", "'hours'", "expect.time-unit", valid="s, ms, us, ns, min")),
        ('time = "t"', "", missing("[files.board] time", "expect.time")),
        (PATH, PATH + '\ndecimal = ";"',
         map_error("[files.board] decimal", "';'", "expect.one-of", key="decimal", valid='".", ","')),
        (PATH, PATH + "\nshift = 3", unknown("[files.board] shift", "shift_s")),
        (PATH, PATH + '\nshift_s = "a"', map_error("[files.board] shift_s", "'a'", "expect.type", kind="float")),
        (PATH, 'path = "bored.csv"', case("import.file-absent", file="board", absent_path="bored.csv")),
        (PATH, PATH + '\ntopic = "/imu"', case("import.no-bag", path="board.csv", file="board", topic="/imu")),
        (PATH, PATH + "\nshift_s = inf", map_error("[files.board] shift_s", "inf", "expect.finite")),
        (RATE, RATE + ", scale = nan", map_error(f"[{GYRO}] scale", "nan", "expect.finite")),
        (PATH, PATH + '\ndelimiter = ", "', map_error("[files.board] delimiter", "', '", "expect.delimiter")),
        (PATH, PATH + '\nencoding = "klingon"', case("table.encoding", file="board.csv", encoding="klingon")),
        (PATH, PATH + "\nwhere = { id = { above = 3 } }", case("import.where", file="board", column="id")),
        (PATH, PATH + "\nwhere = { id = 7 }", case("import.where-empty", table="board.csv", condition="{'id': 7}")),
        ('in_force = "from"', "", missing("[command] in_force", "expect.in-force")),
        ('names = ["throttle", "steering"]', 'names = ["throttle"]',
         map_error("[command] names", "['throttle']", "expect.names", count=2)),
        ('[ticks]\nfile = "board"', "", missing("ticks", "expect.ticks")),
        ('[ticks]\nfile = "board"', '[ticks]\nfile = "bord"',
         map_error("[ticks] file", "'bord'", "expect.file", first="board")),
        ("[sensors.imu]", "[sensors.imu]\nrate = 3", unknown("[sensors.imu] rate", "sample")),
        ("[sensors.imu]", "[sensors.1mu]", map_error("[sensors.1mu]", "'1mu'", "expect.sensor-name")),
        (RATE, '"wz"', missing(f"{GYRO} unit", "expect.unit-of", valid="rad/s, deg/s, mrad/s, rpm, turn/s")),
        (RATE, '"wz", unit = "rad"',
         map_error(f"{GYRO} unit", "'rad'", "expect.measures-or-rate", measures="angular rate")),
        (RATE, '"wz", unit = "radps"',
         map_error(f"{GYRO} unit", "'radps'", "expect.listed-unit-of", suggestion="rad/s, rad, mrad/s")),
        (RATE, '"wz", unit = "raw"', missing(f"{GYRO} scale", "expect.scale")),
        ('{ column = "wz", unit = "rad/s" }', '"wz"', map_error(GYRO, "'wz'", "expect.entry")),
        ('column = "wz"', 'quaternion = ["x"], column = "wz"',
         map_error(GYRO, "{'quaternion': ['x'], 'column': 'wz', 'unit': 'rad/s'}", "expect.one-source")),
        (YAW, '{ quaternion = ["q"], unit = "deg" }', map_error("truth.eta[2] unit", "'deg'", "expect.no-unit")),
        (YAW, "", map_error("[truth] eta", "[{'column': 'x', 'unit': 'm'}, {'column': 'y', 'unit': 'm'}]",
                        "expect.entries", count=3, measures="length, length, angle")),
        ("[truth]", '[truth]\nsample = "nearest"', map_error("[truth] sample", "'nearest'", "expect.sample")),
    ],
)  # fmt: skip
def test_a_mistake_in_the_map_is_named_with_a_remedy(lab, old, new, reason):
    lab.map = lab.map.replace(old, new, 1)
    code, figures, expected, figures_of_it = reason
    diagnostic = lab.refused(code, **figures)
    assert includes(diagnostic, expected, **figures_of_it)
    message = text(diagnostic)
    assert "lab.toml" in message or "[files" in message or "board.csv" in message


def test_an_unknown_map_is_refused_with_the_list_of_built_in_maps(tmp_path):
    with refused("map.absent", FileError, value="cpm", absent_path="cpm"):
        load_map("cpm")
    (tmp_path / "x.toml").write_bytes(b"\xff\xfe")
    with refused("map.not-read", FileError):
        load_map(tmp_path / "x.toml")
    with refused("map.folder", FileError):
        load_map(tmp_path)


@pytest.mark.parametrize("path", sorted(maps_folder().glob("*.toml")), ids=lambda path: path.stem)
def test_every_map_of_the_package_can_be_loaded(path):
    assert load_map(path.stem).path == path


def test_a_file_on_the_command_line_fills_the_placeholder_of_the_map(lab):
    lab.save()
    (lab.folder / "board.csv").rename(lab.folder / "today ñ.csv")
    lab.edit('path = "board.csv"\n', "")
    (lab.folder / "lab.toml").write_text(lab.map, encoding="utf-8")
    today = lab.folder / "today ñ.csv"
    assert import_run(lab.folder / "lab.toml", [today]).run.name == "today ñ"
    assert len(import_run(lab.folder / "lab.toml", {"board": today}).run.t_ns) == 1499
    assert len(import_run(lab.folder / "lab.toml", [f"board={today}"]).run.t_ns) == 1499
    with refused("import.no-path", FileError):
        import_run(lab.folder / "lab.toml")
    with refused("import.file-shared", FileError, first="board"):
        import_run(lab.folder / "lab.toml", [today, today])
    with refused("import.file-unknown", FileError):
        import_run(lab.folder / "lab.toml", {"bord": today})
    with refused("table.not-read", FileError):
        import_run(lab.folder / "lab.toml", [lab.folder / "gone.csv"])


def test_an_import_without_paths_names_each_file_of_the_map(lab):
    lab.save()
    lab.edit('path = "board.csv"\n', "").edit('path = "camera.csv"\n', "")
    (lab.folder / "lab.toml").write_text(lab.map, encoding="utf-8")
    with refused("import.no-path", FileError) as error_info:
        import_run(lab.folder / "lab.toml")
    assert error_info.value.diagnostic.fix.endswith("lab.toml board=FILE camera=FILE")


def test_recordings_are_searched_in_the_folder_of_the_environment_variable(lab, tmp_path, monkeypatch):
    lab.save()
    folder = tmp_path / "recordings"
    folder.mkdir()
    for name in ("board.csv", "camera.csv"):
        (lab.folder / name).rename(folder / name)
    monkeypatch.setenv("BAQUEANO_DATA", str(folder))
    assert len(import_run(lab.folder / "lab.toml").run.t_ns) == 1499


def test_a_unit_that_contradicts_its_column_name_is_refused(lab):
    lab.board["speed [km/h]"] = 3.6 * lab.board["speed"]
    lab.edit('column = "speed"', 'column = "speed [km/h]"')
    lab.refused("import.unit-of-name", key="sensors.odometer.z[0]", value="m/s", unit_name="km/h")
    assert lab.edit('[km/h]", unit = "m/s"', '[km/h]", unit = "kmh"').codes() == ["no command yet"]
