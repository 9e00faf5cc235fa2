"""Write the firmware into the Uno with avrdude through its boot-loader, then request the firmware's identity.

The package contains the firmware as the compiler of Debian 12 makes it (avr-gcc 5.4.0). A build of firmware/uno in any
folder has the same bytes, which a test checks. The settings of the vehicle are in EEPROM and are kept.
"""

import shutil
import subprocess
import zlib
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path
from typing import NamedTuple

from baqueano.contracts.values import TableRow
from baqueano.errors import FileError, RobotUnreachable, UsageError
from baqueano.messages.language import translate as _
from baqueano.robot.uno.frames import PROTOCOL
from baqueano.robot.uno.serial_port import find_port, open_uno

FIRMWARE_NAME = "uno.hex"
FLASH_TIMEOUT_S = 60.0
FLASH_BYTES = 32_256  # without the boot-loader


class FlashResult(NamedTuple):
    """The result of `flash`: port, size, and the identity of the firmware that answered afterwards."""

    port: str
    bytes: int
    version: str
    boots: int

    verdict = "FLASHED"

    def rows(self) -> list[TableRow]:
        """Return the result as a list of one row."""
        return [self._asdict()]

    def table(self) -> str:
        """Return the result as one line of text."""
        return _(
            "{port}: {bytes} bytes written and read back; firmware {version}, protocol {protocol}, boot {boots}",
            port=self.port,
            bytes=self.bytes,
            version=self.version,
            protocol=PROTOCOL,
            boots=self.boots,
        )


def packaged_firmware() -> Path:
    """Return the path of the firmware's hex file in this package."""
    return Path(str(files("baqueano.robot") / "files" / FIRMWARE_NAME))


def program_bytes(path: Path) -> bytes:
    """Return the program in an Intel hex file, from address 0 on. Raise FileError for a damaged or too large file."""
    memory = bytearray()
    try:
        lines = path.read_text(encoding="ascii").split()
        for line_number, line in enumerate(lines, 1):
            record = bytes.fromhex(line.removeprefix(":"))
            if (
                not line.startswith(":")
                or sum(record) & 0xFF
                or len(record) < 5
                or len(record) != 5 + record[0]
            ):
                raise FileError.of("flash.bad-line", path=path, line=line_number)
            if record[3] == 0:
                address = record[1] << 8 | record[2]
                memory.extend(b"\xff" * (address + record[0] - len(memory)))
                memory[address : address + record[0]] = record[4:-1]
    except (OSError, ValueError) as error:
        raise FileError.of("flash.not-hex", path=path, error=error) from error
    if not 0 < len(memory) <= FLASH_BYTES:
        raise FileError.of("flash.size", path=path, bytes=len(memory), max_bytes=FLASH_BYTES)
    return bytes(memory)


def checksum(path: Path) -> str:
    """Return the CRC-32 of a hex file's program as eight hexadecimal digits."""
    return f"{zlib.crc32(program_bytes(path)):08x}"


def flash(
    port: str = "auto", hex_file: Path | None = None, notify: Callable[[str], object] = lambda text: None
) -> FlashResult:
    """Write `hex_file`, or the package's firmware if None, and return the identity of the new firmware.

    Raise UsageError if avrdude is not installed, and FileError for a damaged file. Raise RobotUnreachable if the
    boot-loader or the new firmware does not answer.
    """
    path = hex_file or packaged_firmware()
    byte_count = len(program_bytes(path))
    avrdude = shutil.which("avrdude")
    if avrdude is None:
        raise UsageError.of("flash.no-avrdude")
    device_path = find_port(port)
    notify(
        _(
            "{where}: writing {size} bytes ({name}, {checksum})",
            where=device_path,
            size=byte_count,
            name=path.name,
            checksum=checksum(path),
        )
    )
    _write(avrdude, device_path, path)
    with open_uno(device_path) as uno:
        info = uno.info
        assert info is not None
        version = f"{info.version_major}.{info.version_minor}.{info.version_patch}"
        return FlashResult(device_path, byte_count, version, info.boots)


def _write(avrdude: str, device_path: str, path: Path) -> None:
    command = [
        avrdude,
        "-q",
        "-c",
        "arduino",
        "-p",
        "m328p",
        "-P",
        device_path,
        "-b",
        "115200",
        "-D",
        "-U",
        f"flash:w:{path}:i",
    ]
    try:
        process = subprocess.run(
            command, capture_output=True, encoding="utf-8", errors="replace", timeout=FLASH_TIMEOUT_S
        )
    except subprocess.TimeoutExpired as error:
        raise RobotUnreachable.of("flash.too-slow", port=device_path, limit_s=FLASH_TIMEOUT_S) from error
    if process.returncode:
        complaint = [line for line in process.stderr.splitlines() if line.strip() and "ioctl" not in line]
        raise RobotUnreachable.of(
            "flash.failed", port=device_path, reply=complaint[0] if complaint else process.returncode
        )
