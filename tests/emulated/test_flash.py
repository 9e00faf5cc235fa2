"""Real avrdude writes the real firmware through the Uno's own boot-loader, which runs in the emulator (R28)."""

import os
import select
import subprocess
import time

from baqueano.robot.uno.codec import Decoder
from baqueano.robot.uno.frames import Info, ResetCause, State, StateFlag
from tests.emulated.realtime import OnPty, on_pty
from tests.emulated.uno import hex_chunks


def reset_when_opened(live: OnPty) -> None:
    """Opening the port pulls DTR, which resets an Uno. A pty does not have DTR, so its first byte causes the reset."""
    take = live.uno.write

    def first(data: bytes) -> float:
        live.uno.write = take
        live.uno.reset()
        return live.uno.t_s

    live.uno.write = first


def first_state(path: str, seconds: float) -> State | None:
    """Return telemetry from the port, or fail after this time."""
    port, decoder, end = os.open(path, os.O_RDONLY | os.O_NOCTTY), Decoder(), time.monotonic() + seconds
    try:
        while time.monotonic() < end:
            if select.select([port], [], [], 0.1)[0]:
                for frame_received in decoder.feed(os.read(port, 4096)):
                    if isinstance(frame_received.frame, State):
                        return frame_received.frame
    finally:
        os.close(port)
    return None


def test_r28_avrdude_writes_and_verifies_the_firmware_and_it_starts(firmware, optiboot):
    program = b"".join(data for _, data in hex_chunks(firmware.hex))
    with on_pty(firmware, boot_loader=optiboot, flashed=False) as live:
        reset_when_opened(live)
        command = ["avrdude", "-q", "-c", "arduino", "-p", "m328p", "-P", live.path, "-b", "115200", "-D"]
        result = subprocess.run(
            [*command, "-U", f"flash:w:{firmware.hex}:i"], capture_output=True, text=True, timeout=120
        )
        assert result.returncode == 0, result.stderr[-1500:]
        assert f"{len(program)} bytes of flash verified" in result.stderr
        with live.lock:
            assert live.uno.flash(0, len(program)) == program
        state = first_state(live.path, 30)
        assert state is not None
        assert not state.flags & StateFlag.ARMED


def test_r6_a_hang_is_reported_although_the_boot_loader_clears_the_cause(new_uno, optiboot):
    """Optiboot of the Uno clears MCUSR; the count of ticks in RAM, which it preserves, shows the hang."""
    uno = new_uno(boot_loader=optiboot)
    first = uno.next_frame(Info, 3.0)
    assert not first.reset_cause & (ResetCause.HUNG | ResetCause.WATCHDOG)
    uno.hold(700, 700, 0.2)
    hung = uno.t_s
    uno.hang()
    uno.run(0.15)
    assert uno.off_since() - hung <= 0.15
    after = uno.info()
    assert after.reset_cause == ResetCause.WARM | ResetCause.HUNG
    assert after.nonce != first.nonce


def test_r1_motors_are_off_while_the_boot_loader_runs(new_uno, optiboot):
    uno = new_uno(boot_loader=optiboot)
    uno.next_frame(Info, 3.0)
    uno.hold(700, 700, 0.2)
    uno.reset()
    reset = uno.t_s
    uno.next_frame(Info, 3.0)
    assert uno.t_s - reset > 0.5, "the second that it waits for a programmer"
    assert uno.first_time(lambda out: any(out.pwm), after_s=reset + 1e-6) is None
