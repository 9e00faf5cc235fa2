"""A draft of a map reads axes and units from gravity, and the names of boats, cars and compasses."""

import re
import tomllib

import numpy as np
import pytest

from baqueano.runs import import_run
from baqueano.runs.importing.draft import draft_map


def drafted(folder, text):
    """Return the tables of the draft for a recording with this text."""
    (folder / "log.csv").write_text(text, encoding="utf-8")
    return tomllib.loads(draft_map(folder / "log.csv"))


@pytest.mark.parametrize(
    ("gravity", "columns", "signs"),
    [
        ((0.0, 0.1, 9.8), ("ax", "ay", "gz"), (1, 1, 1)),
        ((0.3, 0.1, -1.0), ("ax", "ay", "gz"), (1, -1, -1)),
        ((16384, 300, -200), ("ay", "az", "gx"), (1, 1, 1)),
        ((0.1, -9.8, 0.2), ("az", "ax", "gy"), (1, -1, -1)),
        ((0.01, 0.02, 0.05), ("ax", "ay", "gz"), (1, 1, 1)),  # gravity was removed
        ((512, 512, 700), ("ax", "ay", "gz"), (1, 1, 1)),  # words with an offset
    ],
)
def test_a_draft_reads_the_axes_of_an_imu_from_gravity(tmp_path, gravity, columns, signs):
    rng = np.random.default_rng(0)
    accel = np.array(gravity) + 0.05 * np.max(np.abs(gravity)) * rng.standard_normal((300, 3))
    rows = [
        f"{0.01 * k},{k % 7 / 10},{a[0]},{a[1]},{a[2]},{0.1 * np.sin(k)},{0.1 * np.cos(k)},{0.1 * np.sin(2 * k)}"
        for k, a in enumerate(accel)
    ]
    (tmp_path / "log.csv").write_text("t_s,duty,ax,ay,az,gx,gy,gz\n" + "\n".join(rows), encoding="utf-8")
    text = draft_map(tmp_path / "log.csv")
    z = tomllib.loads(text)["sensors"]["imu"]["z"]
    assert tuple(entry["column"] for entry in z) == columns
    assert tuple(-1 if entry.get("scale", 1.0) < 0.0 else 1 for entry in z) == signs
    as_usual = re.sub(
        r"\[\s+\{ column = \"a[^]]*\]",
        """[
      { column = "ax", unit = "m/s^2" }, { column = "ay", unit = "m/s^2" }, { column = "gz", unit = "rad/s" } ]""",
        text,
    )
    (tmp_path / "log.toml").write_text('accept = ["unit"]\n' + as_usual, encoding="utf-8")
    is_found = "axes" in {d.code for d in import_run(tmp_path / "log.toml", [tmp_path / "log.csv"]).findings}
    assert is_found == (columns[2] != "gz" or signs[2] < 0)


def test_a_draft_reads_the_names_of_a_boat(tmp_path):
    rows = [f"{20 * k},{1500 + 9 * (k % 40)},{1500 - 9 * (k % 40)},{k % 90}" for k in range(100)]
    tables = drafted(tmp_path, "millis,thr_port,thr_stbd,heading_deg\n" + "\n".join(rows))
    pulses = [(entry["column"], entry["scale"], entry["offset"]) for entry in tables["command"]["wheels"]]
    assert pulses == [("thr_port", 0.002, -3.0), ("thr_stbd", 0.002, -3.0)]
    assert tables["sensors"]["compass"]["z"] == [{"column": "heading_deg", "unit": "deg"}]
    assert "truth" not in tables


def test_a_draft_of_a_car_has_two_commands_and_a_measured_angle_is_not_one(tmp_path):
    rows = [f"{0.02 * k},{k},{k % 30},{k % 31},{0.1 * k},{k % 5},{k % 7}" for k in range(100)]
    header = "t_s,drive_pwm,steer_deg,steer_angle_deg,compass_deg,x_m,y_m\n"
    tables = drafted(tmp_path, header + "\n".join(rows))
    assert tables["command"]["names"] == ["drive_pwm", "steer_deg"]
    assert tables["command"]["u"][1]["unit"] == "deg"
    assert tables["sensors"]["compass"]["z"][0]["column"] == "compass_deg"
    assert [entry.get("column") for entry in tables["truth"]["eta"]] == ["x_m", "y_m", None]


@pytest.mark.parametrize(
    ("g", "keys"), [(9.7, {"unit": "m/s^2"}), (1.01, {"unit": "g"}), (1004.0, {"unit": "mg"}),
                    (-16200.0, {"unit": "raw", "scale": 0.00059855}), (5000.0, {"unit": "?"})],
)  # fmt: skip
def test_a_draft_reads_the_unit_of_an_accelerometer_from_gravity(tmp_path, g, keys):
    rows = [
        f"{0.02 * k},{g / 50 * (k % 3 - 1)},{g / 60 * (k % 5 - 2)},{g + g / 99 * (k % 4)}" for k in range(100)
    ]
    x = drafted(tmp_path, "t_s,ax,ay,az\n" + "\n".join(rows))["sensors"]["imu"]["z"][0]
    assert x == {"column": "ax"} | keys


def test_a_draft_reads_a_robot_with_short_names_and_counters_of_16_bits(tmp_path):
    rows = [
        f"{20 * k},{k % 9 / 10},{-(k % 8) / 10},{(65000 + 37 * k) % 65536},{40 * k},{k % 5},7.{k % 10}"
        for k in range(99)
    ]
    text = "timestamp,motor_l,motor_r,enc_l,enc_r,gyr_z,vbat\n" + "\n".join(rows)
    tables = drafted(tmp_path, text)
    assert [entry["column"] for entry in tables["command"]["wheels"]] == ["motor_l", "motor_r"]
    assert [entry.get("wraps") for entry in tables["sensors"]["wheels"]["z"]] == [65536, None]
    assert tables["sensors"]["battery"]["z"] == [{"column": "vbat", "unit": "V"}]
    assert tables["sensors"]["imu"]["z"][2]["column"] == "gyr_z"


def test_a_draft_reads_merged_topics_of_ros_in_si_units(tmp_path):
    imu = [
        f"/imu/{name}" for name in ("linear_acceleration/x", "linear_acceleration/y", "angular_velocity/z")
    ]
    odometry = ["/odom/pose/pose/position/x", "/odom/twist/twist/linear/x", "/odom/twist/twist/angular/z"]
    names = ["__time", "/cmd_vel/linear/x", "/cmd_vel/angular/z", *odometry, *imu]
    rows = [
        ",".join([f"{1.7e9 + 0.02 * k:.2f}", *(str(k % (5 + n)) for n in range(len(names) - 1))])
        for k in range(60)
    ]
    tables = drafted(tmp_path, "\n".join([",".join(names), *rows]))
    entries = [*tables["command"]["u"], *tables["sensors"]["odometer"]["z"], *tables["sensors"]["imu"]["z"]]
    assert [entry.get("column") for entry in entries] == [names[1], None, names[2], odometry[1], *imu]
    units = ["m/s", None, "rad/s", "m/s", "m/s^2", "m/s^2", "rad/s"]
    assert [entry.get("unit") for entry in entries] == units
    assert "truth" not in tables


def test_a_draft_reads_setpoints_a_clock_since_boot_and_a_quaternion(tmp_path):
    names = ["boot_ms", "v_set [cm/s]", "w_set [deg/s]", "cmd_left [V]", "position.x", "position.y"]
    names += [f"orientation.{axis}" for axis in "xyzw"]
    rows = [
        ",".join([str(51234 + 40 * k), *(str(k % (5 + n)) for n in range(len(names) - 1))]) for k in range(60)
    ]
    tables = drafted(tmp_path, "\n".join([",".join(names), *rows]))
    log, u = tables["files"]["log"], tables["command"]["u"]
    assert (log["time"], log["time_unit"]) == ("boot_ms", "ms")
    assert [(entry.get("column"), entry.get("unit")) for entry in (u[0], u[2])] == [
        ("v_set [cm/s]", "cm/s"),
        ("w_set [deg/s]", "deg/s"),
    ]
    assert tables["truth"]["eta"][2] == {"quaternion": names[-4:]}


def on_ellipsoid(latitude, longitude):
    """Return the point (3,) [m] of WGS 84: an ellipse of the half axes a and b, turned about its short axis."""
    a, b, phi, lam = 6378137.0, 6356752.3142, np.radians(latitude), np.radians(longitude)
    n = a * a / np.hypot(a * np.cos(phi), b * np.sin(phi))
    return n * np.array([np.cos(phi) * np.cos(lam), np.cos(phi) * np.sin(lam), (b / a) ** 2 * np.sin(phi)])


@pytest.mark.parametrize("per_degree", [1.0, 1e7])
def test_a_draft_converts_latitude_and_longitude_into_metres(tmp_path, per_degree):
    start, points = (-34.6037, -58.3816), [(-34.6037, -58.3816), (-34.6028, -58.3816), (-34.6037, -58.3805)]
    rows = [
        f"{0.2 * k:.1f},{k % 3},{lat * per_degree:.9f},{lon * per_degree:.9f}"
        for k, (lat, lon) in enumerate(point for point in [(0.0, 0.0), *points] for _ in range(10))
    ]
    eta = drafted(tmp_path, "t_s,duty,lat,lon\n" + "\n".join(rows))["truth"]["eta"]
    assert [entry.get("column") for entry in eta] == ["lon", "lat", None]
    east, north = (
        [point[1 - i] * per_degree * entry["scale"] + entry["offset"] for point in points]
        for i, entry in enumerate(eta[:2])
    )
    distances = [np.linalg.norm(on_ellipsoid(*point) - on_ellipsoid(*start)) for point in points]
    assert north == pytest.approx([0.0, distances[1], 0.0], abs=1e-3)
    assert east == pytest.approx([0.0, 0.0, distances[2]], abs=1e-3)


def test_a_draft_reads_an_omnidirectional_robot_in_north_east_down(tmp_path):
    names = [
        "Time (s)",
        "cmd vx (m/s)",
        "cmd vy (m/s)",
        "cmd wz (rad/s)",
        "ax (m/s^2)",
        "ay (m/s^2)",
        "gz (deg/s)",
    ]
    rows = [",".join([f"{0.04 * k:.2f}", *(str(k % (5 + n)) for n in range(9))]) for k in range(60)]
    head = ",".join([*names, "N (m)", "E (m)", "Yaw (deg)"])
    tables = drafted(tmp_path, "\n".join([head, *rows]))
    assert [entry["column"] for entry in tables["command"]["u"]] == names[1:4]
    assert [entry["unit"] for entry in tables["sensors"]["imu"]["z"]] == ["m/s^2", "m/s^2", "deg/s"]
    x, y, heading = tables["truth"]["eta"]
    assert (x, y) == ({"column": "E (m)", "unit": "m"}, {"column": "N (m)", "unit": "m"})
    assert heading == {
        "column": "Yaw (deg)",
        "unit": "deg",
        "scale": -1.0,
        "offset": pytest.approx(np.pi / 2),
    }


@pytest.mark.parametrize(
    ("columns", "unit", "speeds"),
    [
        (("u_left_V", "u_right_V"), "V", ("left_m_s", "right_m_s")),
        (("left_mv", "right_mv"), "mV", ("left_m_s", "right_m_s")),
        (("left_pct", "right_pct"), "%", ("v_left_m_s", "v_right_m_s")),
        (("port_pct", "starboard_pct"), "%", ("v_left_m_s", "v_right_m_s")),
    ],
)
def test_a_draft_reads_the_unit_at_the_end_of_a_name_of_a_side(tmp_path, columns, unit, speeds):
    rows = [f"{0.01 * k},{k % 9 - 4},{k % 7 - 3},0.0{k % 9},0.0{k % 7}" for k in range(99)]
    text = f"t_s,{','.join((*columns, *speeds))}\n" + "\n".join(rows)
    tables = drafted(tmp_path, text)
    assert tables["command"]["wheels"] == [{"column": column, "unit": unit} for column in columns]
    assert tables["sensors"]["wheels"]["z"] == [{"column": speed, "unit": "m/s"} for speed in speeds]


def test_a_draft_reads_names_in_camel_case_and_words_for_axes(tmp_path):
    rows = [
        f"{20000 * k},{k % 90},{-(k % 80)},{7 * k},{6 * k},{k % 9},{k % 8},{k % 7},{k % 360}"
        for k in range(100)
    ]
    head = "stampUs,pwmL,pwmR,cntL,cntR,acc_fwd_mg,acc_lat_mg,gyr_z_dps,cam_hdg_deg"
    tables = drafted(tmp_path, f"{head}\n" + "\n".join(rows))
    assert tables["files"]["log"] == {"time": "stampUs", "time_unit": "us"}
    assert [entry["column"] for entry in tables["command"]["wheels"]] == ["pwmL", "pwmR"]
    wheels = [(entry["column"], entry["unit"]) for entry in tables["sensors"]["wheels"]["z"]]
    assert wheels == [("cntL", "counts"), ("cntR", "counts")]
    assert [(entry["column"], entry["unit"]) for entry in tables["sensors"]["imu"]["z"]] == [
        ("acc_fwd_mg", "mg"), ("acc_lat_mg", "mg"), ("gyr_z_dps", "deg/s"),
    ]  # fmt: skip
    assert tables["sensors"]["compass"]["z"] == [{"column": "cam_hdg_deg", "unit": "deg"}]


def test_a_commanded_turn_is_not_the_gyro(tmp_path):
    rows = [f"{20 * k},{k % 600},{k % 500},{k % 400},{k % 90}" for k in range(100)]
    head = "tiempo [ms],orden_avance,orden_izquierda,orden_giro,giróscopo_z [°/s]"
    tables = drafted(tmp_path, f"{head}\n" + "\n".join(rows))
    assert tables["command"]["names"] == ["orden_avance", "orden_izquierda", "orden_giro"]
    assert tables["sensors"]["imu"]["z"][2] == {"column": "giróscopo_z [°/s]", "unit": "deg/s"}
