"""Pack and unpack the messages of a run: ROS 2 messages in CDR, little-endian (XCDR1), only with `struct`.

A message is `00 01 00 00`, then the fields. Each field is aligned to its size, counted from the end of these four
bytes. Every channel has one frame name and one size, so all its messages have the same layout. One format string packs
them, and one NumPy record type unpacks all of them at once. Doubles are exact. The MCAP times of a message are exact
too: `log_time` is the arrival at the loop, `publish_time` the instant of measurement.

IMU, poses and events are standard types, so that viewers can draw them.
The file contains the definitions of all other types.
"""

import math
import struct
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from baqueano.errors import Invalid

CDR = b"\x00\x01\x00\x00"
NANOSECONDS = 1_000_000_000
MAX_STAMP_NS = 2**31 * NANOSECONDS  # builtin_interfaces/Time counts seconds in 31 bits, until January 2038

_RULE = "=" * 80
_TIME = f"{_RULE}\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
_HEADER = f"{_RULE}\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n{_TIME}"
_VECTOR = f"{_RULE}\nMSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n"
_QUATERNION = f"{_RULE}\nMSG: geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w\n"
_POINT = f"{_RULE}\nMSG: geometry_msgs/Point\nfloat64 x\nfloat64 y\nfloat64 z\n"
_POSE = (
    f"{_RULE}\nMSG: geometry_msgs/Pose\ngeometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n"
    f"{_POINT}{_QUATERNION}"
)

SCHEMAS = {
    "baqueano_msgs/msg/Command": f"""\
# One number per input of the vehicle, in the unit of its vehicle file.
std_msgs/Header header
float64[] u
{_HEADER}""",
    "baqueano_msgs/msg/Measurement": f"""\
# What a sensor measured, in its own units (SI).
std_msgs/Header header
float64[] z
{_HEADER}""",
    "baqueano_msgs/msg/Estimate": f"""\
# Pose in the map (x, y [m], psi [rad]), velocity in the body frame, covariance of both row by row.
# innovation_size 0: the estimator does not report innovations; NaN: nothing arrived.
std_msgs/Header header
float64[3] eta
float64[3] nu
float64[36] cov
uint32 innovation_size
float64[] innovation
float64[] innovation_cov
{_HEADER}""",
    "baqueano_msgs/msg/Reference": f"""\
# Where the vehicle should be, its velocity there in the body frame; done is 1 when the guide asks no more.
std_msgs/Header header
float64[3] eta
float64[3] nu
float64 done
{_HEADER}""",
    "baqueano_msgs/msg/Motion": f"""\
# Where the vehicle is: pose in the map, velocity in the body frame and its rate of change; NaN is not known.
std_msgs/Header header
float64[3] eta
float64[3] nu
float64[3] nu_dot
{_HEADER}""",
    "sensor_msgs/msg/Imu": f"""\
std_msgs/Header header
geometry_msgs/Quaternion orientation
float64[9] orientation_covariance
geometry_msgs/Vector3 angular_velocity
float64[9] angular_velocity_covariance
geometry_msgs/Vector3 linear_acceleration
float64[9] linear_acceleration_covariance
{_HEADER}{_QUATERNION}{_VECTOR}""",
    "geometry_msgs/msg/PoseStamped": f"""\
std_msgs/Header header
geometry_msgs/Pose pose
{_HEADER}{_POSE}""",
    "rcl_interfaces/msg/Log": f"""\
byte DEBUG=10
byte INFO=20
byte WARN=30
byte ERROR=40
byte FATAL=50
builtin_interfaces/Time stamp
uint8 level
string name
string msg
string file
string function
uint32 line
{_TIME}""",
}


class MessageField(NamedTuple):
    """A field of a message: an array or a sequence of `size` doubles, or an unsigned integer."""

    name: str
    kind: str  # "array" | "sequence" | "uint32"
    size: int = 1


class MessageLayout:
    """The byte layout of a message that starts with a Header. The layout packs and unpacks such messages."""

    def __init__(self, frame: str, fields: tuple[MessageField, ...]) -> None:
        name = frame.encode() + b"\0"
        text, offset = f"<4siII{len(name)}s", 16 + len(name)
        entries: list[tuple[str, Any, int]] = []  # name, type, byte of the message
        for field, number_kind, count in fields:
            if number_kind != "array":
                pad = -offset % 4
                entries.append((field if number_kind == "uint32" else f"{field}/count", "<u4", offset + pad))
                text, offset = text + f"{pad}xI", offset + pad + 4
            if number_kind != "uint32" and count:
                pad = (4 - offset) % 8  # the alignment begins after the four bytes of CDR
                entries.append((field, ("<f8", (count,)), offset + pad))
                text, offset = text + f"{pad}x{count}d", offset + pad + 8 * count
        self._struct = struct.Struct(text)
        self._head = (len(name), name)
        self._counts = {
            f"{field}/count": count for field, number_kind, count in fields if number_kind == "sequence"
        }
        self._empty = [
            field for field, number_kind, count in fields if number_kind == "sequence" and not count
        ]
        names, formats, offsets = zip(*entries, strict=True)
        self._dtype = np.dtype(
            {"names": names, "formats": formats, "offsets": offsets, "itemsize": self._struct.size}
        )

    def pack(self, t_ns: int, *values: float) -> bytes:
        """Return a message with the timestamp `t_ns` and the field `values`; the length precedes each sequence."""
        return self._struct.pack(CDR, t_ns // NANOSECONDS, t_ns % NANOSECONDS, *self._head, *values)

    def unpack(self, data: bytearray, sizes: Sequence[int]) -> dict[str, np.ndarray]:
        """Return the fields of all messages in `data`, field name → (N, count), without a copy.
        The messages follow each other without a gap. Raise ValueError if a message has another layout.
        """
        if len(data) != len(sizes) * self._struct.size or any(size != self._struct.size for size in sizes):
            raise Invalid.of("damage.message-bytes", bytes=self._struct.size)
        rows = np.frombuffer(data, self._dtype)
        for name, count in self._counts.items():
            if (rows[name] != count).any():
                raise Invalid.of("damage.message-numbers", count=count, field=name.removesuffix("/count"))
        read = {name: rows[name] for name in rows.dtype.names or () if name not in self._counts}
        return read | {field: np.zeros((len(sizes), 0)) for field in self._empty}


def command_layout(size: int) -> MessageLayout:
    """Return the layout of baqueano_msgs/msg/Command; its messages are packed by pack(t_ns, size, *u)."""
    return MessageLayout("base_link", (MessageField("u", "sequence", size),))


def measurement_layout(size: int, frame: str) -> MessageLayout:
    """Return the layout of baqueano_msgs/msg/Measurement; its messages are packed by pack(t_ns, size, *z)."""
    return MessageLayout(frame, (MessageField("z", "sequence", size),))


def imu_layout(frame: str) -> MessageLayout:
    """Return the layout of sensor_msgs/msg/Imu. A first covariance of −1 marks an unknown orientation (REP 145)."""
    blocks = ("orientation", 4), ("oc", 9), ("omega", 3), ("omega_cov", 9), ("accel", 3), ("accel_cov", 9)
    return MessageLayout(frame, tuple(MessageField(name, "array", count) for name, count in blocks))


ZERO_COVARIANCE = (0.0,) * 9
UNKNOWN_ORIENTATION = (0.0, 0.0, 0.0, 1.0, -1.0, *ZERO_COVARIANCE[1:])


def imu_values(z: list[float]) -> tuple[float, ...]:
    """Return the field values of a sensor_msgs/msg/Imu with (a_x, a_y, ω_z); unmeasured quantities are zero."""
    return (*UNKNOWN_ORIENTATION, 0.0, 0.0, z[2], *ZERO_COVARIANCE, z[0], z[1], 0.0, *ZERO_COVARIANCE)


def imu_z(fields: dict[str, np.ndarray]) -> np.ndarray:
    """Return a_x, a_y, ω_z (N, 3) from the fields of IMU messages."""
    return np.column_stack([fields["accel"][:, 0], fields["accel"][:, 1], fields["omega"][:, 2]])


def estimate_layout(size: int | None, has_cov: bool = True) -> MessageLayout:
    """Return the layout of baqueano_msgs/msg/Estimate with innovations of `size` entries; without innovations if `size`
    is None.
    """
    m = size or 0
    head = MessageField("eta", "array", 3), MessageField("nu", "array", 3), MessageField("cov", "array", 36)
    tail = (
        MessageField("innovation", "sequence", m),
        MessageField("innovation_cov", "sequence", m * m if has_cov else 0),
    )
    return MessageLayout("map", (*head, MessageField("innovation_size", "uint32"), *tail))


def _map_arrays(**counts: int) -> MessageLayout:
    return MessageLayout("map", tuple(MessageField(name, "array", count) for name, count in counts.items()))


REFERENCE = _map_arrays(eta=3, nu=3, done=1)  # baqueano_msgs/msg/Reference
MOTION = _map_arrays(eta=3, nu=3, nu_dot=3)  # baqueano_msgs/msg/Motion
# geometry_msgs/msg/PoseStamped, of `pose_values`, for viewers
POSE = _map_arrays(position=3, orientation=4)


def pose_values(eta: list[float]) -> tuple[float, ...]:
    """Return x, y, 0 and the quaternion of a rotation by ψ about z; ψ = 0 if it is not finite."""
    half_angle = 0.5 * eta[2]
    if not math.isfinite(half_angle):
        half_angle = 0.0
    return eta[0], eta[1], 0.0, 0.0, 0.0, math.sin(half_angle), math.cos(half_angle)


def pack_log(t_ns: int, level: int, source: str, text: str, code: str = "", data: str = "") -> bytes:
    """Return a packed rcl_interfaces/msg/Log: `function` contains the code of the message, `file` its data in JSON."""
    body = struct.pack("<iIB", t_ns // NANOSECONDS, t_ns % NANOSECONDS, level)
    for words in (source, text, data, code):
        content = words.replace("\0", "").encode("utf-8", "replace") + b"\0"
        body += bytes(-len(body) % 4) + struct.pack("<I", len(content)) + content
    return CDR + body + bytes(-len(body) % 4) + struct.pack("<I", 0)


def unpack_log(message: bytes) -> tuple[int, str, str, str]:
    """Return level, source, text and data of one rcl_interfaces/msg/Log. Raise ValueError for other bytes."""
    try:
        body, texts, offset = message[4:], [], 9
        level = body[8]
        for _ in range(3):
            offset += -offset % 4
            (size,) = struct.unpack_from("<I", body, offset)
            if not 0 < size <= len(body) - offset - 4:
                raise Invalid.of("damage.text-beyond")
            texts.append(body[offset + 4 : offset + 3 + size].decode())
            offset += 4 + size
    except (struct.error, IndexError, UnicodeDecodeError) as error:
        raise Invalid.of("damage.log-message", error=error) from error
    return level, texts[0], texts[1], texts[2]
