"""Damaged inputs of every external format: each gives a baqueano error with its code, or a value.

CI and `make fuzz` judge 20,000 inputs per format (BAQUEANO_FUZZ=20000). Otherwise as many inputs are judged as
SHARE_S permits, and at least LEAST. The input of a number and a seed is always the same, and a finding prints the
command that repeats it. The public service sets another seed each day (BAQUEANO_FUZZ_SEED).
"""

import os
import socket
import time
from collections.abc import Iterator
from contextlib import suppress

import pytest
from hypothesis import given, settings, strategies as st

from baqueano.door.wire import decode
from baqueano.drive.mission import Mission
from baqueano.errors import BaqueanoError
from baqueano.runs import read_run
from baqueano.runs.maps.column_map import load_map
from baqueano.runs.route_file import read_route
from baqueano.vehicle_file import load, parse
from tests.fuzz.formats import FORMATS, SEED, draw
from tests.fuzz.judging import Outcome, judge

SHARE_S = 3.0  # for each of six formats
LEAST, MOST = 60, 20_000


def numbers() -> Iterator[int]:
    """Yield the numbers of the inputs that are judged."""
    numbers = os.environ.get("BAQUEANO_FUZZ", str(MOST) if os.environ.get("CI") else "")
    first, colon, last = numbers.partition(":")
    if numbers:
        yield from range(int(first) if colon else 0, int(last if colon else first))
        return
    end_s = time.monotonic() + SHARE_S
    yield from (k for k in range(MOST) if k < LEAST or time.monotonic() < end_s)


@pytest.mark.slow
@pytest.mark.parametrize("name", FORMATS)
def test_a_damaged_input_gives_a_baqueano_error_or_a_value(name, tmp_path, monkeypatch):
    if name == "door" and not hasattr(socket, "AF_UNIX"):
        pytest.skip("the door of a vehicle listens at a unix socket")
    monkeypatch.chdir(tmp_path)
    with FORMATS[name](tmp_path) as read_mutant:
        outcome = judge(read_mutant, numbers())
    print(f"{name}: {outcome.table}")
    assert not outcome.findings, f"{name}: {outcome.table}\n{repeat_line(name, outcome)}"


def repeat_line(name, outcome):
    """Return the command lines that judge only the first input of each finding."""
    test = f"pytest tests/fuzz/test_fuzz.py -k 'damaged and {name}'"
    return "\n".join(
        f"BAQUEANO_FUZZ_SEED={SEED} BAQUEANO_FUZZ={places[0]}:{places[0] + 1} {test}"
        for places in outcome.findings.values()
    )


def test_a_fuzz_finding_is_repeated_by_the_printed_command(monkeypatch):
    outcome = Outcome(findings={"hang": [17, 30]})
    (line,) = repeat_line("csv", outcome).splitlines()
    assert f"BAQUEANO_FUZZ_SEED={SEED} BAQUEANO_FUZZ=17:18 pytest" in line
    monkeypatch.setenv("BAQUEANO_FUZZ", "17:18")
    assert list(numbers()) == [17]
    assert draw("csv", 17).random() == draw("csv", 17).random() != draw("csv", 18).random()


def ours_or_a_value(reader, *inputs):
    with suppress(BaqueanoError):
        reader(*inputs)


@settings(max_examples=40, derandomize=True)
@given(noise=st.binary(max_size=200))
def test_random_bytes_give_a_baqueano_error_or_a_value(noise, tmp_path_factory):
    folder = tmp_path_factory.getbasetemp()
    for name, reader in (("x.mcap", read_run), ("x.toml", load), ("m.toml", load_map), ("x.csv", read_route)):
        for data in (noise, b"\x89MCAP0\r\n" + noise):
            (folder / name).write_bytes(data)
            ours_or_a_value(reader, folder / name)
    assert decode(noise) is None


@settings(max_examples=40, derandomize=True)
@given(
    text=st.text(max_size=100),
    value=st.recursive(st.none() | st.floats() | st.text(), st.lists, max_leaves=5),
)
def test_arbitrary_texts_and_values_give_a_baqueano_error_or_a_value(text, value):
    ours_or_a_value(parse, text, "x.toml")
    ours_or_a_value(parse, f"format = 1\nname = {value!r}\nrate_hz = {value!r}\n", "x.toml")
    ours_or_a_value(Mission.from_json, text)
