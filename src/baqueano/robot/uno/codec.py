"""Convert frames to bytes and back: COBS (Cheshire & Baker 1999) and CRC-16/CCITT-FALSE, see frames.py (1), (2).

COBS    replaces each zero by the distance to the next zero, so that a zero only marks the end of a frame;
        a body of n < 254 bytes becomes n + 1 bytes
lead    a zero is also sent before each frame. Noise before it then does not damage the frame
loss    a damaged body passes the CRC with probability 2⁻¹⁶. It must also have a known kind, the right
        length, and, towards the Uno, the nonce, a newer sequence and values in range
"""

from binascii import crc_hqx
from typing import NamedTuple

from baqueano.errors import UsageError
from baqueano.robot.uno.frames import (
    CRC_KINDS,
    CRC_POLYNOMIAL,
    KIND_LAYOUTS,
    LAYOUT_KINDS,
    MAX_PAYLOAD,
    PAYLOAD_LENGTHS,
    Frame,
    first_out_of_range,
    pack,
    unpack,
)

CRC_START = 0xFFFF
MAX_FRAME_BYTES = 1 + 2 + MAX_PAYLOAD + 2
"""Bytes of the longest frame between its two zeros."""


def byte_crc(byte: int) -> int:
    """Return the CRC of one byte with the polynomial of the seal."""
    crc = byte << 8
    for _ in range(8):
        crc = crc << 1 & 0xFFFF ^ (CRC_POLYNOMIAL if crc & 0x8000 else 0)
    return crc


CRC_TABLE = [byte_crc(byte) for byte in range(256)]


class ReceivedFrame(NamedTuple):
    """A frame that arrived undamaged, and its sequence number."""

    seq: int
    frame: Frame


def cobs_encode(body: bytes) -> bytes:
    """Return the COBS code of a body shorter than 254 bytes; the code does not contain zeros."""
    return b"".join(bytes([len(run) + 1]) + run for run in body.split(b"\0"))


def cobs_decode(encoded_bytes: bytes) -> bytes | None:
    """Return the body that a COBS code encodes; None if the distances in the code are not consistent."""
    body, position = bytearray(), 0
    while position < len(encoded_bytes):
        distance = encoded_bytes[position]
        run = encoded_bytes[position + 1 : position + distance]
        if distance == 0 or len(run) != distance - 1:
            return None
        body += run
        body.append(0)
        position += distance
    return bytes(body[:-1])


def crc16(body: bytes) -> int:
    """Return the CRC-16 of a body (kind … payload), polynomial 0x8BB7; 0 if the body ends with its own CRC."""
    crc = 0
    for byte in body:
        crc = (crc << 8 & 0xFFFF) ^ CRC_TABLE[crc >> 8 ^ byte]
    return crc


def encode_frame(kind: int, seq: int, payload: bytes) -> bytes:
    """Return the bytes of a frame with this payload on the wire, with a zero at both ends."""
    body = bytes([kind, seq & 0xFF]) + payload
    if kind in CRC_KINDS:
        body += crc16(body).to_bytes(2, "big")
    return b"\0" + cobs_encode(body + crc_hqx(body, CRC_START).to_bytes(2, "big")) + b"\0"


def encode(frame: Frame, seq: int, kind: int | None = None) -> bytes:
    """Return the bytes of a frame, with a zero at both ends.

    `frame` is any NamedTuple of frames.py. `seq` is its sequence number, modulo 256. `kind` is needed only to send as
    the firmware does, if two kinds have the same layout. Raise UsageError for a number outside the range of the
    firmware.
    """
    if faulty_field := first_out_of_range(frame):
        path, value, (low, high) = faulty_field
        raise UsageError.of(
            "uno.number-range", frame=type(frame).__name__, path=path, number=value, minimum=low, maximum=high
        )
    return encode_frame(LAYOUT_KINDS[type(frame)] if kind is None else kind, seq, pack(frame))


class Decoder:
    """A decoder that accepts bytes in chunks of any length and returns the complete frames.

    Attributes:
        bad_crc: number of segments between two zeros with a wrong COBS, CRC, seal or length.
        bad_shape: number of frames with a correct CRC, but an unknown kind or a wrong length for their kind.
    """

    def __init__(self) -> None:
        self.bad_crc = self.bad_shape = 0
        self._incomplete = b""

    def feed(self, data: bytes) -> list[ReceivedFrame]:
        """Return the frames that these bytes complete, in order."""
        if b"\0" not in data:
            self._incomplete = (self._incomplete + data)[: MAX_FRAME_BYTES + 1]
            return []
        *pieces, incomplete = (self._incomplete + data).split(b"\0")
        self._incomplete = incomplete[: MAX_FRAME_BYTES + 1]
        return [frame for piece in pieces if piece and (frame := self._read(piece))]

    def _read(self, piece: bytes) -> ReceivedFrame | None:
        body = cobs_decode(piece) if len(piece) <= MAX_FRAME_BYTES else None
        if body is None or len(body) < 4 or crc_hqx(body, CRC_START):
            self.bad_crc += 1
        elif PAYLOAD_LENGTHS.get(kind := body[0]) != len(body) - 4:
            self.bad_shape += 1
        elif kind not in CRC_KINDS:
            return ReceivedFrame(body[1], unpack(KIND_LAYOUTS[kind], body[2:-2]))
        elif crc16(body[:-2]) == 0:
            return ReceivedFrame(body[1], unpack(KIND_LAYOUTS[kind], body[2:-4]))
        else:
            self.bad_crc += 1
        return None
