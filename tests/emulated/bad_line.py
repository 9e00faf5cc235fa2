"""A fault injector between the link and the serial line of an emulated robot."""

import random
from collections.abc import Iterator
from typing import Any


class BadLine:
    """A line that is disconnected while `gone`. Otherwise each byte is changed with probability `noise`. With
    `twice` a frame is sent twice, and with `swapped` after the next frame, in both directions."""

    def __init__(self, robot: Any, seed: int = 0) -> None:
        self.gone, self.noise, self.twice, self.swapped = False, 0.0, 0.0, 0.0
        self._chance = random.Random(seed)
        self._write, self._read = robot.write, robot.read
        self._open, self._delayed_frames = b"", {"to": b"", "of": b""}
        robot.write, robot.read = self.write, self.read

    def write(self, data: bytes) -> None:
        """Send one frame to the Uno; raise OSError if the line is disconnected."""
        if self.gone:
            raise OSError("the line is gone")
        for frame in self._passed("to", data):
            self._write(self._noisy(frame))

    def read(self) -> bytes:
        """Return the received bytes; raise OSError if the line is disconnected."""
        data = self._read()
        if self.gone:
            raise OSError("the line is gone")
        *frames, self._open = (self._open + data).split(b"\0")
        frames_out = (frame for body in frames if body for frame in self._passed("of", b"\0" + body + b"\0"))
        return b"".join(map(self._noisy, frames_out))

    def _passed(self, direction: str, frame: bytes) -> Iterator[bytes]:
        delayed_frame, self._delayed_frames[direction] = self._delayed_frames[direction], b""
        if not delayed_frame and self._chance.random() < self.swapped:
            self._delayed_frames[direction] = frame
            return
        yield frame
        if self._chance.random() < self.twice:
            yield frame
        if delayed_frame:
            yield delayed_frame

    def _noisy(self, frame: bytes) -> bytes:
        chance = self._chance
        return bytes(chance.randrange(256) if chance.random() < self.noise else byte for byte in frame)
