"""Wrong units at import: each is reported with a remedy, at 10 Hz and at 50 Hz; a sound recording gives no warning."""

import re
from typing import Any

import numpy as np
import pytest

from baqueano.diagnostics import Diagnostic, merge_diagnostics
from baqueano.errors import FileError
from baqueano.runs.importing import import_run
from tests.codes import includes

DEGREES, GRAVITY = 180.0 / np.pi, 9.80665
PULSES = "scale = 0.002, offset = -3.0"


def car(rate: float, seconds: float = 30.0) -> dict[str, np.ndarray]:
    """Return a car that rests for two seconds and then drives curves: throttle, servo, a_x, a_y [m/s²], ω [rad/s],
    v."""
    rng = np.random.default_rng(5)
    t = np.arange(round(seconds * rate)) / rate
    drives = t >= 2.0
    v = np.where(drives, 1.2 + 0.6 * np.sin(1.3 * t), 0.0)
    rate_rad_s = np.where(drives, 1.5 * np.sin(0.7 * t), 0.0)
    a_x = np.where(drives, 0.6 * 1.3 * np.cos(1.3 * t), 0.0) + 0.03 * rng.standard_normal(len(t))
    a_y = v * rate_rad_s + 0.03 * rng.standard_normal(len(t))
    gyro = rate_rad_s + 0.005 * rng.standard_normal(len(t))
    throttle = np.where(drives, 0.4 + 0.2 * np.sin(1.3 * t), 0.0)
    servo = np.where(drives, 0.9 * np.sin(0.7 * t), 0.0)
    return {"t": t, "throttle": throttle, "servo": servo, "ax": a_x, "ay": a_y, "gz": gyro, "v": v}


def import_message(
    tmp_path, hz: float = 10.0, odometer: bool = False, change: dict[str, Any] | None = None, **units: str
):
    columns = car(hz)
    for name, convert in (change or {}).items():
        columns[name] = convert(columns[name])
    rows = np.column_stack(list(columns.values()))
    lines = [",".join(columns), *(",".join(f"{x:.10g}" for x in row) for row in rows)]
    (tmp_path / "log.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    texts = {"time": "s", "duty": "1", "scale": "1.0", "acceleration": "m/s^2", "rate": "rad/s"} | units
    duty = f'unit = "{texts["duty"]}", scale = {texts["scale"]}'
    speed = '[sensors.odometer]\nz = [ { column = "v", unit = "m/s" } ]\n' if odometer else ""
    (tmp_path / "map.toml").write_text(
        f"""format = 1
[files.log]
path = "log.csv"
time = "t"
time_unit = "{texts["time"]}"
[command]
names = ["throttle", "servo"]
in_force = "from"
u = [ {{ column = "throttle", {duty} }}, {{ column = "servo", {duty} }} ]
[sensors.imu]
z = [ {{ column = "ax", unit = "{texts["acceleration"]}" }}, {{ column = "ay", unit = "{texts["acceleration"]}" }},
      {{ column = "gz", unit = "{texts["rate"]}" }} ]
{speed}""",
        encoding="utf-8",
    )
    try:
        return import_run(tmp_path / "map.toml").table()
    except FileError as error:
        return f"refused: {error}"


def findings(tmp_path, *args: Any, **options: Any) -> Diagnostic:
    """Return the findings of an import of this recording as one diagnostic, or its refusal."""
    import_message(tmp_path, *args, **options)
    try:
        return merge_diagnostics(finding.diagnostic for finding in import_run(tmp_path / "map.toml").findings)
    except FileError as error:
        return error.diagnostic


@pytest.mark.parametrize("rate", [10.0, 50.0])
@pytest.mark.parametrize("odometer", [True, False])
def test_a_sound_recording_of_a_car_gives_no_unit_warning(tmp_path, rate, odometer):
    assert "warning" not in import_message(tmp_path, rate, odometer)
    assert "write" not in import_message(tmp_path, rate, odometer)


SCALED = {
    "accelerometer in g": ({"ax": lambda x: x / GRAVITY, "ay": lambda x: x / GRAVITY}, {}, 'unit = "g"'),
    "accelerometer is SI": ({}, {"acceleration": "g"}, 'unit = "m/s^2"'),
    "gyro in deg/s": ({"gz": lambda x: x * DEGREES}, {}, 'unit = "deg/s"'),
    "gyro is SI": ({}, {"rate": "deg/s"}, 'unit = "rad/s"'),
}


@pytest.mark.parametrize("rate", [10.0, 50.0])
@pytest.mark.parametrize("mistake", SCALED)
def test_a_sensor_in_a_wrong_unit_is_recognised_from_the_speed(tmp_path, mistake, rate):
    change, units, line = SCALED[mistake]
    assert line in import_message(tmp_path, rate, True, change, **units)


@pytest.mark.parametrize("rate", [10.0, 50.0])
@pytest.mark.parametrize("mistake", ["accelerometer in g", "gyro in deg/s", "gyro is SI"])
def test_a_wrong_unit_is_reported_without_a_speed_sensor(tmp_path, mistake, rate):
    change, units, line = SCALED[mistake]
    assert line in import_message(tmp_path, rate, False, change, **units)


def test_a_slow_gyro_in_degrees_is_reported(tmp_path):
    slow = findings(tmp_path, 10.0, False, {"gz": lambda x: 0.1 * x * DEGREES + 1.5})
    assert includes(slow, "recording.gyro-at-rest", key="sensors.imu.z[2]")
    assert includes(slow, "recording.unit-entry", unit_name="deg/s")
    spins = findings(tmp_path, 10.0, False, {"gz": lambda x: np.where(np.abs(x) > 0.1, 10.0 * x, x)})
    assert includes(spins, "recording.fast-turns", turns=pytest.approx(2.4, abs=0.05))


@pytest.mark.parametrize("rate", [10.0, 50.0])
@pytest.mark.parametrize(("factor", "time_unit"), [(1e3, "ms"), (1e6, "us")])
def test_milliseconds_and_microseconds_for_seconds_are_reported(tmp_path, rate, factor, time_unit):
    assert f'time_unit = "{time_unit}"' in import_message(tmp_path, rate, change={"t": lambda t: factor * t})


@pytest.mark.parametrize("rate", [10.0, 50.0])
@pytest.mark.parametrize(
    ("factor", "time_unit", "truth"), [(1.0, "ms", "s"), (1e3, "us", "ms"), (1e6, "ms", "us")]
)
def test_id2_every_wrong_unit_of_time_is_reported(tmp_path, rate, factor, time_unit, truth):
    message = import_message(tmp_path, rate, change={"t": lambda t: factor * t}, time=time_unit)
    assert f'time_unit = "{truth}"' in message


@pytest.mark.parametrize("rate", [1.0, 0.5])
def test_the_time_unit_of_a_slow_log_is_recognised_from_its_duration(tmp_path, rate):
    """In µs thirty rows would last 30 ms, and no recording of a vehicle is that short."""
    assert 'time_unit = "ms"' in import_message(tmp_path, rate, change={"t": lambda t: 1e3 * t})


def test_milliseconds_of_a_1000_hz_log_given_as_seconds_are_reported(tmp_path):
    reasons = findings(tmp_path, 1000.0, change={"t": lambda t: np.round(1e3 * t)})
    assert includes(reasons, "recording.tick-lasts", tick_s=pytest.approx(1.0), unit_name="s")
    assert includes(reasons, "recording.write-time-unit", unit_name="ms")


@pytest.mark.parametrize(
    ("convert", "unit", "line"),
    [
        (lambda u: 100.0 * u, "1", 'write unit = "%"'),
        (lambda u: np.round(255.0 * u), "1", "scale = 0.00392157, if a full command is 255"),
        (lambda u: np.round(200.0 * u), "1", "scale = 0.00392157, if a full command is 255"),
        (lambda u: np.round(900.0 * u), "1", "scale = 0.001, if a full command is 1000"),
        (lambda u: np.round(1500.0 + 500.0 * u), "1", PULSES),
        (lambda u: np.round(1500.0 + 500.0 * u), "us", f'unit = "raw", {PULSES}'),
        (lambda u: u, "%", 'write unit = "1"'),
    ],
)
def test_a_command_unit_is_recognised_from_the_largest_command(tmp_path, convert, unit, line):
    message = import_message(tmp_path, change={"throttle": convert, "servo": convert}, duty=unit)
    assert message.startswith("refused")
    assert line in message


@pytest.mark.parametrize("largest", [1.3, 2.9, 3.1, 4.0, 7.0, 8.0, 90.0])
@pytest.mark.parametrize("duty", ["1", "%"])
def test_the_proposed_remedy_for_a_command_unit_is_accepted(tmp_path, largest, duty):
    """This includes a set-point in m/s, whose full scale does not follow from its unit."""

    def commanded(result=import_message, **units):
        scales = {name: largest / np.max(np.abs(car(10.0)[name])) for name in ("throttle", "servo")}
        change = {"throttle": lambda u: 0.7 * scales["throttle"] * u, "servo": lambda u: scales["servo"] * u}
        return result(tmp_path, change=change, **units)

    message, reasons, physical = commanded(duty=duty), commanded(findings, duty=duty), largest < 3.0
    assert message.startswith("refused") == (duty == "1" or physical)
    assert includes(reasons, "recording.write-largest") == physical
    lines = re.findall(
        r'(?:write|or) (?=unit|scale)(?:unit = "(1|%)")?(?:, )?(?:scale = ([0-9.e-]+))?', message
    )
    assert bool(lines) == message.startswith("refused")
    for unit, scale in lines:
        after = commanded(duty=unit or duty, scale=scale or "1.0")
        assert not after.startswith("refused"), (unit, scale, after)


def test_a_throttle_fraction_given_as_percent_is_reported(tmp_path):
    reasons = findings(tmp_path, change={"servo": lambda u: 100.0 * u}, duty="%")
    assert includes(
        reasons, "recording.command-range", name="throttle", maximum=pytest.approx(0.006, rel=0.01)
    )
    assert includes(reasons, "recording.write", line='unit = "1"')


def test_a_remedy_for_several_entries_is_reported_once(tmp_path):
    message = import_message(tmp_path, change={"throttle": lambda u: 250.0 * u, "servo": lambda u: 250.0 * u})
    assert message.count("0.00392157") == 1
    assert "(throttle)" in message
    assert "(servo)" in message


def test_many_warnings_of_the_same_kind_are_printed_on_one_line(tmp_path):
    def with_gaps(t: np.ndarray) -> np.ndarray:
        return t + 0.3 * (np.arange(len(t)) // 20)

    message = import_message(tmp_path, change={"t": with_gaps})
    assert message.count("gap ") == 1
    assert "(and 13 more such)" in message
