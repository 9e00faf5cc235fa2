"""The layout of the frames: the header of the firmware is generated from it, and a C compiler gives the same layout."""

import shutil
import struct
import subprocess
from pathlib import Path

import pytest
from hypothesis import given, strategies as st

from baqueano.robot.uno import frames
from baqueano.robot.uno.frames import (
    KIND_LAYOUTS,
    LAYOUT_FIELDS,
    LAYOUT_KINDS,
    LAYOUT_STRUCTS,
    LAYOUTS,
    MAX_PAYLOAD,
    Field,
    ValueRange,
)
from firmware.uno.c_header import c_header, snake_case

ROOT = Path(__file__).parents[3]
HEADER = ROOT / "firmware" / "uno" / "frames.h"


def any_number(field: Field) -> st.SearchStrategy[int]:
    return st.integers(field.value_range.low, field.value_range.high)


def any_frame() -> st.SearchStrategy[frames.Frame]:
    """Return frames of each kind with numbers in their ranges."""

    def of(layout):
        return st.tuples(*map(any_number, LAYOUT_FIELDS[layout])).map(
            lambda n: frames.unflatten(layout, list(n))
        )

    return st.one_of(*map(of, LAYOUT_KINDS))


@given(any_frame())
def test_packing_and_unpacking_return_the_same_frame(frame):
    assert frames.unpack(type(frame), frames.pack(frame)) == frame
    assert frames.first_out_of_range(frame) is None


def test_the_generated_firmware_header_is_current():
    assert HEADER.read_text(encoding="utf-8") == c_header(), "run `make firmware` and commit frames.h"


def test_every_payload_fits_the_buffer_of_the_firmware():
    assert max(frames.PAYLOAD_LENGTHS.values()) <= MAX_PAYLOAD


def test_frame_kinds_sent_by_the_firmware_have_bit_7_set():
    assert {kind for kind in KIND_LAYOUTS if kind & 0x80} == {0x81, 0x83, 0x85, 0x86}
    assert LAYOUT_KINDS[frames.Settings] == 0x06


def test_default_settings_are_within_their_ranges():
    assert frames.first_out_of_range(frames.Config()) is None
    assert frames.first_out_of_range(frames.Settings()) is None


def test_a_number_out_of_range_is_named_with_its_field():
    ways = (frames.WheelCurve(),) * 3 + (frames.WheelCurve(slope_permille=99),)
    fault = frames.first_out_of_range(frames.Settings(curves=ways))
    assert fault == ("curves[3].slope_permille", 99, ValueRange(100, 3000))


def test_a_number_without_a_stated_range_is_limited_by_its_bits():
    assert frames.first_out_of_range(frames.Ping(1 << 32)) == ("token", 1 << 32, ValueRange(0, (1 << 32) - 1))
    assert frames.first_out_of_range(frames.Pong(0, -1)) is not None


@pytest.mark.skipif(shutil.which("gcc") is None, reason="no C compiler to ask")
def test_each_frame_has_the_same_layout_in_c_and_python(tmp_path):
    lines = []
    for layout in LAYOUTS:
        name = snake_case(layout.__name__)
        if not LAYOUT_FIELDS[layout]:
            continue
        lines.append(f'printf("{name} %zu\\n", sizeof({name}_t));')
        for field in LAYOUT_FIELDS[layout]:
            lines.append(f'printf("{name}.{field.path} %zu\\n", offsetof({name}_t, {field.path}));')
    source = tmp_path / "layout.c"
    body = "\n".join(lines)
    source.write_text(
        f'#include <stddef.h>\n#include <stdio.h>\n#include "{HEADER}"\nint main(void) {{\n{body}\nreturn 0; }}\n'
    )
    subprocess.run(["gcc", "-std=c11", "-o", tmp_path / "layout", source], check=True)
    output = subprocess.run([tmp_path / "layout"], capture_output=True, text=True, check=True).stdout
    places = dict(line.split() for line in output.splitlines())
    for layout in LAYOUTS:
        name, place = snake_case(layout.__name__), 0
        for field in LAYOUT_FIELDS[layout]:
            assert int(places[f"{name}.{field.path}"]) == place
            place += struct.calcsize(field.code)
        if LAYOUT_FIELDS[layout]:
            assert int(places[name]) == place == LAYOUT_STRUCTS[layout].size
