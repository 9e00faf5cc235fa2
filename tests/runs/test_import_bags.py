"""ROS 1 and ROS 2 bags are imported by topic and field."""

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin, Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from baqueano.errors import FileError, UsageError
from baqueano.runs import import_run
from tests.codes import refused

MAP = """
format = 1
[files.imu]
path = "drive"
topic = "/imu/data_raw"
time = "header.stamp"
[files.drive]
path = "drive"
topic = "/cmd_vel"
time = "bag"
[ticks]
file = "imu"
[command]
file = "drive"
names = ["forward", "turn"]
in_force = "from"
u = [{ column = "linear.x", unit = "1" }, { column = "angular.z", unit = "1" }]
[sensors.imu]
file = "imu"
z = [
  { column = "linear_acceleration.x", unit = "m/s^2" },
  { column = "linear_acceleration.y", unit = "m/s^2" },
  { column = "angular_velocity.z", unit = "rad/s" },
]
[truth]
file = "imu"
eta = [
  { column = "orientation_covariance[1]", unit = "m" },
  { column = "orientation_covariance[2]", unit = "m" },
  { quaternion = ["orientation"] },
]
"""


def write_bag(path, store, writer, version1):
    """Write two topics; the recording time is 40 ms after the measurement time."""
    types = store.types
    vector, quaternion = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Quaternion"]
    header, time = types["std_msgs/msg/Header"], types["builtin_interfaces/msg/Time"]
    serialize = store.serialize_ros1 if version1 else store.serialize_cdr
    with writer as bag:
        imu = bag.add_connection("/imu/data_raw", "sensor_msgs/msg/Imu", typestore=store)
        drive = bag.add_connection("/cmd_vel", "geometry_msgs/msg/Twist", typestore=store)
        for k in range(50):
            t_ns, psi = 1_700_000_000_000_000_000 + k * 10_000_000, 0.1 * k
            stamp = time(t_ns // 10**9, t_ns % 10**9)
            head = header(k, stamp, "imu") if version1 else header(stamp, "imu")
            place = np.array([-1.0, 0.01 * k, 0.02 * k, *[0.0] * 6])
            orientation = quaternion(0.0, 0.0, np.sin(psi / 2), np.cos(psi / 2))
            acceleration, zeros = vector(0.5 * k, -0.25 * k, 9.81), np.zeros(9)
            message = types["sensor_msgs/msg/Imu"](
                head, orientation, place, vector(0.0, 0.0, 0.125 * k), zeros, acceleration, zeros
            )
            bag.write(imu, t_ns + 40_000_000, serialize(message, "sensor_msgs/msg/Imu"))
            twist = types["geometry_msgs/msg/Twist"](vector(0.01 * k, 0.0, 0.0), vector(0.0, 0.0, -0.5))
            bag.write(drive, t_ns - 1, serialize(twist, "geometry_msgs/msg/Twist"))
    return path


@pytest.fixture(params=["ros1", "ros2 folder", "ros2 file"])
def bag(request, tmp_path):
    if request.param == "ros1":
        path = tmp_path / "drive.bag"
        return write_bag(path, get_typestore(Stores.ROS1_NOETIC), Writer1(path), True)
    path = tmp_path / "drive ñ"
    writer = Writer2(path, version=9, storage_plugin=StoragePlugin.MCAP)
    write_bag(path, get_typestore(Stores.ROS2_HUMBLE), writer, False)
    return path if request.param == "ros2 folder" else next(path.glob("*.mcap"))


def bring(bag, tmp_path, old="", new=""):
    assert old in MAP
    (tmp_path / "map.toml").write_text(MAP.replace(old, new, 1) if old else MAP, encoding="utf-8")
    return import_run(tmp_path / "map.toml", {"imu": bag, "drive": bag}).run


def test_a_bag_is_imported_as_a_run(bag, tmp_path):
    run = bring(bag, tmp_path)
    assert run.t_ns[0] == 1_700_000_000_000_000_000
    assert run.applied_commands[:3].tolist() == [[0.0, -0.5], [0.01, -0.5], [0.02, -0.5]]
    assert run.sensors["imu"].z[4].tolist() == [2.0, -1.0, 0.5]
    assert run.truth.eta[40] == pytest.approx([0.4, 0.8, 4.0 - 2 * np.pi])


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"/cmd_vel"', '"/cmd"', ("bag.no-topic", {})),
        ('topic = "/cmd_vel"\ntime = "bag"', 'time = "t"\ntime_unit = "s"', ("bag.topic-unsaid", {})),
        ('"linear.x"', '"linear.w"', ("bag.no-field", {"field": "linear.w", "path": "w"})),
        ('"linear.x"', '"linear"', ("bag.field-not-number", {"field": "linear"})),
        ("covariance[1]", "covariance[11]", ("bag.values", {"count": 9})),
        ('time = "bag"', "", ("expect.time-of-bag", {})),
    ],
)
def test_a_topic_or_field_absent_from_a_bag_is_named(bag, tmp_path, old, new, message):
    with refused(message[0], FileError, **message[1]):
        bring(bag, tmp_path, old, new)


def test_a_file_that_is_not_a_bag_is_named(tmp_path):
    path = tmp_path / "x.bag"
    path.write_bytes(b"#ROSBAG V2.0\nabc")
    with refused("bag.not-read", FileError, file="x.bag"):
        bring(path, tmp_path)
    path.write_bytes(b"")
    with refused("bag.not-read", FileError, file="x.bag"):
        bring(path, tmp_path)


def test_a_missing_bag_library_is_reported_with_the_install_command(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "rosbags.highlevel", None)
    with refused("bag.no-rosbags", UsageError):
        bring(tmp_path / "x.bag", tmp_path)
