"""Build the firmware and the emulator library, and call the library through ctypes.

Both are built once into a folder that is named after their sources. So all tests and other users of an emulated Uno
share them.
"""

import ctypes
import hashlib
import os
import shutil
import subprocess
import tempfile
from ctypes import (
    POINTER,
    c_char_p,
    c_float,
    c_int,
    c_size_t,
    c_uint8,
    c_uint16,
    c_uint32,
    c_uint64,
    c_void_p,
)
from pathlib import Path
from typing import ClassVar, NamedTuple

ROOT = Path(__file__).parents[2]
FIRMWARE = ROOT / "firmware" / "uno"
SHIM = Path(__file__).with_name("rig.c")
PROGRAMS = {"gcc": "gcc", "make": "make", "avr-gcc": "gcc-avr", "avr-objcopy": "binutils-avr"}
FILES = {
    "/usr/lib/avr/include/avr/io.h": "avr-libc",
    "/usr/include/simavr/sim_avr.h": "libsimavr-dev",
    "/usr/include/libelf.h": "libelf-dev",
}


class Level(ctypes.Structure):
    """The levels of the motor pins from `cycle` on."""

    _fields_: ClassVar = [
        ("cycle", c_uint64),
        ("pwm", c_float * 2),
        ("inputs", (c_uint8 * 2) * 2),
        ("standby", c_uint8),
        ("lamp", c_uint8),
        ("driven", c_uint8),
        ("_pad", c_uint8),
    ]


class Sent(ctypes.Structure):
    """A byte that the firmware put into its transmitter."""

    _fields_: ClassVar = [("cycle", c_uint64), ("byte", c_uint8)]


class Built(NamedTuple):
    """The files from which an emulated Uno is made."""

    elf: Path
    hex: Path
    library: ctypes.CDLL


def missing() -> list[str]:
    """Return the Debian packages that an emulated Uno needs and that are not installed."""
    lacking = [package for program, package in PROGRAMS.items() if not shutil.which(program)]
    return lacking + [package for path, package in FILES.items() if not Path(path).exists()]


def digest() -> str:
    """Return the digest of all sources."""
    sources = [
        SHIM,
        *sorted(p for p in FIRMWARE.iterdir() if p.suffix in (".c", ".h") or p.name == "Makefile"),
    ]
    return hashlib.sha256(b"".join(p.name.encode() + p.read_bytes() for p in sources)).hexdigest()[:16]


def call(*command: str | Path) -> None:
    result = subprocess.run(list(map(str, command)), capture_output=True, text=True)
    if result.returncode:
        raise RuntimeError(f"{' '.join(map(str, command))} failed:\n{result.stdout}{result.stderr}")


def build(cache: Path) -> Built:
    """Build the firmware and the library in a folder of `cache`, if they are not there yet."""
    folder = cache / digest()
    if not folder.exists():
        cache.mkdir(parents=True, exist_ok=True)
        making = Path(tempfile.mkdtemp(dir=cache))
        call("make", "-s", "-C", FIRMWARE, f"OUT={making}")
        libraries = ("-lsimavr", "-lelf")
        call(
            "gcc", "-O2", "-Wall", "-Wextra", "-shared", "-fPIC", SHIM, "-o", making / "librig.so", *libraries
        )
        try:
            os.rename(making, folder)
        except OSError:  # another worker was quicker
            shutil.rmtree(making)
    return Built(folder / "uno.elf", folder / "uno.hex", with_types(ctypes.CDLL(str(folder / "librig.so"))))


def with_types(library: ctypes.CDLL) -> ctypes.CDLL:
    """Return the library with the signatures of rig.c."""
    buffer = (c_void_p, c_uint32, c_char_p, c_size_t)
    signatures: dict[str, tuple[object, tuple[object, ...]]] = {
        "rig_new": (c_void_p, (c_char_p,)),
        "rig_free": (None, (c_void_p,)),
        "rig_run_until": (c_int, (c_void_p, c_uint64)),
        "rig_reset": (None, (c_void_p, c_uint8)),
        "rig_put": (None, (c_void_p, c_uint64, c_uint8, c_uint8, c_uint16)),
        "rig_forget": (None, (c_void_p,)),
        "rig_cycle": (c_uint64, (c_void_p,)),
        "rig_instructions": (c_uint64, (c_void_p,)),
        "rig_resets": (c_uint32, (c_void_p,)),
        "rig_pc": (c_uint32, (c_void_p,)),
        "rig_jump": (None, (c_void_p, c_uint32)),
        "rig_interrupts_off": (None, (c_void_p,)),
        "rig_start_at": (None, (c_void_p, c_uint32)),
        "rig_outs": (c_size_t, (c_void_p,)),
        "rig_out": (POINTER(Sent), (c_void_p,)),
        "rig_clear_out": (None, (c_void_p,)),
        "rig_n_levels": (c_size_t, (c_void_p,)),
        "rig_levels": (POINTER(Level), (c_void_p,)),
        "rig_clear_levels": (None, (c_void_p,)),
        **{
            f"rig_{place}": (None, buffer)
            for place in ("flash", "flash_read", "ram", "ram_read", "eeprom", "eeprom_read")
        },
    }
    for name, (result, arguments) in signatures.items():
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments
    return library
