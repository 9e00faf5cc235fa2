"""Damaged frames move no motor: a million frames on the firmware code on a host, and a noisy line on the binary
(R18).
"""

import json
import os
import random
import subprocess
import time
from pathlib import Path

import pytest

from baqueano.robot.uno.codec import encode
from baqueano.robot.uno.frames import Drive, DriveFlag, Ping, Pong, State
from tests.emulated.rig import FIRMWARE

BOARD = Path(__file__).with_name("host_board.c")
SANITIZER = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")


@pytest.fixture(scope="module")
def host_firmware(tmp_path_factory) -> Path:
    """Return the firmware without board.c and main.c, as a program of this machine."""
    program = tmp_path_factory.mktemp("host") / "host_firmware"
    sources = [p for p in FIRMWARE.glob("*.c") if p.name not in ("board.c", "main.c")]
    warnings = ("-Wall", "-Wextra", "-Wno-address-of-packed-member")  # laid out so that each is aligned
    command = [
        "gcc",
        "-std=gnu11",
        "-O2",
        *warnings,
        *SANITIZER,
        f"-I{FIRMWARE}",
        BOARD,
        *sources,
        "-o",
        program,
    ]
    subprocess.run(list(map(str, command)), check=True)
    return program


def counts_of(program: Path, seed: int, frames: int) -> dict[str, int]:
    result = subprocess.run([program, str(seed), str(frames)], capture_output=True, text=True)
    assert result.returncode == 0, result.stderr[-2000:]
    return json.loads(result.stdout)


def test_r18_fw4_a_million_damaged_frames_move_no_motor(host_firmware):
    """Bits, bytes, bursts, bytes lost and added, heads joined to other tails; the firmware is armed throughout.

    Without the seal of a command (frames.py (4)) CRC-16 alone lets one through in two of three such runs.
    """
    counts = counts_of(host_firmware, 2026, 1_000_000)
    assert counts["frames"] == 1_000_000
    assert counts["driven"] == counts["changed"] == counts["eeprom_writes"] == 0


def long_run(damages: int) -> bool:
    """`LONG=1 make test-emulated`: as many frames as a minute of processor time permits."""
    return time.process_time() > 60 and damages % 100 == 0 and not print(f"{damages} damaged frames")


def noisy(chance: random.Random, wire: bytes, share: float) -> bytes:
    """Return the bytes, each replaced by another byte with this probability."""
    return bytes(chance.randrange(256) if chance.random() < share else byte for byte in wire)


def test_r18_damaged_commands_move_nothing_and_are_counted(uno):
    chance = random.Random(8)
    uno.arm()
    nonce, seq, damages = uno.nonce(), uno.seq, 0
    before = uno.info().bad_crc
    uno.forget_outputs()
    enough = long_run if os.environ.get("LONG") else lambda n: n == 3000
    while not enough(damages):
        n = damages
        frame = encode(Drive(nonce, 900, -900, DriveFlag.ARM), seq + 1 + n % 100)
        wire = bytearray(frame)
        for place in chance.sample(range(8, 8 * (len(wire) - 1)), chance.randint(1, 8)):
            wire[place // 8] ^= 1 << place % 8
        uno.run_until(uno.write(bytes(wire)))
        damages += 1
        if n % 100 == 99:
            seq += 1
            uno.run_until(uno.drive(0, 0, seq=seq) + 1e-3)
    assert uno.first_time(lambda out: any(out.pwm)) is None
    assert (uno.info().bad_crc - before) & 0xFFFF >= min(damages, 3000)  # counts mod 65 536
    uno.seq = seq
    uno.hold(900, -900, 0.1)
    assert uno.duty(0) == pytest.approx(0.9), "valid commands are still executed"


def test_r18_noise_alone_moves_no_motor_and_telemetry_continues(uno):
    chance = random.Random(9)
    uno.arm()
    uno.forget_outputs()
    uno.run_until(uno.write(chance.randbytes(10_000)))
    assert uno.first_time(lambda out: any(out.pwm)) is None
    uno.frames()
    before = len(uno.transcript)
    uno.write(chance.randbytes(1000))
    uno.run(0.095)
    uno.frames()
    assert len([r for _, r in uno.transcript[before:] if isinstance(r.frame, State)]) >= 9


def test_r18_fw6_noise_before_a_frame_does_not_lose_the_frame(uno):
    chance = random.Random(10)
    uno.run(0.02)
    uno.frames()
    for token in range(100):
        junk = bytes(chance.randrange(1, 256) for _ in range(chance.randint(1, 60)))
        uno.run_until(uno.write(junk + encode(Ping(token), token)))
        uno.run(0.005)
    uno.frames()
    tokens = [r.frame.token for _, r in uno.transcript if isinstance(r.frame, Pong)]
    assert tokens == list(range(100))


def test_r18_the_vehicle_drives_with_5_percent_of_bytes_damaged(uno):
    """A command of 16 bytes arrives undamaged with 0.95¹⁶ = 44 %. At 100 Hz, 30 commands fall within the command
    timeout."""
    chance = random.Random(11)
    uno.arm()
    uno.keep(500, 500, 0.1)
    uno.forget_outputs()
    nonce = uno.nonce()
    for _ in range(500):
        uno.seq = (uno.seq + 1) & 0xFF
        uno.write(noisy(chance, encode(Drive(nonce, 500, 500, DriveFlag.ARM), uno.seq), 0.05))
        uno.run(0.01)
    duties = {round(1000 * out.terminal(k, uno.driver).duty) for out in uno.outputs() for k in range(2)}
    assert duties == {500}
    info = uno.info()
    assert 200 < info.bad_crc < 400
