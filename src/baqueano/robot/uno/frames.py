"""Define the frames between the host and the Uno. This is the only source of their layout, even for the C header.

    wire    0x00 | COBS( kind u8 | sequence u8 | payload 0…40 bytes | CRC-16 big-endian ) | 0x00             (1)
    CRC     CRC-16/CCITT-FALSE: polynomial 0x1021, start 0xFFFF, nothing reflected, over kind … payload      (2)
    duty    per mille of full voltage, + is forwards; integers are little-endian, no padding                 (3)
    seal    DRIVE, CONFIG and SETTINGS towards the firmware end their payload with a second CRC-16, big-endian:
            polynomial 0x8BB7, start 0, nothing reflected, over kind … payload                               (4)

The fields of a frame are the fields of a NamedTuple, whose names end with the unit. A field's type contains the width
on the wire and, if the firmware refuses other values, the range. Both sides count and ignore a frame of an unknown kind
or of a wrong length. Frames sent by the firmware have bit 7 of the kind set. `make firmware` makes
firmware/uno/frames.h from this file by c_header.py. docs/derivations/firmware_link.md explains nonce, sequence, arming
and stop, and the reason for two CRCs.
"""

import struct
from enum import IntEnum, IntFlag
from typing import Annotated, Any, NamedTuple, get_type_hints

PROTOCOL = 1
VERSION = (1, 0, 0)
BAUD = 115_200
MAX_PAYLOAD = 40
CRC_POLYNOMIAL = 0x8BB7
NO_AGE = 0xFFFF
"""`State.drive_age_ms` before the first DRIVE, or after 65 s."""


class ValueRange(NamedTuple):
    """A range of integers, from `low` to `high`, both included."""

    low: int
    high: int


class Repetition(NamedTuple):
    """A nested layout, repeated `repetitions` times."""

    repetitions: int


U8 = Annotated[int, "B"]
U16 = Annotated[int, "H"]
U32 = Annotated[int, "I"]
I16 = Annotated[int, "h"]
I32 = Annotated[int, "i"]
Duty = Annotated[int, "h", ValueRange(-1000, 1000)]


class DriveFlag(IntFlag):
    """The flags of a DRIVE. Without ARM the frame disarms the Uno: motors off, bridge in standby."""

    ARM = 1
    CLEAR_STOP = 2
    BRAKE = 4


class StateFlag(IntFlag):
    """The flags in the telemetry of the firmware."""

    ARMED = 1
    DEAD_MAN = 2
    STOPPED = 4
    BATTERY_LOW = 8
    ENCODER_FAULT = 16
    SATURATED = 32
    FACTORY = 64
    ON_MARK = 128


class ResetCause(IntFlag):
    """The causes of a reset. Bits 0…3 are as in the register MCUSR, which a boot-loader might have cleared.

    Bits 6 and 7 come from RAM that a reset does not clear.
    """

    POWER = 1
    EXTERNAL = 2
    BROWN_OUT = 4
    WATCHDOG = 8
    HUNG = 64
    WARM = 128


def reset_cause_names(bits: int) -> str:
    """Return the names of the causes in `bits`, separated by spaces; "" if no bit is set."""
    return " ".join(flag.name.lower().replace("_", "-") for flag in ResetCause if bits & flag and flag.name)


class Driver(IntEnum):
    """The kinds of motor bridge, which differ in braking, coasting and the highest PWM frequency."""

    L298N = 1
    TB6612 = 2
    L293D = 3


MAX_PWM_HZ = {Driver.L298N: 20_000, Driver.TB6612: 25_000, Driver.L293D: 5_000}


class EncoderKind(IntEnum):
    """The kinds of encoder at D2/D4 (left) and D3/D7 (right)."""

    NONE = 0
    SINGLE = 1
    QUADRATURE = 2


class Wiring(IntFlag):
    """The flags of plugs that are reversed or swapped, and of a mark sensor that is low over the tape."""

    LEFT_MOTOR_REVERSED = 1
    RIGHT_MOTOR_REVERSED = 2
    MOTORS_SWAPPED = 4
    LEFT_ENCODER_REVERSED = 8
    RIGHT_ENCODER_REVERSED = 16
    ENCODERS_SWAPPED = 32
    MARK_ACTIVE_LOW = 64


class Drive(NamedTuple):
    """A command. `ttl_10ms` can only shorten the dead-man time of this command; 0 leaves it unchanged."""

    nonce: U8
    left_permille: Duty
    right_permille: Duty
    flags: Annotated[int, "B", ValueRange(0, 7)]
    ttl_10ms: U8 = 0


class Config(NamedTuple):
    """The configuration until the next reset; INFO answers it. If one value is out of range, all are refused.

    1000 as `slew_permille_per_ms` does not limit the duty; 0 as `least_battery_mv` does not check the battery. `pwm_hz`
    must also be at most MAX_PWM_HZ of the bridge.
    """

    dead_man_ms: Annotated[int, "H", ValueRange(50, 1000)] = 300
    telemetry_ms: Annotated[int, "B", ValueRange(5, 250)] = 10
    slew_permille_per_ms: Annotated[int, "H", ValueRange(1, 1000)] = 40
    pwm_hz: Annotated[int, "H", ValueRange(50, 25_000)] = 5000
    least_battery_mv: Annotated[int, "H", ValueRange(0, 20_000)] = 0


class Ping(NamedTuple):
    """A request that PONG answers at once with the same token."""

    token: U32


class Stop(NamedTuple):
    """The command to switch the motors off now; they stay off until the stop is cleared."""


class AskInfo(NamedTuple):
    """A request for the identity of the firmware; INFO answers it."""


class WheelCurve(NamedTuple):
    """The characteristic of a wheel in one direction; all values are in permille.

    duty = dead_zone + slope·|request| / 1000. While the wheel starts, for `Settings.kick_ms`, the duty is at least
    `kick_permille`.
    """

    dead_zone_permille: Annotated[int, "H", ValueRange(0, 700)] = 0
    slope_permille: Annotated[int, "H", ValueRange(100, 3000)] = 1000
    kick_permille: Annotated[int, "H", ValueRange(0, 1000)] = 0


class Settings(NamedTuple):
    """The settings of one vehicle, stored in EEPROM. The Uno accepts them only while disarmed.

    The answer is a SETTINGS frame. `battery_permille` is the battery voltage divided by the voltage at A0
    (3000: a divider 20 kΩ / 10 kΩ). The order of `curves` is left forwards, left backwards, right forwards,
    right backwards. While the request is not zero, dither adds ± `dither_permille` to it, and the sign changes each
    `dither_ms`.
    """

    wiring: Annotated[int, "B", ValueRange(0, 127)] = 0
    driver: Annotated[int, "B", ValueRange(1, 3)] = Driver.L298N
    encoders: Annotated[int, "B", ValueRange(0, 2)] = EncoderKind.NONE
    kick_ms: Annotated[int, "B", ValueRange(0, 100)] = 0
    dither_permille: Annotated[int, "B", ValueRange(0, 250)] = 0
    dither_ms: Annotated[int, "B", ValueRange(1, 50)] = 5
    battery_permille: Annotated[int, "H", ValueRange(1000, 11_000)] = 3000
    curves: Annotated[tuple[WheelCurve, ...], WheelCurve, Repetition(4)] = (WheelCurve(),) * 4


class AskSettings(NamedTuple):
    """A request for the stored settings; SETTINGS answers it."""


class State(NamedTuple):
    """The telemetry. Sums and encoder counts wrap at 2³¹, `t_us` at 2³², counters of one byte at 256."""

    t_us: U32
    mark_t_us: U32
    left_sum: I32
    right_sum: I32
    left_counts: I32
    right_counts: I32
    left_permille: I16
    right_permille: I16
    battery_mv: U16
    drive_age_ms: U16
    nonce: U8
    drive_seq: U8
    flags: U8
    mark_count: U8
    bad_frames: U8
    ignored_frames: U8
    overruns: U8


class Pong(NamedTuple):
    """The answer to a PING, with the firmware's time when it read the PING."""

    token: U32
    t_us: U32


class Info(NamedTuple):
    """The identity of the firmware, its last start, and the frames refused since. Sent at boot and on request."""

    protocol: U8
    nonce: U8
    reset_cause: U8
    version_major: U8
    version_minor: U8
    version_patch: U8
    driver: U8
    encoders: U8
    boots: U16
    least_free_ram: U16
    bad_crc: U16
    bad_shape: U16
    wrong_nonce: U16
    old_sequence: U16
    out_of_range: U16
    not_armed: U16
    config: Annotated[Config, Config]


Frame = Drive | Config | Ping | Stop | AskInfo | Settings | AskSettings | State | Pong | Info

KIND_LAYOUTS: dict[int, type[Frame]] = {
    0x01: Drive,
    0x02: Config,
    0x03: Ping,
    0x04: Stop,
    0x05: AskInfo,
    0x06: Settings,
    0x07: AskSettings,
    0x81: State,
    0x83: Pong,
    0x85: Info,
    0x86: Settings,
}


class Field(NamedTuple):
    """A field of a flattened layout; `value_range` is the range of its integer type, or a narrower range."""

    path: str
    code: str
    value_range: ValueRange


def integer_range(code: str) -> ValueRange:
    """Return the range of an integer that is encoded with this format code of `struct`."""
    bits = 8 * struct.calcsize(code)
    if code.islower():
        return ValueRange(-(1 << bits - 1), (1 << bits - 1) - 1)
    return ValueRange(0, (1 << bits) - 1)


def fields(layout: type[tuple[Any, ...]], path: str = "") -> list[Field]:
    """Return the fields of a layout in the order of the wire; nested layouts are flattened."""
    layout_fields: list[Field] = []
    for name, hint in get_type_hints(layout, include_extras=True).items():
        code, *annotations = hint.__metadata__
        if isinstance(code, str):
            layout_fields.append(
                Field(path + name, code, annotations[0] if annotations else integer_range(code))
            )
        elif annotations:
            for index in range(annotations[0].repetitions):
                layout_fields += fields(code, f"{path}{name}[{index}].")
        else:
            layout_fields += fields(code, f"{path}{name}.")
    return layout_fields


LAYOUTS: tuple[type[Any], ...] = (WheelCurve, *dict.fromkeys(KIND_LAYOUTS.values()))
LAYOUT_FIELDS = {layout: fields(layout) for layout in LAYOUTS}
LAYOUT_STRUCTS = {
    layout: struct.Struct("<" + "".join(f.code for f in rows)) for layout, rows in LAYOUT_FIELDS.items()
}
LAYOUT_KINDS = {layout: kind for kind, layout in reversed(KIND_LAYOUTS.items())}
NESTED_LAYOUTS = {Settings, Info}
CRC_KINDS = {0x01, 0x02, 0x06}
PAYLOAD_LENGTHS = {
    kind: LAYOUT_STRUCTS[layout].size + 2 * (kind in CRC_KINDS) for kind, layout in KIND_LAYOUTS.items()
}


def flat_values(frame: tuple[Any, ...]) -> list[int]:
    """Return the values of a frame in one list; nested frames are flattened."""
    values: list[int] = []
    for value in frame:
        values += flat_values(value) if isinstance(value, tuple) else [int(value)]
    return values


def unflatten(layout: type[Any], numbers: list[int]) -> Any:
    """Return the frame built from flattened values, the inverse of `flat_values`.

    Remove the used values from the list.
    """
    values: list[Any] = []
    for hint in get_type_hints(layout, include_extras=True).values():
        code, *annotations = hint.__metadata__
        if isinstance(code, str):
            values.append(numbers.pop(0))
        elif annotations:
            values.append(tuple(unflatten(code, numbers) for _ in range(annotations[0].repetitions)))
        else:
            values.append(unflatten(code, numbers))
    return layout(*values)


def pack(frame: Frame) -> bytes:
    """Return the payload of a frame. Raise struct.error if a value does not fit its integer type."""
    return LAYOUT_STRUCTS[type(frame)].pack(*(flat_values(frame) if type(frame) in NESTED_LAYOUTS else frame))


def unpack(layout: type[Frame], payload: bytes) -> Frame:
    """Return the frame of a payload, which must have the length of the layout."""
    numbers = LAYOUT_STRUCTS[layout].unpack(payload)
    return unflatten(layout, list(numbers)) if layout in NESTED_LAYOUTS else layout(*numbers)


def first_out_of_range(frame: Frame) -> tuple[str, int, ValueRange] | None:
    """Return the first value out of its range as (name, value, range); None if all values are in range."""
    values: list[Any] = flat_values(frame) if type(frame) in NESTED_LAYOUTS else list(frame)
    for field, value in zip(LAYOUT_FIELDS[type(frame)], values, strict=True):
        if not field.value_range.low <= value <= field.value_range.high:
            return field.path, value, field.value_range
    return None
