"""The codec: intact frames arrive complete, and damaged frames do not arrive."""

import random
from binascii import crc_hqx

from hypothesis import given, strategies as st

from baqueano.errors import UsageError
from baqueano.robot.uno.codec import (
    CRC_START,
    MAX_FRAME_BYTES,
    Decoder,
    ReceivedFrame,
    cobs_decode,
    cobs_encode,
    crc16,
    encode,
    encode_frame,
)
from baqueano.robot.uno.frames import Config, Drive, DriveFlag, Ping, Settings, State, Stop, pack
from tests.codes import refused

DRIVE = Drive(7, 400, -400, DriveFlag.ARM)
STATE = State(123456, 0, 5000, -5000, 10, -10, 400, -400, 7400, 12, 7, 9, 1, 0, 0, 0, 0)


def test_the_checksum_equals_the_catalogue_value():
    """CRC-16/CCITT-FALSE of the nine digits is 0x29B1."""
    assert crc_hqx(b"123456789", CRC_START) == 0x29B1


@given(st.binary(max_size=MAX_FRAME_BYTES - 1))
def test_byte_stuffing_removes_every_zero_and_is_reversible(body):
    encoded_body = cobs_encode(body)
    assert 0 not in encoded_body
    assert len(encoded_body) == len(body) + 1
    assert cobs_decode(encoded_body) == body


def test_the_stop_frame_has_fixed_bytes():
    """By hand: kind 4, sequence 0 becomes a distance, CRC of 04 00."""
    wire = encode(Stop(), 0)
    assert wire == bytes.fromhex("00 02 04 03") + wire[4:6] + b"\0"
    assert len(wire) == 7


@given(st.lists(st.integers(0, 255), min_size=1, max_size=20), st.randoms(use_true_random=False))
def test_frames_received_in_any_parts_are_decoded_in_order(sequences, chance):
    wire = b"".join(encode(Ping(seq * 7919), seq) for seq in sequences)
    decoder, frames_received = Decoder(), []
    while wire:
        n = chance.randint(1, 9)
        frames_received += decoder.feed(wire[:n])
        wire = wire[n:]
    assert frames_received == [ReceivedFrame(seq, Ping(seq * 7919)) for seq in sequences]
    assert (decoder.bad_crc, decoder.bad_shape) == (0, 0)


@given(st.binary(min_size=1, max_size=300))
def test_fw6_noise_before_a_frame_does_not_lose_the_frame(noise):
    assert Decoder().feed(noise + encode(DRIVE, 3))[-1] == ReceivedFrame(3, DRIVE)


def test_endless_noise_does_not_fill_the_buffer():
    decoder = Decoder()
    for _ in range(100):
        decoder.feed(b"\x55" * 1000)
    assert len(decoder._incomplete) <= MAX_FRAME_BYTES + 1
    assert decoder.feed(b"\0") == []
    assert decoder.bad_crc == 1


def test_the_second_checksum_equals_the_catalogue_value():
    """CRC-16/T10-DIF of the nine digits is 0xD0DB."""
    assert crc16(b"123456789") == 0xD0DB


def test_a_command_with_only_a_valid_first_checksum_is_refused():
    """A heavily damaged frame that passed CRC-16 by chance looks like this."""
    body = bytes([0x01, 3]) + pack(DRIVE) + b"\x12\x34"
    wire = b"\0" + cobs_encode(body + crc_hqx(body, CRC_START).to_bytes(2, "big")) + b"\0"
    decoder = Decoder()
    assert decoder.feed(wire) == []
    assert decoder.bad_crc == 1


def test_the_two_checksum_polynomials_share_no_factor():
    """Euclid's algorithm over polynomials with coefficients mod 2: together they are one checksum of 32 bits."""
    a, b = 0x11021, 0x18BB7
    while b:
        while a.bit_length() >= b.bit_length():
            a ^= b << a.bit_length() - b.bit_length()
        a, b = b, a
    assert a == 1


def test_frames_with_up_to_three_changed_bits_are_refused():
    """The polynomial has Hamming distance 4 at these lengths, without the length byte of a COBS segment."""
    chance = random.Random(3)
    frame = encode(STATE, 9)
    accepted_count = 0
    for _ in range(20_000):
        wire = bytearray(frame)
        for place in chance.sample(range(8, 8 * (len(wire) - 1)), chance.randint(1, 3)):
            wire[place // 8] ^= 1 << place % 8
        accepted_count += sum(got.frame != STATE for got in Decoder().feed(bytes(wire)))
    assert accepted_count == 0


def test_a_frame_of_unknown_kind_or_length_is_counted_and_ignored():
    decoder = Decoder()
    assert decoder.feed(encode(Ping(1), 1, kind=0x7F) + encode_frame(0x01, 1, pack(Ping(1)))) == []
    assert (decoder.bad_crc, decoder.bad_shape) == (0, 2)


def test_frame_kinds_differ_between_the_two_directions():
    assert Decoder().feed(encode(Settings(), 1, kind=0x86)) == [ReceivedFrame(1, Settings())]
    assert encode(Settings(), 1, kind=0x86) != encode(Settings(), 1)


def test_a_value_out_of_range_is_not_sent():
    with refused("uno.number-range", UsageError, frame="Config", number=49, minimum=50, maximum=1000):
        encode(Config(dead_man_ms=49), 0)
    with refused("uno.number-range", UsageError, frame="Drive", number=1001):
        encode(Drive(0, 1001, 0, 0), 0)
