"""The file as bytes: encodings, truncated files, malicious files, duplicate keys."""

import json
import random
import string
import time

import pytest

from baqueano.errors import FileError
from baqueano.vehicle_file import load, parse
from baqueano.vehicle_file.text.dump import dump
from baqueano.vehicle_file.text.toml_text import key_line, tables
from tests.codes import refused

SMALL = load("small").text


def reason_of(tmp_path, content):
    """Code and figures of the refusal of a file with this content."""
    path = tmp_path / "my.toml"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(FileError) as error_info:
        load(path)
    return error_info.value.diagnostic.code, error_info.value.diagnostic.figures


@pytest.mark.parametrize("newline", ["\n", "\r\n"])
@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf"])
def test_byte_order_marks_and_all_line_ends_are_accepted(tmp_path, mark, newline):
    path = tmp_path / "my.toml"
    path.write_bytes(mark + SMALL.replace("\n", newline).encode())
    assert load(path).vehicle.mass_kg == 0.61


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be"])
def test_utf_16_is_refused_with_the_remedy(tmp_path, encoding):
    content = SMALL.encode(encoding)
    if encoding == "utf-16-be":
        content = b"\xfe\xff" + content
    code = "toml.zero-bytes" if encoding == "utf-16-le" else "toml.utf-16"
    assert reason_of(tmp_path, content) == (code, {"file": "my.toml"})


def test_a_non_utf_8_accent_is_reported_with_its_line(tmp_path):
    reason = reason_of(tmp_path, b'format = 1\nname = "Jos\xe9"\n')
    assert reason == ("toml.not-utf-8", {"file": "my.toml", "line": 2, "byte": 0xE9})


def test_zero_bytes_in_a_file_are_reported(tmp_path):
    assert reason_of(tmp_path, b"format = 1\n\0\0\0\0") == ("toml.zero-bytes", {"file": "my.toml"})


@pytest.mark.parametrize("content", [b"", b"  \n\n", b"\xef\xbb\xbf"])
def test_an_empty_file_is_reported_as_truncated(tmp_path, content):
    assert reason_of(tmp_path, content) == ("toml.empty", {"file": "my.toml"})


def test_fi4_a_too_large_file_is_refused(tmp_path):
    figures = {"file": "my.toml", "size": 65601, "largest": 65536}
    assert reason_of(tmp_path, "#" * 65600 + "\n") == ("toml.too-large", figures)


def test_an_unreadable_file_is_reported_with_its_reason(tmp_path, monkeypatch):
    from pathlib import Path

    path = tmp_path / "my.toml"
    path.write_text(SMALL, encoding="utf-8")

    def refuse(self):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "read_bytes", refuse)
    with refused("toml.not-read", FileError):
        load(path)


def test_fi4_deep_nesting_is_refused():
    for levels in (40, 20000):
        with refused("toml.too-deep", FileError):
            tables("x = " + "[" * levels + "]" * levels, "my.toml")


def test_fi4_a_key_of_thousands_of_parts_is_refused_at_once():
    start = time.process_time()
    with refused("toml.long-key", FileError, line=2, maximum=32):
        tables("format = 1\n" + ".".join("a" * 20000) + " = 1", "my.toml")
    assert time.process_time() - start < 0.5


def test_fi4_a_number_of_thousands_of_digits_is_refused():
    with refused("toml.number", FileError):
        tables("x = " + "9" * 5000, "my.toml")


@pytest.mark.parametrize(
    ("text", "code", "line", "figures"),
    [
        ("mass_kg = 1\nmass_kg = 2", "toml.twice", 2, {"value": "'mass_kg = 2'"}),
        ("[model]\nx = 1\n[model]\ny = 2", "toml.twice", 3, {"value": "'[model]'"}),
        ("mass_kg = 0,61", "toml.decimal-comma", 1, {"decimal_reading": "mass_kg = 0.61"}),
        ("name = small", "toml.no-quotes", 1, {}),
        ("limit = [0,5, 0,05]", "toml.decimal-commas", 1, {}),
        ("flag = True", "toml.no-quotes", 1, {}),
        ("mass_kg = ", "toml.syntax", 1, {"value": "'mass_kg ='", "error": "invalid value"}),
        ("mass_kg 0.61", "toml.syntax", 1, {}),
    ],
)
def test_fi1_invalid_toml_is_reported_with_its_line(text, code, line, figures):
    with refused(code, FileError, file="my.toml", line=line, **figures):
        tables(text, "my.toml")


def test_the_line_number_of_every_key_is_determined():
    lines = SMALL.splitlines()
    for path in [
        ("name",),
        ("model", "mass_kg"),
        ("model", "drivetrain", "lag_s"),
        ("sensors", "imu", "gyro_bias"),
    ]:
        assert lines[key_line(SMALL, path) - 1].startswith(path[-1])
    assert key_line(SMALL, ("model", "nothing")) is None
    assert key_line('[provenance."a.b"]\nrun = ""', ("provenance", "a.b")) == 1


def test_data_written_as_toml_are_read_back_unchanged():
    data = tables(SMALL, "x") | {
        "text": 'quotes " and \\ and ñ',
        "odd": {"a key": [[1.0], [2.0, 3.0]], "n": float("nan")},
    }
    data_again = tables(dump(data), "y")
    assert json.dumps(data_again, sort_keys=True) == json.dumps(data, sort_keys=True)


def test_fi2_typing_errors_are_detected_and_the_correct_key_is_proposed():
    """One letter of a key is changed, omitted, doubled or swapped, 200 times: all are detected, 95 % are corrected."""
    rng = random.Random(7)
    keys = [line.split(" =")[0] for line in SMALL.splitlines() if " = " in line and line[:1].isalpha()]
    keys = [k for k in keys if len(k) > 3 and k not in ("kind", "format", "name", "about")]
    count_named = 0
    for _ in range(200):
        key = rng.choice(keys)
        misspelt_key = typed_wrong(rng, key)
        if misspelt_key in keys:
            count_named += 1
            continue
        text = "\n".join(
            line.replace(key, misspelt_key, 1) if line.startswith(f"{key} ") else line
            for line in SMALL.split("\n")
        )
        with pytest.raises(FileError) as error_info:
            parse(text, "my.toml")
        count_named += f"Did you mean {key}?" in str(error_info.value) or f" {key} " in str(error_info.value)
    assert count_named >= 190


def typed_wrong(rng, key):
    i = rng.randrange(len(key) - 1)
    return rng.choice(
        [
            key[:i] + key[i + 1 :],
            key[:i] + key[i] + key[i:],
            key[:i] + key[i + 1] + key[i] + key[i + 2 :] if key[i] != key[i + 1] else key + "x",
            key[:i] + rng.choice(string.ascii_lowercase) + key[i + 1 :] if key[i] != "_" else key + "s",
        ]
    )


def test_the_keys_of_an_older_file_are_read_and_saved_with_their_present_names(tmp_path):
    path = tmp_path / "old.toml"
    old_lines = (
        '[controller]\nkind = "stanley"\nk = 2.0\nsoft_m_s = 0.1\nsteepest_rad = 0.5\n'
        "[sensors.beacon]\npoint_m = [1.0, 0.0]\nabove_m = 0.2\nfarthest_m = 4.0\nmeasurement_noise_cov = [[0.01]]\n"
        '[provenance."sensors.beacon.above_m"]\nrun = "tape"\nstd = 0.01\n'
    )
    path.write_text(SMALL.partition("[controller]")[0] + old_lines)
    robot = load(path)
    assert robot.value("controller.max_steering_rad") == 0.5
    assert robot.sensors.beacon.max_range_m == 4.0
    assert robot.provenance["sensors.beacon.height_m"].std == 0.01
    robot.with_values({"sensors.beacon.height_m": 0.3}).save(path)
    assert (load(path).value("sensors.beacon.height_m"), "above_m" in path.read_text()) == (0.3, False)
