"""Data that contradict a map are refused with a remedy; unusual data give a warning that the run stores."""

import re

import numpy as np
import pytest

from baqueano.diagnostics import note
from baqueano.runs.importing.recordings import import_runs
from tests.codes import includes

DEG = 180.0 / np.pi


def in_scale(column, factor):
    def damage(lab):
        lab.board[column] = lab.board[column] * factor

    return damage


def camera(column, factor):
    def damage(lab):
        lab.camera[column] = lab.camera[column] * factor

    return damage


def swap_columns(table, a, b):
    def damage(lab):
        columns = getattr(lab, table)
        columns[a], columns[b] = columns[b], columns[a]

    return damage


IMU = [f"sensors.imu.z[{entry}]" for entry in range(3)]
SPEED = "sensors.odometer.z[0]"


def against_truth(key, slope):
    return "recording.against-truth", {"key": key, "slope": pytest.approx(slope, rel=0.01)}


def against_motion(key, slope):
    return "recording.against-motion", {"key": key, "slope": pytest.approx(slope, rel=0.05)}


def too_much(key, value):
    return "recording.too-much", {"key": key, "value": pytest.approx(value, rel=0.01)}


def throttle_of(maximum):
    return "recording.command-range", {"name": "throttle", "maximum": pytest.approx(maximum, rel=0.01)}


def write_unit(unit, key):
    return "recording.write-unit", {"column_unit": unit, "key": key}


UNIT_RATIO = "recording.unit-ratio", {"ratio": pytest.approx(DEG)}
INVERTED = "recording.write-scale", {"scale": "-1"}
MIRRORED = "recording.mirrored", {"mirrored_agreement": pytest.approx(1.0, abs=0.01)}


@pytest.mark.parametrize(
    ("damage", "cause", "line"),
    [
        (in_scale("wz", DEG), against_truth(IMU[2], DEG), write_unit("deg/s", IMU[2])),
        (in_scale("wz", 1 / DEG), against_truth(IMU[2], 1 / DEG), UNIT_RATIO),
        (in_scale("wz", -1.0), against_truth(IMU[2], -1.0), INVERTED),
        (in_scale("wz", 1.7), against_truth(IMU[2], 1.7), ("recording.check-unit-and-scale", {})),
        (in_scale("speed", 3.6), against_truth(SPEED, 3.6), write_unit("km/h", SPEED)),
        (in_scale("speed", 100.0), too_much(SPEED, 161.0), ("recording.possible-line", {"line": 'unit = "mm/s"'})),
        (in_scale("speed", -1.0), against_truth(SPEED, -1.0), INVERTED),
        (in_scale("ay", 1 / 9.80665), against_motion(IMU[1], 1 / 9.80665), write_unit("g", IMU[1])),
        (in_scale("ay", 0.03), against_motion(IMU[1], 0.03),
         ("recording.check-with-speed", {"source": "[sensors.odometer]"})),
        (in_scale("ay", -1.0), against_motion(IMU[1], -1.0), INVERTED),
        (in_scale("ax", 1000.0), too_much(IMU[0], 380.5), write_unit("mm/s^2", IMU[0])),
        (swap_columns("board", "ax", "ay"), ("recording.axes-swapped", {}), ("recording.swap-axes", {})),
        (swap_columns("board", "throttle", "steer"), ("recording.other-steering", {"command": "throttle"}),
         ("recording.swap-commands", {})),
        (in_scale("throttle", 100.0), throttle_of(64.0), ("recording.write-percent-or-full", {"full_command": "255"})),
        (in_scale("throttle", 2000.0), throttle_of(1280.0), ("recording.write-full", {"full_command": "4095"})),
        (swap_columns("camera", "x", "y"), MIRRORED, ("recording.write-mirrored", {})),
        (camera("yaw", -1.0), MIRRORED, ("recording.write-mirrored", {})),
        (camera("yaw", DEG), ("recording.truth-turns", {"rate_rad_s": pytest.approx(78.0, rel=0.01)}),
         ("recording.possible-line", {"line": 'unit = "deg"'})),
    ],
)  # fmt: skip
def test_data_that_contradict_the_map_are_refused_with_a_remedy(lab, damage, cause, line):
    damage(lab)
    reason = lab.refused(cause[0], **cause[1])
    assert includes(reason, line[0], **line[1])
    assert includes(reason, "import.does-not-fit")


def test_positions_in_millimetres_given_as_metres_are_refused(lab):
    lab.camera["x"], lab.camera["y"] = 1e3 * lab.camera["x"], 1e3 * lab.camera["y"]
    reason = lab.refused("recording.truth-fast", speed_m_s=pytest.approx(1581.0, rel=0.01))
    assert includes(reason, "recording.possible-line", line='unit = "mm"')


def test_a_camera_rotated_against_the_heading_is_refused(lab):
    lab.camera["yaw"] = lab.camera["yaw"] - np.pi / 2
    mount_angles = {"offset_deg": pytest.approx(-90.0, abs=0.1), "opposite_deg": pytest.approx(90.0, abs=0.1)}
    reason = lab.refused("recording.camera-turned", **mount_angles)
    assert includes(reason, "recording.write-offset", offset="-1.570", backward_offset="1.572")
    assert lab.edit('"yaw", unit = "rad"', '"yaw", unit = "rad", offset = 1.571').codes() == [
        "no command yet"
    ]


def test_an_accepted_contradiction_is_imported_with_a_warning(lab):
    lab.board["wz"] = -lab.board["wz"]
    reason = lab.refused("import.does-not-fit", codes='"inverted"')
    lab.map = 'accept = ["inverted"]\n' + lab.map
    assert includes(reason, "recording.against-truth", key=IMU[2], slope=pytest.approx(-1.0, rel=0.01))
    assert lab.run().verdict == "WARN"
    (finding,) = (d for d in lab.run().findings if d.code == "inverted")
    assert finding.level == "warning"
    assert finding.reason.code == "recording.accepted"
    assert finding.reason.figures["cause"].code == "recording.against-truth"


def test_rows_with_decreasing_time_are_refused_or_removed(lab):
    for column in lab.board.values():
        column[600:] = column[580:-20].copy()
    lab.refused("import.steps-back", step_s=pytest.approx(0.38), line=602, count=1, rows=19, file="board")
    run, findings = lab.edit('path = "board.csv"', 'path = "board.csv"\nbackwards = "drop"').run()
    assert findings[0].code == "time steps back"
    assert len(run.sensors["imu"].t_ns) == 1480
    assert (np.diff(run.t_ns) > 0).all()


@pytest.mark.parametrize("back_s", [0.1, 0.5, 14.0])
def test_a_clock_that_steps_back_is_split_without_a_loss(lab, back_s):
    lab.board["t"] = np.where(np.arange(1500) < 700, lab.board["t"], lab.board["t"] - back_s)
    lost_rows = min(round(back_s / 0.02) - 1, 699)
    lab.refused("import.clock-back", line=702, count=1, rows=lost_rows)
    lab.edit('path = "board.csv"', 'path = "board.csv"\nsplit_gap_s = 5.0')
    lab.map = re.sub(r"\[files\.camera\].*?(?=\[ticks\])|\[truth\].*", "", lab.map, flags=re.DOTALL)
    runs = import_runs(lab.save())
    assert [len(imported_log.run.sensors["imu"].t_ns) for imported_log in runs] == [700, 800]


def test_late_rows_are_not_a_clock_that_steps_back(lab):
    order = np.arange(1500)
    order[[300, 310, 900]], order[[310, 300, 905]] = order[[310, 300, 905]], order[[300, 310, 900]]
    for name, column in lab.board.items():
        lab.board[name] = column[order]
    lab.refused("import.steps-back")


def test_identical_repeated_rows_are_removed_and_contradicting_repeats_are_refused(lab):
    for name, column in lab.board.items():
        lab.board[name] = np.repeat(column, np.where(np.arange(1500) % 500 == 7, 2, 1))
    run, findings = lab.run()
    assert (findings[0].reason.code, findings[0].reason.figures) == (
        "recording.repeats",
        {"table": "board.csv", "count": 3, "line": 10},
    )
    assert len(run.sensors["imu"].t_ns) == 1500
    lab.board["ax"][8] += 1.0
    lab.refused("import.repeats", count=3, line=10, file="board")
    imu_by_choice = {}
    for entry in ("first", "last"):
        repeated_lab = lab.fresh().edit('path = "board.csv"', f'path = "board.csv"\nrepeats = "{entry}"')
        repeated_lab.board = lab.board
        imu_by_choice[entry] = repeated_lab.run().run.sensors["imu"].z[7, 0]
    assert imu_by_choice["last"] - imu_by_choice["first"] == pytest.approx(1.0)


def test_gaps_are_reported_with_their_line_and_duration(lab):
    keep = np.ones(1500, dtype=bool)
    keep[100:105] = keep[700] = False
    lab.board = {name: column[keep] for name, column in lab.board.items()}
    run, findings = lab.run()
    gaps = [d.reason.figures for d in findings if d.reason.code == "recording.gap"]
    usual = {"table": "board.csv", "usual_s": pytest.approx(0.02)}
    assert gaps == [
        usual | {"gap_s": pytest.approx(0.12), "line": 101},
        usual | {"gap_s": pytest.approx(0.04), "line": 696},
    ]
    assert [e.t_ns for e in run.events if includes(e.diagnostic, "recording.gap")] == [
        2_980_000_000,
        14_980_000_000,
    ]


def test_the_longest_gap_is_reported_first(lab):
    keep = np.arange(1500) % 20 != 3
    keep[1300:1450] = False
    lab.board = {name: column[keep] for name, column in lab.board.items()}
    (first, *_) = (d.reason.figures for d in lab.run().findings if d.code == "gap")
    assert (first["gap_s"], first["line"]) == (pytest.approx(3.02), 1236)


def test_many_gaps_are_counted(lab):
    keep = np.arange(1500) % 20 != 3
    lab.board = {name: column[keep] for name, column in lab.board.items()}
    gaps = [d.reason for d in lab.run().findings if d.code == "gap"]
    assert len(gaps) == 21
    assert (gaps[-1].code, gaps[-1].figures) == ("recording.more-gaps", {"table": "board.csv", "count": 55})


def test_a_clock_jump_in_a_recording_is_refused(lab):
    for columns in (lab.board, lab.camera):
        columns["t"][800:] += 86_400.0
    lab.refused("recording.gap", table="board.csv", gap_s=pytest.approx(86400.02), line=801)


@pytest.mark.parametrize(
    ("factor", "code", "unit"),
    [(1e3, "import.step", "ms"), (1e6, "import.step", "us"), (1e9, "import.beyond-2038", "ns")],
)
def test_a_wrong_unit_of_time_is_refused_with_the_correct_unit(lab, factor, code, unit):
    for columns in (lab.board, lab.camera):
        columns["t"] = columns["t"] * factor
    reason = lab.refused(code, table="board.csv", unit_name="s")
    assert includes(reason, "import.time-unit", unit_name=unit) == (code == "import.step")


def test_negative_times_are_refused_with_a_proposed_start(lab):
    lab.board["t"] = lab.board["t"] - 5.5
    lab.edit("start_ns = 1000000000", "")
    lab.refused("import.before-zero", table="board.csv", t_s=pytest.approx(-5.5), start_ns=6_000_000_000)


def test_files_without_a_common_time_are_refused(lab):
    lab.camera["t"] = lab.camera["t"] + 1000.0
    span = note("import.span", first_s=1001.005, last_s=1030.985)
    lab.refused("import.clocks-differ", key="truth", table="camera.csv", file="camera", span=span)


def test_a_recording_without_commands_during_its_ticks_is_refused(lab):
    lab.camera |= {
        "throttle": lab.board["throttle"],
        "steer": lab.board["steer"],
        "t": lab.camera["t"] + 1000.0,
    }
    lab.edit('[command]\nfile = "board"', '[command]\nfile = "camera"')
    lab.refused("import.no-command", map="lab.toml", ticks="board", commands="camera")


def test_id4_missing_numbers_are_excluded_and_reported(lab):
    lab.board["ax"][10:13] = np.nan
    lab.camera["yaw"] = [f"{x:.6f}" for x in lab.camera["yaw"]]
    lab.camera["yaw"][5] = ""
    run, findings = lab.run()
    assert [d.reason.figures for d in findings if d.reason.code == "recording.missing"] == [
        {"key": "sensors.imu", "excluded_rows": 3, "rows": 1500},
        {"key": "truth", "excluded_rows": 1, "rows": 1500},
    ]
    assert len(run.sensors["imu"].t_ns) == 1497
    assert len(run.sensors["odometer"].t_ns) == 1500
    lab.board["ax"][:] = np.nan
    lab.refused("import.no-row", key="sensors.imu", table="board.csv")


def test_rows_without_a_time_are_removed_and_reported(lab):
    lab.board["t"][4:6] = np.nan
    reasons = [d.reason for d in lab.run().findings]
    assert ("recording.no-time", 2) in [(reason.code, reason.figures.get("count")) for reason in reasons]


def test_repeated_samples_are_reported(lab):
    for name in ("ax", "ay", "wz"):
        lab.board[name] = np.repeat(lab.board[name][::5], 5)
    (finding,) = (d for d in lab.run().findings if d.code == "repeated samples")
    figures = finding.reason.figures
    assert (finding.reason.code, round(figures["share"], 2), round(figures["period_rows"], 1)) == (
        "recording.repeated-rows",
        0.8,
        5.0,
    )
    assert finding.line.code == "recording.write-new-when"


def test_a_stationary_vehicle_is_not_reported_as_repeated_samples(lab):
    for name in ("ax", "ay", "wz", "speed"):
        lab.board[name][:1000] = 0.0
    assert "repeated samples" not in lab.codes()


def test_a_slowly_changing_battery_is_not_reported_as_repeated_samples(lab):
    lab.board["battery"] = 7400.0 - 50.0 * np.floor(np.arange(1500) / 60.0)
    battery = '[sensors.battery]\nfile = "board"\nz = [{ column = "battery", unit = "mV" }]\n'
    lab.edit("[truth]", battery + "[truth]")
    assert lab.codes() == ["no command yet"]
    lab.board["battery"][:] = 7400.0
    assert "constant" in lab.codes()


def test_constant_columns_are_reported(lab):
    lab.board["ax"][:] = 0.0
    lab.board["throttle"][:] = 0.25
    reasons = [d.reason for d in lab.run().findings if d.code == "constant"]
    assert [(reason.code, reason.figures) for reason in reasons] == [
        ("recording.constant", {"key": "sensors.imu", "number": 0, "value": 0.0, "rows": 1500}),
        ("recording.constant-command", {"name": "throttle", "value": 0.25}),
    ]


def test_an_unsigned_speed_and_a_wrong_scale_are_reported(lab):
    lab.board["wz"] = 1.04 * lab.board["wz"]
    v = 0.8 * np.sin(0.5 * lab.board["t"])
    lab.board["speed"], lab.board["ay"] = np.abs(v), lab.board["ay"] * v
    psi = np.cumsum(lab.board["wz"] / 1.04) * 0.02
    lab.camera["x"], lab.camera["y"] = np.cumsum(v * np.cos(psi)) * 0.02, np.cumsum(v * np.sin(psi)) * 0.02
    codes = lab.codes()
    assert "no sign" in codes
    assert "scale" in codes


def test_a_gyro_scale_error_is_reported_despite_a_camera_clock_offset(lab):
    """A clock offset of 0.15 s changed the estimated scale by the factor 0.98."""
    lab.board["wz"] = 1.034 * lab.board["wz"]
    lab.camera["t"] = lab.camera["t"] - 0.152
    findings = lab.run().findings
    (scale,) = (d.reason for d in findings if d.code == "scale")
    assert includes(scale, "recording.against-truth", key=IMU[2], slope=pytest.approx(1.034, rel=0.01))
    (clock,) = (d for d in findings if d.code == "clock" and d.reason.figures["key"] == IMU[2])
    assert clock.level == "info"
    assert clock.line.code == "recording.write-shift"
    assert "file" not in clock.line.figures  # a file can also contain the sensors, which must not be shifted
    shift_s = float(clock.line.figures["shift_s"])
    assert shift_s == pytest.approx(0.152, abs=0.011)  # the search uses steps of 10 ms
    lab.map = lab.map.replace("[truth]", f"[truth]\nshift_s = {shift_s}")
    assert "clock" not in lab.codes()


def test_a_camera_clock_offset_beyond_the_first_range_is_found(lab):
    """The end of the range (0.25 s) was advised as the offset, beside a scale of the gyro that was wrong by 4 %."""
    lab.camera["t"] = lab.camera["t"] - 0.4
    findings = lab.run().findings
    assert "scale" not in [d.code for d in findings]
    (clock,) = (d for d in findings if d.code == "clock" and d.reason.figures["key"] == IMU[2])
    assert float(clock.line.figures["shift_s"]) == pytest.approx(0.4, abs=0.011)


def test_wheels_that_slip_are_not_taken_for_a_clock_offset(lab):
    """Slipping wheels lead the body. Before, a shift of the truth was advised that the gyro contradicts."""
    v = 1.0 + 0.6 * np.sin(0.5 * lab.board["t"])
    lab.board["speed"] = lab.board["speed"] + 0.15 * np.gradient(v, 0.02)
    assert "clock" not in lab.codes()
    lab.map = lab.map[: lab.map.index("[sensors.imu]")] + lab.map[lab.map.index("[sensors.odometer]") :]
    (clock,) = (d for d in lab.run().findings if d.code == "clock")
    assert clock.line.code == "recording.write-shift-without-slip"
    assert clock.reason.figures["key"] == SPEED


def test_positive_steering_that_turns_right_is_reported(lab):
    lab.board["steer"] = -lab.board["steer"]
    (sign,) = (d for d in lab.run().findings if d.reason.code == "recording.turns-right")
    assert sign.line.figures["scale"] == "-1"


def test_a_sensor_uncorrelated_with_the_truth_is_reported(lab):
    lab.board["wz"] = np.random.default_rng(1).normal(size=1500)
    assert "unrelated" in lab.codes()


def test_a_constant_steering_without_a_gyro_is_reported_only_as_constant(lab):
    lab.board["steer"][:] = 0.0
    lab.edit('{ column = "wz", unit = "rad/s" }', "{ constant = nan }")
    assert "constant" in lab.codes()


@pytest.mark.parametrize("step", [0.005, 0.01, 0.03])
def test_encoder_quantisation_is_not_reported_as_repeated_samples(lab, step):
    lab.board["speed"] = step * np.round(lab.board["speed"] / step)
    assert "repeated samples" not in lab.codes()


def test_encoder_samples_read_faster_than_they_change_are_reported_as_repeated(lab):
    speed = 0.005 * np.round(lab.board["speed"] / 0.005)
    lab.board["speed"] = speed[np.arange(1500) // 3 * 3]
    assert "repeated samples" in lab.codes()


def test_import_warnings_are_available_as_a_table_and_as_rows(lab):
    imported_log = lab.run()
    assert imported_log.verdict == "USABLE"
    assert imported_log.table().startswith("info  no command yet")
    assert imported_log.rows()[0] == {
        "level": "info", "finding": "no command yet", "t_s": 0.0,
        "text": "1 ticks before the first command were excluded",
    }  # fmt: skip
