"""Generate frames.h from src/baqueano/robot/uno/frames.py: `python firmware/uno/c_header.py` prints it."""

from typing import Any, get_type_hints

from baqueano.robot.uno import frames
from baqueano.robot.uno.frames import KIND_LAYOUTS, LAYOUT_STRUCTS, LAYOUTS, Config, Frame, Settings

C_TYPES = {"B": "uint8_t", "H": "uint16_t", "I": "uint32_t", "h": "int16_t", "i": "int32_t"}


def snake_case(name: str) -> str:
    """Return a name in snake case: AskInfo → ask_info."""
    return "".join(("_" if c.isupper() and k else "") + c.lower() for k, c in enumerate(name))


def c_struct(layout: type[Any]) -> list[str]:
    """Return a layout as lines of C: its packed structure, its length, and the ranges of its fields."""
    name, lines, ranges = snake_case(layout.__name__), [], []
    for field, hint in get_type_hints(layout, include_extras=True).items():
        code, *annotations = hint.__metadata__
        if not isinstance(code, str):
            times = f"[{annotations[0].repetitions}]" if annotations else ""
            lines.append(f"    {snake_case(code.__name__)}_t {field}{times};")
            continue
        lines.append(f"    {C_TYPES[code]} {field};")
        if annotations:
            ranges += [
                f"#define {name.upper()}_{field.upper()}_{bound} {value}"
                for bound, value in zip(("LEAST", "MOST"), annotations[0], strict=True)
            ]
    length = f"#define {name.upper()}_LENGTH {LAYOUT_STRUCTS[layout].size}"
    c_lines = ["typedef struct __attribute__((packed)) {", *lines, f"}} {name}_t;"] if lines else []
    return ["", *c_lines, length, *ranges]


def c_header() -> str:
    """Return the text of firmware/uno/frames.h."""
    lines = [
        "/* Made from src/baqueano/robot/uno/frames.py: change that, then `make firmware`. */",
        "#pragma once",
        "#include <stdint.h>",
        "",
        f"#define PROTOCOL {frames.PROTOCOL}",
        f"#define BAUD_RATE {frames.BAUD}UL",
        f"#define MAX_PAYLOAD {frames.MAX_PAYLOAD}",
        f"#define NO_AGE {frames.NO_AGE}",
        f"#define SEAL_POLYNOMIAL 0x{frames.CRC_POLYNOMIAL:04x}",
        f"#define SEALED_KINDS 0x{sum(1 << kind for kind in frames.CRC_KINDS):02x} /* a bit for each */",
        *(
            f"#define VERSION_{part} {n}"
            for part, n in zip(("MAJOR", "MINOR", "PATCH"), frames.VERSION, strict=True)
        ),
    ]
    for kind, layout in KIND_LAYOUTS.items():
        suffix = "_NOW" if layout is Settings and kind & 0x80 else ""
        lines.append(f"#define KIND_{snake_case(layout.__name__).upper()}{suffix} 0x{kind:02x}")
    for group in (
        frames.DriveFlag,
        frames.StateFlag,
        frames.ResetCause,
        frames.Driver,
        frames.EncoderKind,
        frames.Wiring,
    ):
        names = snake_case(group.__name__).upper()
        lines += ["", *(f"#define {names}_{member.name} {member.value}" for member in group)]
    lines += [
        "",
        *(f"#define MOST_PWM_HZ_{driver.name} {max_hz}" for driver, max_hz in frames.MAX_PWM_HZ.items()),
    ]
    for layout in LAYOUTS:
        lines += c_struct(layout)
    lines += ["", *defaults("CONFIG", Config()), *defaults("SETTINGS", Settings())]
    return "\n".join(lines) + "\n"


def defaults(name: str, frame: Frame) -> list[str]:
    """Return the lines that define the default initialiser of the structure `name`."""

    def braces(values: tuple[Any, ...]) -> str:
        return "{" + ", ".join(braces(v) if isinstance(v, tuple) else str(int(v)) for v in values) + "}"

    return [f"#define {name}_DEFAULT {braces(frame)}"]


if __name__ == "__main__":
    print(c_header(), end="")
