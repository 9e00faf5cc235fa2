"""The flash and RAM of the firmware (R27), and its sources within the limits of an Arduino sketch."""

import re
import subprocess

from baqueano.robot.uno.frames import PROTOCOL, VERSION, Config, EncoderKind, Info, Ping, Settings
from tests.emulated.rig import FIRMWARE

PACKAGE = FIRMWARE.parents[1] / "src" / "baqueano" / "robot" / "files" / "uno.hex"
FLASH, RAM, PART_RAM = 6000, 700, 2048


def test_r27_flash_and_ram_are_within_their_limits(firmware):
    sizes = subprocess.run(["avr-size", firmware.elf], capture_output=True, text=True, check=True).stdout
    text, data, bss = map(int, sizes.splitlines()[1].split()[:3])
    assert text + data <= FLASH, f"{text + data} bytes of flash"
    assert data + bss <= RAM, f"{data + bss} bytes of RAM"


def test_r27_the_stack_leaves_more_than_half_of_the_ram_untouched(uno):
    """After everything that nests deepest: interrupts of encoders and bytes while frames are made."""
    uno.send(Settings(encoders=EncoderKind.QUADRATURE, dither_permille=30, kick_ms=10))
    uno.next_frame(Settings, 0.5)
    uno.send(Config(telemetry_ms=5))
    uno.arm()
    for k in range(100):
        uno.encoder(0, 100, uno.t_s, uno.t_s + 0.01)
        uno.encoder(1, 100, uno.t_s, uno.t_s + 0.01)
        uno.drive(1000 - 20 * k, -1000 + 20 * k)
        uno.send(Ping(k))
        uno.run(0.01)
    assert uno.info().least_free_ram > PART_RAM / 2


def test_su3_the_packaged_firmware_equals_the_build_of_its_sources(firmware, new_uno):
    """Equal bytes with the compiler that built it; with another compiler, the firmware runs and reports its version."""
    if "5.4.0" in subprocess.run(["avr-gcc", "--version"], capture_output=True, text=True, check=True).stdout:
        assert PACKAGE.read_bytes() == firmware.hex.read_bytes(), "run `make firmware` and commit uno.hex"
    # it starts at 0, as a program without a boot-loader
    package_uno = new_uno(boot_loader=PACKAGE, flashed=False)
    info = package_uno.next_frame(Info, 0.1)
    assert (info.protocol, info.version_major, info.version_minor, info.version_patch) == (PROTOCOL, *VERSION)


def test_the_sketch_file_contains_only_comments():
    lines = (FIRMWARE / "uno.ino").read_text(encoding="utf-8").splitlines()
    assert all(line.startswith("//") for line in lines)


def test_every_requirement_has_a_test_that_names_the_requirement():
    table = (FIRMWARE / "README.md").read_text(encoding="utf-8")
    promise_numbers = {int(n) for n in re.findall(r"^\| R(\d+) \|", table, re.MULTILINE)}
    tests = "".join(
        p.read_text(encoding="utf-8") for p in (FIRMWARE.parents[1] / "tests" / "emulated").glob("test_*.py")
    )
    proven = {int(n) for n in re.findall(r"def test_r(\d+)_", tests)}
    assert promise_numbers == set(range(1, len(promise_numbers) + 1))
    assert proven == promise_numbers
