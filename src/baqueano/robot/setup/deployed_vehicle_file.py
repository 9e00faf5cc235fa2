"""Make the vehicle file of a robot: the laptop's file with the results of `calibrate imu` on that robot.

key calibrated on the robot, other value here   the robot's value, unless it was calibrated here on a later day
every other key                                 the laptop's value
"""

import json
from datetime import date
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from baqueano.diagnostics import fault
from baqueano.door.ssh import run_command, ssh_command, ssh_line
from baqueano.errors import FileError, RobotUnreachable, UsageError
from baqueano.messages.language import translate as _
from baqueano.robot import VEHICLE
from baqueano.vehicle_file.paths import key_exists
from baqueano.vehicle_file.text.toml_text import parse_toml

if TYPE_CHECKING:
    from baqueano.contracts.values import JsonObject
    from baqueano.vehicle_file.file import VehicleFile

NON_VALUE_PREFIXES = ("provenance.", "parameter_cov.", "envelope.")  # keys that describe other keys
CALIBRATION_RUN = "calibrate imu"  # the `run` in the provenance of calibrated values
MAX_SHOWN_LETTERS = 60  # maximum number of characters of a value that are shown


class RenewedFile(NamedTuple):
    """A new vehicle file for a robot: its text, the robot's present file, and the changes as lines of text."""

    text: str
    base: bytes  # the robot's present file; empty if it does not exist
    lines: list[str]  # the changes, key by key


def renew_file(host: str, vehicle_file: "VehicleFile", root: str = "/") -> RenewedFile:
    """Return the new file for HOST, made from the laptop's `vehicle_file` and the calibration at HOST.

    Raise RobotUnreachable if the robot's present file cannot be read. Raise UsageError if that file contains a
    calibration of a key that `vehicle_file` lacks.
    """
    path = f"{root.rstrip('/')}{VEHICLE}"
    content, code = run_command(ssh_command(host, f"test ! -e {path} || cat {path}"))
    if code:
        raise RobotUnreachable(fault("setup.file-not-read", ssh_line(host), host=host, path=path))
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


def differences(former_data: "JsonObject", new_data: "JsonObject") -> list[str]:
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
    host: str, vehicle_file: "VehicleFile", robot_data: "JsonObject"
) -> tuple["VehicleFile", list[str]]:
    provenance, leaves = robot_data.get("provenance"), _flat_values(robot_data)
    values: JsonObject = {}
    origins: JsonObject = {}
    lines: list[str] = []
    for key, origin in provenance.items() if isinstance(provenance, dict) else ():
        if not isinstance(origin, dict) or origin.get("run") != CALIBRATION_RUN or key not in leaves:
            continue
        if not isinstance(origin.get("date"), date):
            origin = {name: value for name, value in origin.items() if name != "date"}
        if not key_exists(vehicle_file.data, key, vehicle_file.folder):
            raise UsageError(
                fault(
                    "setup.no-place-for-calibration",
                    host=host,
                    key=key,
                    value=_short_text(leaves[key]),
                    path=VEHICLE,
                    ssh=ssh_line(host),
                )
            )
        file_value, own_provenance = vehicle_file.value(key), vehicle_file.provenance.get(key)
        if np.array_equal(np.asarray(file_value), np.asarray(leaves[key])):
            origins |= {} if own_provenance is not None else {key: origin}
            continue
        calibration_date = origin.get("date")
        is_newer = (
            own_provenance is not None
            and own_provenance.run == CALIBRATION_RUN
            and _day(own_provenance.date) > _day(calibration_date)
        )
        if not is_newer:
            values[key], origins[key] = leaves[key], origin
            lines.append(
                _(
                    "{key}: {value} is kept, because it was calibrated there on {when}",
                    key=key,
                    value=_short_text(leaves[key]),
                    when=calibration_date,
                )
                if calibration_date
                else _(
                    "{key}: {value} is kept, because it was calibrated there",
                    key=key,
                    value=_short_text(leaves[key]),
                )
            )
    if lines:
        lines.append(
            _(
                "To write it into your file too: baqueano robot calibrate imu {host} --update. To use your "
                "own values: {ssh} rm {file}, and type this line again",
                host=host,
                ssh=ssh_line(host),
                file=VEHICLE,
            )
        )
    return vehicle_file.with_values(values, origins) if origins else vehicle_file, lines


def _day(value: object) -> date:
    """Return the day of a date or a time in TOML; the first day of all for an unknown date."""
    return date(value.year, value.month, value.day) if isinstance(value, date) else date.min


def _value_text(leaves: "JsonObject", key: str) -> str:
    return _short_text(leaves[key]) if key in leaves else _("not there")


def _flat_values(table: "JsonObject", path: str = "") -> "JsonObject":
    leaves: JsonObject = {}
    for name, value in table.items():
        key = f"{path}{name}"
        leaves |= _flat_values(value, f"{key}.") if isinstance(value, dict) else {key: value}
    return leaves


def _short_text(value: object) -> str:
    text = json.dumps(value, default=str, ensure_ascii=False)
    return text if len(text) <= MAX_SHOWN_LETTERS else f"{text[: MAX_SHOWN_LETTERS - 1]}…"
