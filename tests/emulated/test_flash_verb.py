"""`baqueano robot flash`: real avrdude writes the package's firmware through the Uno's boot-loader in the emulator."""

import pytest

from baqueano.errors import FileError, RobotUnreachable, UsageError
from baqueano.robot.uno import flash as module
from baqueano.robot.uno.flash import flash, packaged_firmware, program_bytes
from tests.codes import refused
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


def test_r28_the_flash_command_writes_the_firmware_and_prints_its_version(firmware, optiboot):
    texts = []
    with on_pty(firmware, boot_loader=optiboot, flashed=False) as live:
        reset_when_opened(live)
        result = flash(live.path, notify=texts.append)
        program_written = program_bytes(packaged_firmware())
        with live.lock:
            assert live.uno.flash(0, len(program_written)) == program_written
    assert result.bytes == len(program_written)
    assert result.version.startswith("1.")
    assert "bytes written and read back" in result.table()
    assert f"writing {len(program_written)} bytes" in texts[0]


def test_a_hex_file_is_decoded_like_in_the_emulator(firmware):
    memory = bytearray(program_bytes(firmware.hex))
    for address, data in hex_chunks(firmware.hex):
        assert memory[address : address + len(data)] == data


def test_a_line_without_a_boot_loader_is_reported(firmware, optiboot):
    with on_pty(firmware) as live, refused("flash.failed", RobotUnreachable, port=live.path):
        flash(live.path)


def test_a_hanging_avrdude_is_ended(monkeypatch, tmp_path):
    slow = tmp_path / "avrdude"
    slow.write_text("#!/bin/sh\nexec sleep 60\n")
    slow.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin")
    monkeypatch.setattr(module, "FLASH_TIMEOUT_S", 0.2)
    with refused("flash.too-slow", RobotUnreachable, port="/dev/null", limit_s=0.2):
        flash("/dev/null")


def test_a_missing_avrdude_is_reported_with_the_install_command(monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    with refused("flash.no-avrdude", UsageError):
        flash("/dev/null")


@pytest.mark.parametrize(
    ("text", "code", "figures"),
    [
        (":10000000FFFF", "flash.bad-line", {"line": 1}),
        (":", "flash.bad-line", {"line": 1}),
        (":00000001FF\n:00", "flash.bad-line", {"line": 2}),
        ("hello", "flash.not-hex", {}),
        (":00000001FF", "flash.size", {"bytes": 0, "max_bytes": 32256}),
    ],
)
def test_a_file_that_is_not_a_firmware_is_refused(tmp_path, text, code, figures):
    path = tmp_path / "mine.hex"
    path.write_text(text)
    with refused(code, FileError, path=str(path), **figures):
        flash("/dev/null", path)
