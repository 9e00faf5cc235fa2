"""The folder builds as the Arduino IDE builds a sketch: its flags, its core in an archive, our `main` in place of
its own.
"""

import subprocess
from pathlib import Path

from tests.emulated.rig import FIRMWARE

AVR = Path("/usr/share/arduino/hardware/arduino/avr")
SHARED = (
    "-Os",
    "-w",
    "-ffunction-sections",
    "-fdata-sections",
    "-flto",
    "-mmcu=atmega328p",
    "-DF_CPU=16000000L",
)
ARDUINO = ("-DARDUINO=10819", "-DARDUINO_AVR_UNO", "-DARDUINO_ARCH_AVR", "-DDECIMAL_DIG=__DECIMAL_DIG__")
C = ("avr-gcc", "-c", "-std=gnu11", *SHARED, *ARDUINO, "-ffat-lto-objects")
CPP = (
    "avr-g++",
    "-c",
    "-std=gnu++11",
    "-fpermissive",
    "-fno-exceptions",
    *SHARED,
    *ARDUINO,
    "-ffat-lto-objects",
)


def run(*command: object) -> str:
    result = subprocess.run([str(part) for part in command], capture_output=True, text=True)
    assert result.returncode == 0, result.stderr[-2000:]
    return result.stdout


def test_the_folder_builds_as_a_sketch(arduino_core, firmware, tmp_path):
    includes = (f"-I{AVR}/cores/arduino", f"-I{AVR}/variants/standard")
    core = [AVR / "cores/arduino" / name for name in ("main.cpp", "hooks.c", "wiring.c", "abi.cpp")]
    sketch = tmp_path / "uno.ino.cpp"
    sketch.write_text("#include <Arduino.h>\n" + (FIRMWARE / "uno.ino").read_text(encoding="utf-8"))
    objects: dict[str, list[Path]] = {"core": [], "ours": []}
    for kind, sources in (("core", core), ("ours", [sketch, *FIRMWARE.glob("*.c")])):
        for source in sources:
            object_file = tmp_path / f"{kind}_{source.name}.o"
            run(*(CPP if source.suffix == ".cpp" else C), *includes, source, "-o", object_file)
            objects[kind].append(object_file)
    archive = tmp_path / "core.a"
    run("avr-ar", "rcs", archive, *objects["core"])
    elf = tmp_path / "uno.elf"
    run("avr-gcc", *SHARED, "-fuse-linker-plugin", "-Wl,--gc-sections", *objects["ours"], archive, "-o", elf)
    assert "setup" not in run("avr-nm", elf), "the core's main would call it"
    sizes = [sum(map(int, run("avr-size", path).splitlines()[1].split()[:2])) for path in (firmware.elf, elf)]
    assert abs(sizes[1] - sizes[0]) < 600
