"""Make the vehicle file of a robot: the laptop's file with the results of `calibrate imu` on that robot.

key calibrated on the robot, other value here   the robot's value, unless it was calibrated here on a later day
every other key                                 the laptop's value
"""

import json
from datetime import date
from typing import NamedTuple

import numpy as np

from baqueano.contracts.values import JsonObject
from baqueano.door.ssh import run_command, ssh_command, ssh_line
from baqueano.errors import FileError, RobotUnreachable, UsageError
from baqueano.messages.language import translate as _
from baqueano.robot import VEHICLE
from baqueano.vehicle_file.file import VehicleFile
from baqueano.vehicle_file.paths import key_exists
from baqueano.vehicle_file.text.toml_text import parse_toml

NON_VALUE_PREFIXES = ("provenance.", "parameter_cov.", "envelope.")  # keys that describe other keys
CALIBRATION_RUN = "calibrate imu"  # the `run` in the provenance of calibrated values
MAX_SHOWN_LETTERS = 60  # maximum number of characters of a value that are shown


class RenewedFile(NamedTuple):
    """A new vehicle file for a robot: its text, the robot's present file, and the changes as lines of text."""

    text: str
    base: bytes  # the robot's present file; empty if it does not exist
    lines: list[str]  # the changes, key by key


def renew_file(host: str, vehicle_file: VehicleFile, root: str = "/") -> RenewedFile:
    """Return the new file for HOST, made from the laptop's `vehicle_file` and the calibration at HOST.

    Raise RobotUnreachable if the robot's present file cannot be read. Raise UsageError if that file contains a
    calibration of a key that `vehicle_file` lacks.
    """
    path = f"{root.rstrip('/')}{VEHICLE}"
    content, code = run_command(ssh_command(host, f"test ! -e {path} || cat {path}"))
    if code:
        raise RobotUnreachable.of("setup.file-not-read", ssh_line(host), host=host, path=path)
    if not content:
        return RenewedFile(vehicle_file.text, b"", [])
    try:
        robot_data = parse_toml(content.decode("utf-8"), f"{host}:{path}")
    except (ValueError, FileError) as error:  # neither TOML nor UTF-8, or nested too deeply
        line = _("the vehicle file there is not valid TOML ({error}): your file replaces it", error=error)
        return RenewedFile(vehicle_file.text, content, [line])
    vehicle_file, calibration_lines = _with_calibration(host, vehicle_file, robot_data)
    return RenewedFile(
        vehicle_file.text,
        content,
        [*differences(robot_data, parse_toml(vehicle_file.text, vehicle_file.label)), *calibration_lines],
    )


def differences(former_data: JsonObject, new_data: JsonObject) -> list[str]:
    """Return a line of text for each key whose value changes; the provenance of values is ignored.

    >>> differences({"robot": {"port": "auto"}}, {"robot": {"port": "/dev/serial0", "telemetry_hz": 50}})
    ['robot.port: "auto" → "/dev/serial0"', 'robot.telemetry_hz: not there → 50']
    """
    old_leaves, new_leaves = _flat_values(former_data), _flat_values(new_data)
    keys = [k for k in dict.fromkeys((*old_leaves, *new_leaves)) if not k.startswith(NON_VALUE_PREFIXES)]
    return [
        f"{key}: {_value_text(old_leaves, key)} → {_value_text(new_leaves, key)}"
        for key in keys
        if old_leaves.get(key) != new_leaves.get(key)
    ]


def _with_calibration(
    host: str, vehicle_file: VehicleFile, robot_data: JsonObject
) -> tuple[VehicleFile, list[str]]:
    """Return the file with each calibration of the robot that it does not replace by a newer one, and lines of text."""
    leaves = _flat_values(robot_data)
    values: JsonObject = {}
    origins: JsonObject = {}
    lines: list[str] = []
    for key, origin in _calibrations(robot_data).items():
        if key not in leaves:
            continue
        value_text = _short_text(leaves[key])
        if not key_exists(vehicle_file.data, key, vehicle_file.folder):
            figures = {"host": host, "key": key, "value": value_text, "path": VEHICLE, "ssh": ssh_line(host)}
            raise UsageError.of("setup.no-place-for-calibration", **figures)
        own_origin, day = vehicle_file.provenance.get(key), origin.get("date")
        if np.array_equal(np.asarray(vehicle_file.value(key)), np.asarray(leaves[key])):
            origins |= {} if own_origin is not None else {key: origin}
        elif own_origin is None or own_origin.run != CALIBRATION_RUN or _date(own_origin.date) <= _date(day):
            values[key], origins[key] = leaves[key], origin
            lines.append(
                _("{key}: {value} is kept, because it was calibrated there on {when}",
                  key=key, value=value_text, when=day)
                if day
                else _("{key}: {value} is kept, because it was calibrated there", key=key, value=value_text)
            )  # fmt: skip
    if lines:
        advice = _(
            "To write it into your file too: baqueano robot calibrate imu {host} --update. To use your "
            "own values: {ssh} rm {file}, and type this line again",
            host=host, ssh=ssh_line(host), file=VEHICLE,
        )  # fmt: skip
        lines.append(advice)
    return vehicle_file.with_values(values, origins) if origins else vehicle_file, lines


def _calibrations(robot_data: JsonObject) -> dict[str, JsonObject]:
    """Return the provenance of each calibrated key of the robot's file, without a date that is not a date."""
    provenance = robot_data.get("provenance")
    return {
        key: {k: v for k, v in origin.items() if k != "date" or isinstance(v, date)}
        for key, origin in (provenance.items() if isinstance(provenance, dict) else ())
        if isinstance(origin, dict) and origin.get("run") == CALIBRATION_RUN
    }


def _date(value: object) -> date:
    """Return the day of a date or a time in TOML; the first day of all for an unknown date."""
    return date(value.year, value.month, value.day) if isinstance(value, date) else date.min


def _value_text(leaves: JsonObject, key: str) -> str:
    return _short_text(leaves[key]) if key in leaves else _("not there")


def _flat_values(table: JsonObject, path: str = "") -> JsonObject:
    leaves: JsonObject = {}
    for name, value in table.items():
        key = f"{path}{name}"
        leaves |= _flat_values(value, f"{key}.") if isinstance(value, dict) else {key: value}
    return leaves


def _short_text(value: object) -> str:
    text = json.dumps(value, default=str, ensure_ascii=False)
    return text if len(text) <= MAX_SHOWN_LETTERS else f"{text[: MAX_SHOWN_LETTERS - 1]}…"
