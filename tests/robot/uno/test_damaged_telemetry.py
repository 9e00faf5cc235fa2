"""A million damaged frames from the Uno: the 16-bit CRC refuses them, no exception occurs, and intact frames arrive.

Telemetry has one CRC, which detects each damage of up to three bits and each burst of up to 16 bits. It accepts one
in 65 536 of the other damages. A command has two CRCs, which accept none of them (tests/emulated/test_damage.py).
"""

import numpy as np
import pytest

from baqueano.robot.uno.codec import Decoder, ReceivedFrame, encode
from baqueano.robot.uno.frames import State
from baqueano.robot.uno.link import Uno
from tests.robot.uno.test_link import Line, info, state

EACH = 125_000  # for each of eight kinds of damage
AT_ONCE = 65_536  # bytes in one read


def telemetry(k, rng):
    """Return a possible telemetry frame at time k."""
    sums, duties = rng.integers(-(1 << 20), 1 << 20, 4).tolist(), rng.integers(-1000, 1001, 2).tolist()
    return State(
        10_000 * k, int(rng.integers(1 << 31)), *sums, *duties, 7400 + k % 50, 3, 7, k & 0xFF, 1, 0, 0, 0, 0
    )


@pytest.fixture(scope="module")
def frames_sent():
    """Return 4096 different undamaged frames."""
    rng = np.random.default_rng(1)
    return [ReceivedFrame(k & 0xFF, telemetry(k, rng)) for k in range(4096)]


@pytest.fixture(scope="module")
def intact(frames_sent):
    """Return the same frames (4096, 46) as bytes on the wire."""
    return np.array([list(encode(frame, seq)) for seq, frame in frames_sent], dtype=np.uint8)


class Kept(Decoder):
    """Stores the accepted frames."""

    def __init__(self):
        super().__init__()
        self.accepted_frames = []

    def feed(self, data):
        frames_received = super().feed(data)
        self.accepted_frames += frames_received
        return frames_received


def drawn_frames(complete, rng):
    """Return random frames (EACH, 46) of them."""
    return complete[rng.integers(len(complete), size=EACH)]


def flip_bits(frames, rng, max_flips):
    """Invert 1 to `max_flips` different bits."""
    spare = 8 * (frames.shape[1] - 2) - max_flips
    places = 8 + np.sort(rng.integers(spare + 1, size=(EACH, max_flips)), axis=1) + np.arange(max_flips)
    count, rows = rng.integers(1, max_flips + 1, EACH), np.arange(EACH)
    for k in range(max_flips):
        rows_k = rows[count > k]
        frames[rows_k, places[rows_k, k] // 8] ^= (1 << places[rows_k, k] % 8).astype(np.uint8)
    return frames


def burst(frames, rng, bits):
    """Replace a burst of `bits`: its ends are inverted, and the bits between them are random."""
    start = rng.integers(8, 8 * (frames.shape[1] - 1) - bits, EACH)
    frames_bad = np.unpackbits(np.zeros_like(frames), axis=1)
    for k in range(bits):
        frames_bad[np.arange(EACH), start + k] = 1 if k in (0, bits - 1) else rng.integers(2, size=EACH)
    return frames ^ np.packbits(frames_bad, axis=1)


def replaced(frames, rng):
    """Replace 1 to 12 consecutive bytes."""
    place, n = rng.integers(1, 33, EACH), rng.integers(1, 13, EACH)
    column = np.arange(frames.shape[1])
    mask = (column >= place[:, None]) & (column < (place + n)[:, None])
    return np.where(mask, rng.integers(256, size=frames.shape, dtype=np.uint8), frames)


def cut(frames, rng):
    """Remove 1 to 40 consecutive bytes; the result is flat, because the rows differ in length."""
    place = rng.integers(1, 45, EACH)
    n = rng.integers(1, 41, EACH)
    column = np.arange(frames.shape[1])
    cut_bytes = (column >= place[:, None]) & (column < np.minimum(place + n, 45)[:, None])
    return frames[~cut_bytes]


def inserted(frames, rng):
    """Insert 1 to 8 bytes."""
    place, n = rng.integers(1, 46, EACH), rng.integers(1, 9, EACH)
    column = np.arange(frames.shape[1] + 8)
    after = column >= (place + n)[:, None]
    mask = (column >= place[:, None]) & ~after
    source = np.where(after, column - n[:, None], np.minimum(column, frames.shape[1] - 1))
    longer = np.take_along_axis(frames, np.minimum(source, frames.shape[1] - 1), axis=1)
    longer = np.where(mask, rng.integers(256, size=longer.shape, dtype=np.uint8), longer)
    return longer[column < (frames.shape[1] + n)[:, None]]


def joined_frames(frames, next_frames, rng):
    """Join the head of one frame with the tail of another."""
    place = rng.integers(2, 44, EACH)
    return np.where(np.arange(frames.shape[1]) < place[:, None], frames, next_frames)


DAMAGE = {  # name: (function, True if a 16-bit CRC detects all of it)
    "3 bits": (lambda intact, rng: flip_bits(drawn_frames(intact, rng), rng, 3), True),
    "8 bits": (lambda intact, rng: flip_bits(drawn_frames(intact, rng), rng, 8), False),
    "a burst of 16": (lambda intact, rng: burst(drawn_frames(intact, rng), rng, 16), True),
    "a burst of 40": (lambda intact, rng: burst(drawn_frames(intact, rng), rng, 40), False),
    "other bytes": (lambda intact, rng: replaced(drawn_frames(intact, rng), rng), False),
    "bytes lost": (lambda intact, rng: cut(drawn_frames(intact, rng), rng), False),
    "bytes more": (lambda intact, rng: inserted(drawn_frames(intact, rng), rng), False),
    "another's tail": (
        lambda intact, rng: joined_frames(drawn_frames(intact, rng), drawn_frames(intact, rng), rng),
        False,
    ),
}


def test_a_16_bit_crc_accepts_few_of_a_million_damaged_frames(frames_sent, intact):
    rng, line = np.random.default_rng(2026), Line()
    uno = Uno(line, lambda: line.now_ns)
    uno._decoder = Kept()
    errors = {}
    for name, (harm, _) in DAMAGE.items():
        data = harm(intact, rng).tobytes()
        for start in range(0, len(data), AT_ONCE):
            line.coming = data[start : start + AT_ONCE]
            line.now_ns += 10_000_000
            uno.receive()
        errors[name] = len(set(uno._decoder.accepted_frames) - set(frames_sent))
        uno._decoder.accepted_frames.clear()
    assert all(errors[name] == 0 for name, (_, is_accepted) in DAMAGE.items() if is_accepted), errors
    assert sum(errors.values()) <= len(DAMAGE) * EACH / 65_536, errors  # measured: 6 of 15
    assert uno.statistics.damaged_frames > 0.9 * len(DAMAGE) * EACH
    line.send(info())
    line.send(state(10))
    assert uno.receive(), "intact frames are still received"
