"""`baqueano robot settings`: the command line on the real firmware behind a pty, here and at a host."""

import json
import socket
import sys
import threading
import time

import pytest

from baqueano import vehicle_file
from baqueano.cli import main
from baqueano.cli.robot.settings import NAMES as OPTIONS, WHEEL_SETTINGS as OF_WAYS
from baqueano.door import remote
from baqueano.robot.uno import settings as uno_settings
from baqueano.robot.uno.frames import DriveFlag, Driver, EncoderKind, Settings, WheelCurve, Wiring
from baqueano.robot.uno.settings import StoredSettings, apply_changes
from baqueano.robot.workshop import exclusive_hardware


@pytest.fixture
def verb(live, capsys):
    """Return `verb("--bridge", "tb6612")`, which gives exit code, stdout and stderr."""

    def run_verb(*words, host=("--vehicle", "small", "--set")):
        options = [*host, f"robot.port={live.path}"] if "--set" in host else list(host)
        with pytest.raises(SystemExit) as exit_info:
            main(["robot", "settings", *options, *words])
        out, err = capsys.readouterr()
        return exit_info.value.code, out, err

    return run_verb


def in_eeprom(live):
    """Return the settings of the Uno after it was switched off and on."""
    with live.lock:
        live.uno.power_cycle()
        live.uno.run(0.02)
        live.uno.frames()
    with exclusive_hardware.open_uno(live.path) as uno:
        return uno.settings()


def test_the_default_settings_of_an_uno_are_printed(verb):
    code, out, _ = verb()
    assert code == 0
    assert "bridge          l298n\nencoders        none\n" in out
    assert "mark            high over the tape\nbattery-ratio   3 V at the battery for 1 V at A0\n" in out
    assert "left-backwards      0.000  1.000  0.000\n" in out
    assert out.endswith("DEFAULT: initial value of the firmware\n")


def test_new_settings_are_verified_and_survive_a_power_cut(verb, live):
    code, out, _ = verb(
        "--bridge", "TB6612", "--encoders", "quadrature", "--mark", "low", "--right-motor", "reversed",
        "--encoder-plugs", "swapped", "--battery-ratio", "3.127", "--dead-zone", "all=0.11", "--dead-zone",
        "right-backwards=0.14", "--slope", "left-forwards=0.9", "--kick", "all=0.5", "--kick-ms", "20",
        "--dither", "0.03", "--dither-ms", "7",
    )  # fmt: skip
    assert code == 0
    assert "right-backwards     0.140  1.000  0.500\nSET: stored in the Uno" in out
    settings = Settings(
        Wiring.RIGHT_MOTOR_REVERSED | Wiring.ENCODERS_SWAPPED | Wiring.MARK_ACTIVE_LOW, Driver.TB6612,
        EncoderKind.QUADRATURE, 20, 30, 7, 3127,
        (WheelCurve(110, 900, 500), WheelCurve(110, 1000, 500), WheelCurve(110, 1000, 500),
        WheelCurve(140, 1000, 500)),
    )  # fmt: skip
    assert in_eeprom(live) == settings
    code, out, _ = verb("--mark", "high", "--json")
    assert StoredSettings.from_rows(json.loads(out)["rows"]).settings == settings._replace(
        wiring=settings.wiring & ~64
    )
    assert json.loads(out)["rows"][0]["mark"] == "high"
    assert verb("--defaults", "--bridge", "l293d")[0] == 0
    assert in_eeprom(live) == Settings(driver=Driver.L293D)


def test_the_watch_option_reports_a_turned_wheel_and_a_passed_mark(verb, live):
    assert verb("--encoders", "quadrature")[0] == 0

    def by_hand():
        time.sleep(0.5)
        with live.lock:
            live.uno.encoder(0, 12, live.uno.t_s, live.uno.t_s + 0.05)
            live.uno.set_mark(True, live.uno.t_s + 0.05)
        time.sleep(0.5)

    hand = threading.Thread(target=by_hand)
    hand.start()
    code, out, err = verb("--watch", "3")
    hand.join()
    assert code == 0
    assert "V, counts left 12, right 0, marks 1\n" in err
    assert out.startswith("bridge ")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--bridge", "drv8833"), "--bridge drv8833: expected one of l298n, tb6612, l293d."),
        (("--mark", "1"), "--mark 1: expected one of high, low."),
        (("--battery-ratio", "11.5"), "--battery-ratio 11.5: expected a number from 1 to 11."),
        (("--dither", "-0.01"), "--dither -0.01: expected a number from 0 to 0.25."),
        (("--kick-ms", ""), "--kick-ms : expected a number from 0 to 100."),
        (("--slope", "all=nan"), "--slope all=nan: expected a number from 0.1 to 3."),
        (("--dead-zone", "left-forwards=11"), "--dead-zone left-forwards=11: expected a number from 0 to 0.7."),
        (("--dead-zone", "0.1"), "--dead-zone 0.1: expected a wheel and direction with a number, such as left-forw"),
        (("--kick", "left=0.1"), "--kick left=0.1: expected a wheel and direction with a number"),
    ],
)  # fmt: skip
def test_an_invalid_setting_is_refused_before_the_line_opens(verb, live, words, message):
    code, out, err = verb(*words, host=("nobody@nowhere",))
    assert (code, out) == (2, "")
    assert message in err
    assert verb(*words)[0] == 2
    assert in_eeprom(live) == Settings()


def test_settings_are_not_stored_while_a_motor_runs(verb, live):
    """Opening the line does not reset this Uno, as with GPIO wiring; another program commands it."""
    stop = threading.Event()

    def somebody_else():
        while not stop.wait(0.03):
            with live.lock:
                for flags, duty in ((DriveFlag.ARM, 0), (DriveFlag.ARM, 400)):
                    live.uno.drive(duty, duty, flags)

    thread = threading.Thread(target=somebody_else)
    thread.start()
    try:
        code, _, err = verb("--bridge", "tb6612")
    finally:
        stop.set()
        thread.join()
    assert code == 1
    assert "A motor runs (left +" in err
    assert "expected both at rest. Nothing was stored." in err
    assert in_eeprom(live) == Settings()


@pytest.mark.parametrize("state", ["MISSION", "MANUAL", "READY"])
def test_a_driving_service_is_not_stopped_for_settings(verb, tmp_path, monkeypatch, state):
    """A real socket replaces the socket of the service, and a fake systemctl reports that the service runs."""
    calls = tmp_path / "calls"
    for name, text in {"systemctl": "exit 0", "sudo": 'shift; exec "$@"'}.items():
        (tmp_path / name).write_text(f'#!/bin/sh\necho "{name} $*" >>{calls}\n{text}\n')
        (tmp_path / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin")
    monkeypatch.setattr(remote, "SOCKET", tmp_path / "door")
    with socket.socket(socket.AF_UNIX) as door:
        door.bind(str(tmp_path / "door"))
        door.listen()

        def answers():
            line, _ = door.accept()
            with line:
                line.sendall(json.dumps({"type": "state", "state": state, "reason": ""}).encode() + b"\n")
                line.recv(1)

        service = threading.Thread(target=answers, daemon=True)
        service.start()
        code, _, err = verb("--bridge", "tb6612")
        service.join()
    if state == "READY":
        assert code == 0
        assert "systemctl stop baqueano.service" in calls.read_text()
    else:
        assert code == 1
        assert (
            f"The vehicle is driving ({state}), and this command needs exclusive use of the hardware." in err
        )
        assert "stop" not in calls.read_text()


def test_settings_at_a_host_run_there_and_are_printed_locally(verb, live, tmp_path, monkeypatch):
    """A shell replaces ssh and starts the real command line."""
    vehicle_toml = tmp_path / "vehicle.toml"
    vehicle_file.override(vehicle_file.load("small"), [f"robot.port={live.path}"]).save(vehicle_toml)
    monkeypatch.setattr("baqueano.robot.workshop.exclusive_hardware.VEHICLE", str(vehicle_toml))
    scripts = {
        "ssh": 'for last; do :; done; exec sh -c "$last"',
        "baqueano": f'echo "$*" >>{tmp_path}/calls; exec {sys.executable} -m baqueano "$@"',
    }
    for name, text in scripts.items():
        (tmp_path / name).write_text(f"#!/bin/sh\n{text}\n")
        (tmp_path / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin")
    code, out, _ = verb(
        "--bridge", "tb6612", "--slope", "all=0.9", "--slope", "left-forwards=0.85", "--defaults", host=("r1",)
    )  # fmt: skip
    assert code == 0
    assert (
        "--bridge=tb6612 --slope=all=0.9 --slope=left-forwards=0.85 --defaults --vehicle"
        in (tmp_path / "calls").read_text()
    )
    assert "left-forwards       0.000  0.850  0.000\nleft-backwards      0.000  0.900" in out
    assert in_eeprom(live).driver == Driver.TB6612


def test_option_names_match_the_settings_of_the_firmware():
    assert list(OPTIONS) == [
        *uno_settings.NAMED_OPTIONS,
        *uno_settings.PLUG_FLAGS,
        *uno_settings.NUMBER_OPTIONS,
    ]
    assert list(OF_WAYS) == list(uno_settings.CURVE_OPTIONS)
    for name, (_, members) in uno_settings.NAMED_OPTIONS.items():
        assert OPTIONS[name][0] == "|".join(member.name.lower() for member in members)
    for name, (_, words) in uno_settings.PLUG_FLAGS.items():
        assert OPTIONS[name][0] == "|".join(words)


def test_settings_rows_contain_all_stored_settings():
    data = apply_changes(
        Settings(),
        {name: [words[1]] for name, (_, words) in uno_settings.PLUG_FLAGS.items()}
        | {"encoders": ["single"], "battery-ratio": ["4.001"], "dither-ms": ["50"], "kick": ["all=0.333"]},
    )
    assert data.wiring == 127
    assert StoredSettings.from_rows(json.loads(json.dumps(StoredSettings(data).rows()))).settings == data
