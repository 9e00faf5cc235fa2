"""Debian's Python for the processor of a Pi, and the wheels that `robot setup` sends there, to be run by qemu.

    python -m tests.emulated.aarch64      makes both in build/aarch64, about 130 MB, once; `make aarch64` calls it

qemu emulates the instructions of the processor and not its timing. A program that runs here has all its wheels and no
instruction that a Cortex-A53 lacks. The speed of a Pi remains unknown.
"""

import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

from baqueano.robot.setup.install import TargetMachine, make_bundle

ROOT = Path(__file__).parents[2]
HOME = ROOT / "build" / "aarch64"
SYSTEM, WHEELS, PACKAGES = HOME / "system", HOME / "wheels", HOME / "packages"
DEBIAN = (
    "python3.11", "libpython3.11-stdlib", "libffi8", "libsqlite3-0", "libstdc++6", "libgcc-s1", "zlib1g", "umockdev",
)  # fmt: skip
QEMU, MAKER, COMPILER = "qemu-aarch64-static", "mmdebstrap", "aarch64-linux-gnu-gcc"


def missing() -> str:
    """Return the missing part and the command that installs it, or ""."""
    if not shutil.which(QEMU):
        return f"no {QEMU}: sudo apt-get install qemu-user-static"
    return "" if PACKAGES.exists() else f"no {PACKAGES.relative_to(ROOT)}: make aarch64"


def python() -> list[str]:
    """The words before the arguments of a Python on that processor."""
    return [
        shutil.which(QEMU) or QEMU,
        "-cpu",
        "cortex-a53",
        "-L",
        str(SYSTEM),
        str(SYSTEM / "usr/bin/python3.11"),
    ]


def environment(compiler: bool, cache: Path) -> dict[str, str]:
    """In which it finds the sources and the wheels, and a C compiler or none, as on a Pi without build-essential."""
    paths = {
        "PYTHONHOME": str(SYSTEM / "usr"), "PYTHONPATH": f"{ROOT / 'src'}:{PACKAGES}", "PYTHONDONTWRITEBYTECODE": "1",
        "XDG_CACHE_HOME": str(cache), "PATH": "/nowhere",
    }  # fmt: skip
    return paths | ({"BAQUEANO_CC": shutil.which(COMPILER) or COMPILER} if compiler else {})


def make() -> None:
    """Install the system and the packages if they are missing."""
    HOME.mkdir(parents=True, exist_ok=True)
    if not SYSTEM.exists():
        options = ["--arch=arm64", "--variant=extract", f"--include={','.join(DEBIAN)}"]
        subprocess.run([MAKER, *options, "bookworm", str(SYSTEM)], check=True)
    if not PACKAGES.exists():
        make_bundle(WHEELS, TargetMachine((3, 11), "aarch64", "pilot"), print)
        for wheel in WHEELS.glob("*.whl"):
            with zipfile.ZipFile(wheel) as archive:
                archive.extractall(PACKAGES)


if __name__ == "__main__":
    sys.exit(make())
