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


PWM, COUNTS = "raw scale 0.00392157", "counts counts_per_turn 0 derivative True radius_m 0"
DRAFTS = {  # the names of the columns: the draft
    "t_s,drive_pwm,steer_deg,steer_angle_deg,compass_deg,x_m,y_m": f"""s
        u drive_pwm steer_deg: drive_pwm {PWM}, steer_deg deg
        compass: compass_deg deg
        truth: x_m m, y_m m, constant nan""",
    "__time,/cmd_vel/linear/x,/cmd_vel/angular/z,/odom/pose/pose/position/x,/odom/twist/twist/linear/x,"
    "/odom/twist/twist/angular/z,/imu/linear_acceleration/x,/imu/linear_acceleration/y,/imu/angular_velocity/z": """s
        u u_x u_y u_psi: /cmd_vel/linear/x m/s, constant 0, /cmd_vel/angular/z rad/s
        odometer: /odom/twist/twist/linear/x m/s
        imu: /imu/linear_acceleration/x m/s^2, /imu/linear_acceleration/y m/s^2, /imu/angular_velocity/z rad/s""",
    "boot_ms,v_set [cm/s],w_set [deg/s],cmd_left [V],position.x,position.y,"
    "orientation.x,orientation.y,orientation.z,orientation.w": """ms
        u u_x u_y u_psi: v_set [cm/s] cm/s, constant 0, w_set [deg/s] deg/s
        truth: position.x ?, position.y ?,
               quaternion ['orientation.x', 'orientation.y', 'orientation.z', 'orientation.w']""",
    "Time (s),cmd vx (m/s),cmd vy (m/s),cmd wz (rad/s),ax (m/s^2),ay (m/s^2),gz (deg/s),N (m),E (m),Yaw (deg)": """s
        u u_x u_y u_psi: cmd vx (m/s) m/s, cmd vy (m/s) m/s, cmd wz (rad/s) rad/s
        imu: ax (m/s^2) m/s^2, ay (m/s^2) m/s^2, gz (deg/s) deg/s
        truth: E (m) m, N (m) m, Yaw (deg) deg scale -1 offset 1.5708""",
    "stampUs,pwmL,pwmR,cntL,cntR,acc_fwd_mg,acc_lat_mg,gyr_z_dps,cam_hdg_deg": f"""us
        wheels: pwmL {PWM}, pwmR {PWM}
        wheels: cntL {COUNTS}, cntR {COUNTS}
        compass: cam_hdg_deg deg
        imu: acc_fwd_mg mg, acc_lat_mg mg, gyr_z_dps deg/s""",
    "tiempo [ms],orden_avance,orden_izquierda,orden_giro,giróscopo_z [°/s]": f"""ms
        u orden_avance orden_izquierda orden_giro: orden_avance {PWM}, orden_izquierda {PWM}, orden_giro {PWM}
        imu: constant nan, constant nan, giróscopo_z [°/s] deg/s""",
    "millis,linear_x,angular_z,enc_left,enc_right": f"""ms
        u u_x u_y u_psi: linear_x m/s, constant 0, angular_z rad/s
        wheels: enc_left {COUNTS}, enc_right {COUNTS}""",
    "t_ms,servo,throttle,gyro_z_dps,hall": f"""ms
        u throttle servo: throttle {PWM}, servo {PWM}
        odometer: hall {COUNTS}
        imu: constant nan, constant nan, gyro_z_dps deg/s""",
    # the voltage of a battery, in one column, is not a command
    "t_ms,volts_l,volts_r,battery_volts,cnt_l,cnt_r": f"""ms
        wheels: volts_l V, volts_r V
        wheels: cnt_l {COUNTS}, cnt_r {COUNTS}
        battery: battery_volts V""",
    "t_ms,set_l_rad_s,set_r_rad_s": """ms
        wheels: set_l_rad_s rad/s radius_m 0, set_r_rad_s rad/s radius_m 0""",
    "tiempo_s,pwm_izq,pwm_der,giro_gps,vel_m_s": f"""s
        wheels: pwm_izq {PWM}, pwm_der {PWM}
        odometer: vel_m_s m/s
        imu: constant nan, constant nan, giro_gps deg/s""",
    "t_s,u_left_V,u_right_V,left_m_s,right_m_s": """s
        wheels: u_left_V V, u_right_V V
        wheels: left_m_s m/s, right_m_s m/s""",
    "t_s,left_mv,right_mv": "s wheels: left_mv mV, right_mv mV",
    "t_s,left_pct,right_pct,v_left_m_s,v_right_m_s": """s
        wheels: left_pct %, right_pct %
        wheels: v_left_m_s m/s, v_right_m_s m/s""",
    "t_s,port_pct,starboard_pct": "s wheels: port_pct %, starboard_pct %",
    "tiempo_ms,izquierda,derecha": f"ms wheels: izquierda {PWM}, derecha {PWM}",
    "t_ms,left,right": f"ms wheels: left {PWM}, right {PWM}",
    "t_ms,motor_izq,motor_der": f"ms wheels: motor_izq {PWM}, motor_der {PWM}",
    "t,gyro_x,giro_y,mag_x,mag_y,mag_z,acel_z,acel_x_g,acel_y_g,giro_z": "s imu: acel_x_g g, acel_y_g g, giro_z ?",
    "t,acel_z,aceleración x,aceleración y,giróscopo z": "s imu: aceleración x ?, aceleración y ?, giróscopo z ?",
    "t,gyro_x,acel_z,ax,ay,gz": "s imu: ax ?, ay ?, gz ?",
    "t,gyro_x,acel_z,accX,accY,gyroZ": "s imu: accX ?, accY ?, gyroZ ?",
}  # fmt: skip
STEPS = {"s": 0.02, "ms": 20, "us": 20_000}


def words(entries):
    """Return the entries of a map as text: column, unit, and all other keys with their values."""
    texts = []
    for entry in entries:
        others = {key: value for key, value in entry.items() if key not in ("column", "unit")}
        values = [f"{k} {v:.6g}" if isinstance(v, float) else f"{k} {v}" for k, v in others.items()]
        texts.append(" ".join([*(entry[key] for key in ("column", "unit") if key in entry), *values]))
    return ", ".join(texts)


@pytest.mark.parametrize(("names", "expected"), DRAFTS.items())
def test_a_draft_reads_commands_sensors_truth_and_units_from_the_names_of_the_columns(
    tmp_path, names, expected
):
    unit, width = expected.split()[0], names.count(",")
    rows = [
        ",".join(str(x) for x in (STEPS[unit] * k, *(k % (5 + n) for n in range(width)))) for k in range(60)
    ]
    tables = drafted(tmp_path, "\n".join([names, *rows]))
    command = tables.get("command", {})
    parts = [f"wheels: {words(command['wheels'])}"] if "wheels" in command else []
    parts += [f"u {' '.join(command['names'])}: {words(command['u'])}"] if "u" in command else []
    parts += [f"{name}: {words(sensor['z'])}" for name, sensor in tables.get("sensors", {}).items()]
    parts += [f"truth: {words(tables['truth']['eta'])}"] if "truth" in tables else []
    assert tables["files"]["log"] == {"time": names.split(",")[0], "time_unit": unit}
    assert " ".join([unit, *parts]) == " ".join(expected.split())


def test_a_draft_reads_pulses_of_servos_and_counters_of_16_bits(tmp_path):
    rows = [
        f"{20 * k},{1500 + 9 * (k % 40)},{1500 - 9 * (k % 40)},{(65000 + 37 * k) % 65536},{40 * k}"
        for k in range(99)
    ]
    tables = drafted(tmp_path, "millis,thr_port,thr_stbd,enc_l,enc_r\n" + "\n".join(rows))
    pulses = [(entry["column"], entry["scale"], entry["offset"]) for entry in tables["command"]["wheels"]]
    assert pulses == [("thr_port", 0.002, -3.0), ("thr_stbd", 0.002, -3.0)]
    assert [entry.get("wraps") for entry in tables["sensors"]["wheels"]["z"]] == [65536, None]


def test_a_draft_reads_duties_and_short_names(tmp_path):
    rows = [f"{20 * k},{k % 9 / 10},{-(k % 8) / 10},{k % 5},7.{k % 10}" for k in range(99)]
    tables = drafted(tmp_path, "timestamp,motor_l,motor_r,gyr_z,vbat\n" + "\n".join(rows))
    assert words(tables["command"]["wheels"]) == "motor_l 1, motor_r 1"
    assert tables["sensors"]["battery"]["z"] == [{"column": "vbat", "unit": "V"}]
    assert tables["sensors"]["imu"]["z"][2]["column"] == "gyr_z"
