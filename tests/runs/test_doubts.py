"""Data that contradict a map are refused with a remedy; unusual data give a warning that the run stores."""

import numpy as np
import pytest

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


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (in_scale("wz", DEG), r"imu.z\[2\] .*write unit = \"deg/s\""),
        (in_scale("wz", 1 / DEG), r"is 0.0174 times what \[truth\] says .*\"rad/s\" is too small by a factor of 57.3"),
        (in_scale("wz", -1.0), r"imu.z\[2\] is -.* times what \[truth\] says .*write scale = -1 for it"),
        (in_scale("wz", 1.7), r"imu.z\[2\] is 1.7 times .*check its unit and scale"),
        (in_scale("speed", 3.6), r"odometer.z\[0\] is 3.6 times .*write unit = \"km/h\""),
        (in_scale("speed", 100.0), r"reaches 16\d m/s"),
        (in_scale("speed", -1.0), r"odometer.z\[0\] is -.*write scale = -1"),
        (in_scale("ay", 1 / 9.80665), r"imu.z\[1\] is 0.10\d times what speed and .*write unit = \"g\""),
        (in_scale("ay", 0.03), r"check its unit and scale, and those of the speed, \[sensors.odometer\]"),
        (in_scale("ay", -1.0), r"imu.z\[1\] is -.*write scale = -1"),
        (in_scale("ax", 1000.0), r"imu.z\[0\] with unit = .* reaches"),
        (swap_columns("board", "ax", "ay"), r"imu.z\[0\] agrees with v·ω .*swap the columns of a_x and a_y"),
        (swap_columns("board", "throttle", "steer"), r"command throttle turns .*swap the columns of \[command\]"),
        (in_scale("throttle", 100.0), r"\(throttle\) reaches 6\d.*a full command is 1; write unit = \"%\""),
        (in_scale("throttle", 2000.0), r"\(throttle\) reaches .* write scale = 0.000"),
        (swap_columns("camera", "x", "y"), r"course and heading turn opposite ways .*x and y are swapped"),
        (camera("yaw", -1.0), "course and heading turn opposite ways|times what .truth. says"),
        (camera("yaw", DEG), r"\[truth\] eta\[2\]: .*perhaps unit = \"deg\"|perhaps unit = \"deg\""),
    ],
)  # fmt: skip
def test_data_that_contradict_the_map_are_refused_with_a_remedy(lab, damage, message):
    damage(lab)
    assert "accept = [" in lab.refused(message)


def test_positions_in_millimetres_given_as_metres_are_refused(lab):
    lab.camera["x"], lab.camera["y"] = 1e3 * lab.camera["x"], 1e3 * lab.camera["y"]
    lab.refused(r"positions change by .* m/s; perhaps unit = \"mm\"")


def test_a_camera_rotated_against_the_heading_is_refused(lab):
    lab.camera["yaw"] = lab.camera["yaw"] - np.pi / 2
    lab.refused(
        r"differs from the heading by -?90° \(or \d+°\); write offset = -?1.57\d for the yaw, or -?1.57"
    )
    assert lab.edit('"yaw", unit = "rad"', '"yaw", unit = "rad", offset = 1.571').codes() == [
        "no command yet"
    ]


def test_an_accepted_contradiction_is_imported_with_a_warning(lab):
    lab.board["wz"] = -lab.board["wz"]
    message = lab.refused("If the map is right, write at its top: accept = ")
    lab.map = 'accept = ["inverted"]\n' + lab.map
    assert message.endswith('accept = ["inverted"]')
    assert lab.run().verdict == "WARN"
    (doubt,) = (d for d in lab.run().doubts if d.code == "inverted")
    assert doubt.level == "warning"
    assert doubt.text.endswith("(accepted by the map)")


def test_rows_with_decreasing_time_are_refused_or_left_out(lab):
    for column in lab.board.values():
        column[600:] = column[580:-20].copy()
    lab.refused(r"time steps back by 0.380 s at line 602 \(1 such steps\).*backwards = \"drop\"")
    run, doubts = lab.edit('path = "board.csv"', 'path = "board.csv"\nbackwards = "drop"').run()
    assert doubts[0].code == "time steps back"
    assert len(run.sensors["imu"].t_ns) == 1480
    assert (np.diff(run.t_ns) > 0).all()


def test_identical_repeated_rows_are_left_out_and_different_repeats_are_refused(lab):
    for name, column in lab.board.items():
        lab.board[name] = np.repeat(column, np.where(np.arange(1500) % 500 == 7, 2, 1))
    run, doubts = lab.run()
    assert "3 rows repeat the time of the row before, the first at line 10" in doubts[0].text
    assert len(run.sensors["imu"].t_ns) == 1500
    lab.board["ax"][8] += 1.0
    lab.refused(r"at line 10 with other values. .*repeats = \"first\" or repeats = \"last\"")
    imu_by_choice = {}
    for which in ("first", "last"):
        repeated_lab = lab.fresh().edit('path = "board.csv"', f'path = "board.csv"\nrepeats = "{which}"')
        repeated_lab.board = lab.board
        imu_by_choice[which] = repeated_lab.run().run.sensors["imu"].z[7, 0]
    assert imu_by_choice["last"] - imu_by_choice["first"] == pytest.approx(1.0)


def test_gaps_are_reported_with_their_line_and_duration(lab):
    keep = np.ones(1500, dtype=bool)
    keep[100:105] = keep[700] = False
    lab.board = {name: column[keep] for name, column in lab.board.items()}
    run, doubts = lab.run()
    gaps = [d for d in doubts if d.code == "gap"]
    assert [d.text for d in gaps] == [
        "board.csv: 0.120 s without a row after line 101 (usual step 0.020 s)",
        "board.csv: 0.040 s without a row after line 696 (usual step 0.020 s)",
    ]
    assert [e.t_ns for e in run.events if e.text.startswith("gap")] == [2_980_000_000, 14_980_000_000]


def test_many_gaps_are_counted(lab):
    keep = np.arange(1500) % 20 != 3
    lab.board = {name: column[keep] for name, column in lab.board.items()}
    gaps = [d.text for d in lab.run().doubts if d.code == "gap"]
    assert len(gaps) == 21
    assert gaps[-1] == "board.csv: and 55 more gaps"


def test_a_clock_jump_in_a_recording_is_refused(lab):
    for columns in (lab.board, lab.camera):
        columns["t"][800:] += 86_400.0
    lab.refused(r"86400.020 s without a row after line 801")


@pytest.mark.parametrize(("factor", "unit"), [(1e3, "ms"), (1e6, "us"), (1e9, "ns")])
def test_a_wrong_unit_of_time_is_refused_with_the_correct_unit(lab, factor, unit):
    for columns in (lab.board, lab.camera):
        columns["t"] = columns["t"] * factor
    message = lab.refused(r"time_unit|beyond 2038")
    assert f'time_unit = "{unit}"' in message or "beyond 2038. Is time_unit" in message


def test_times_before_the_zero_of_the_clock_are_refused(lab):
    lab.board["t"] = lab.board["t"] - 5.5
    lab.edit("start_ns = 1000000000", "")
    lab.refused(r"its first time is -5.500 s, before the zero .* start_ns = 6000000000")


def test_files_without_a_common_time_are_refused(lab):
    lab.camera["t"] = lab.camera["t"] + 1000.0
    lab.refused(
        r"\[truth\] in camera.csv is at 1001.005 s to .*their clocks differ. Write in \[files.camera\]: shift_s"
    )


def test_commands_outside_the_time_of_the_ticks_are_refused(lab):
    lab.camera |= {
        "throttle": lab.board["throttle"],
        "steer": lab.board["steer"],
        "t": lab.camera["t"] + 1000.0,
    }
    lab.edit('[command]\nfile = "board"', '[command]\nfile = "camera"')
    lab.refused(r"none of the ticks of \[files.board\] has a command of \[files.camera\]\. .*shift_s = …")


def test_id4_missing_numbers_are_left_out_and_reported(lab):
    lab.board["ax"][10:13] = np.nan
    lab.camera["yaw"] = [f"{x:.6f}" for x in lab.camera["yaw"]]
    lab.camera["yaw"][5] = ""
    run, doubts = lab.run()
    assert [d.text for d in doubts if d.code == "missing"] == [
        "[sensors.imu]: 3 of 1500 rows lack a number (NaN, empty) and were left out",
        "[truth]: 1 of 1500 rows lack a number (NaN, empty) and were left out",
    ]
    assert len(run.sensors["imu"].t_ns) == 1497
    assert len(run.sensors["odometer"].t_ns) == 1500
    lab.board["ax"][:] = np.nan
    lab.refused(r"\[sensors.imu\] does not have a complete row of numbers")


def test_rows_without_a_time_are_left_out_and_reported(lab):
    lab.board["t"][4:6] = np.nan
    assert "board.csv: 2 rows without a time were left out" in [d.text for d in lab.run().doubts]


def test_repeated_samples_are_reported(lab):
    for name in ("ax", "ay", "wz"):
        lab.board[name] = np.repeat(lab.board[name][::5], 5)
    (doubt,) = (d for d in lab.run().doubts if d.code == "held samples")
    figures = doubt.reason.figures
    assert (doubt.reason.code, round(figures["share"], 2), round(figures["every"], 1)) == (
        "recording.held",
        0.8,
        5.0,
    )
    assert "write new_when" in doubt.advice


def test_a_stationary_vehicle_is_not_reported_as_repeated_samples(lab):
    for name in ("ax", "ay", "wz", "speed"):
        lab.board[name][:1000] = 0.0
    assert "held samples" not in lab.codes()


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
    texts = [d.text for d in lab.run().doubts if d.code == "constant"]
    assert texts == [
        "[sensors.imu] number 0: 0 in all 1500 rows; is it wired?",
        "command throttle is 0.25 all the time",
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
    """A clock that is 0.15 s off made the slope 0.98 times its own."""
    lab.board["wz"] = 1.034 * lab.board["wz"]
    lab.camera["t"] = lab.camera["t"] - 0.152
    texts = {d.code: d.text for d in lab.run().doubts}
    assert "sensors.imu.z[2] is 1.03 times what [truth] says" in texts["scale"]
    (clock,) = (d for d in lab.run().doubts if d.code == "clock" and "imu.z[2]" in d.text)
    assert clock.level == "info"
    shift_s = float(clock.cure.removeprefix("write shift_s = ").removesuffix(" in [files.camera]"))
    assert shift_s == pytest.approx(0.152, abs=0.011)  # it is looked for in steps of 10 ms


def test_a_positive_steering_to_the_right_is_reported(lab):
    lab.board["steer"] = -lab.board["steer"]
    assert any("positive steering turns right" in d.text for d in lab.run().doubts)


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
    assert "held samples" not in lab.codes()


def test_encoder_samples_read_too_often_are_reported_as_repeated(lab):
    speed = 0.005 * np.round(lab.board["speed"] / 0.005)
    lab.board["speed"] = speed[np.arange(1500) // 3 * 3]
    assert "held samples" in lab.codes()


def test_import_warnings_have_a_table_and_rows(lab):
    imported_log = lab.run()
    assert imported_log.verdict == "USABLE"
    assert imported_log.table().startswith("info     no command yet")
    assert imported_log.rows()[0] == {
        "level": "info", "doubt": "no command yet", "t_s": 0.0,
        "text": "1 ticks before the first command were left out",
    }  # fmt: skip


def by_wheels(lab, track_m=0.3, truth=False):
    """The same car with wheel speeds instead of an odometer, and without a camera unless requested."""
    odometer = lab.map[lab.map.index("[sensors.odometer]") : lab.map.index("[truth]")]
    wheels = '[sensors.wheels]\nfile = "board"\nz = [{ column = "l", unit = "m/s" }, { column = "r", unit = "m/s" }]\n'
    lab.map = lab.map.replace(odometer, wheels)
    if not truth:
        lab.map = lab.map[: lab.map.index("[truth]")]
    half = 0.5 * track_m * lab.recording()[0]["wz"]
    lab.board |= {"l": lab.board["speed"] - half, "r": lab.board["speed"] + half}
    return lab


@pytest.mark.parametrize("track_m", [0.08, 0.3, 1.5])
@pytest.mark.parametrize("truth", [True, False])
def test_wheels_consistent_with_the_gyro_give_no_warning(lab, track_m, truth):
    assert by_wheels(lab, track_m, truth).codes() == ["no command yet"]


def test_an_inverted_gyro_is_detected_by_wheels_and_accelerometer(lab):
    lab.board["wz"] = -lab.board["wz"]
    message = by_wheels(lab).refused(
        r"\[sensors.wheels\] and sensors.imu.z\[2\] have opposite signs .*and sensors.imu.z\[1\] contradicts it"
    )
    assert "write scale = -1 for sensors.imu.z[2]" in message
    assert "sensors.imu.z[1] is" not in message
    mended_lab = lab.edit('"wz", unit = "rad/s"', '"wz", unit = "rad/s", scale = -1')
    assert mended_lab.codes() == ["no command yet"]


@pytest.mark.parametrize("flip", ["wheels", "imu"])
def test_swapped_wheels_or_an_inverted_imu_are_both_named_as_causes(lab, flip):
    by_wheels(lab)
    if flip == "imu":
        lab.board["wz"], lab.board["ay"] = -lab.board["wz"], -lab.board["ay"]
    else:
        lab.board["l"], lab.board["r"] = lab.board["r"], lab.board["l"]
    message = lab.refused(
        r"opposite signs of the turning \(correlation -\d.\d\d\).*if the IMU is upside down"
    )
    assert "swap left and right of [sensors.wheels]" in message
    assert "times what speed and turning give" not in message


def test_swapped_wheels_are_detected_by_the_camera(lab):
    by_wheels(lab, truth=True)
    lab.board["l"], lab.board["r"] = lab.board["r"], lab.board["l"]
    lab.refused(
        r"\[sensors.wheels\] and \[truth\] have opposite signs .*; swap left and right of \[sensors.wheels\]"
    )


@pytest.mark.parametrize(("factor", "width_m"), [(1 / 40, "0.0075"), (40.0, "12")])
def test_wheels_with_an_impossible_yaw_rate_are_refused(lab, factor, width_m):
    by_wheels(lab, truth=False)
    for side in "lr":
        lab.board[side] = factor * lab.board[side]
    message = lab.refused(
        rf"with wheels that are {width_m}\d* m apart .*check the scale of both: counts_per_turn, radius_m"
    )
    assert "accept = [" in message


def test_wheels_uncorrelated_with_the_gyro_are_reported(lab):
    by_wheels(lab)
    noise = np.random.default_rng(2).normal(size=1500)
    lab.board["r"] = lab.board["l"] + noise
    (doubt,) = (d for d in lab.run().doubts if d.code == "unrelated")
    assert "[sensors.wheels] and sensors.imu.z[2] disagree on the turning (correlation" in doubt.text
