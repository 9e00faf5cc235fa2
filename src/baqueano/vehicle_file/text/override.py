"""Override values of a vehicle file by settings of the command line, such as `--set model.mass_kg=0.7`."""

import tomllib
from collections.abc import Iterable

from baqueano.blocks import read_module
from baqueano.contracts.values import JsonObject
from baqueano.errors import FileError, UsageError
from baqueano.vehicle_file.file import VehicleFile, parse
from baqueano.vehicle_file.text.edit import text_with_values


def override(vehicle_file: VehicleFile, settings: Iterable[str]) -> VehicleFile:
    """Return the file with values from the command line, which override the values of the file.

    Parameters
    ----------
    vehicle_file : VehicleFile
        The file.
    settings : iterable of str
        Settings such as "model.mass_kg=0.7".

    Returns
    -------
    VehicleFile
        The new file, completely checked.

    Raises
    ------
    UsageError
        For a text other than key=value, or a value that is not allowed.

    Examples
    --------
    >>> from baqueano.vehicle_file import load
    >>> heavy = override(load("small"), ["model.mass_kg=0.7"])
    >>> heavy.layers, heavy.vehicle.mass_kg
    (('garage: small', '--set model.mass_kg=0.7'), 0.7)
    """
    settings, changed_file = [*settings], vehicle_file
    try:
        for setting in settings:
            changed_file = _with_settings(changed_file, [setting])
        return changed_file
    except UsageError:
        if len(settings) < 2:
            raise
    return _with_settings(vehicle_file, settings)  # each value might be valid only with the others


def _with_settings(vehicle_file: VehicleFile, settings: list[str]) -> VehicleFile:
    """Return the file with the values of all settings, checked together. Raise UsageError as `override`."""
    values: JsonObject = {}
    for setting in settings:
        key, equals, value_text = setting.partition("=")
        if not equals or not value_text.strip():
            raise UsageError.of("vehicle.setting", setting=setting)
        try:
            value = tomllib.loads(f"x = {value_text}")["x"]
        except tomllib.TOMLDecodeError:
            value = value_text.strip()  # a word needs no quotes on the command line
        values.pop(key.strip(), None)  # a later setting replaces an earlier one
        values[key.strip()] = value
    try:
        for value in values.values():
            if isinstance(value, str) and ".py:" in value:  # the user names it here, not the file
                read_module(value.rpartition(":")[0], vehicle_file.folder)
        text = text_with_values(vehicle_file, values)
        layers = (*vehicle_file.layers, *(f"--set {setting}" for setting in settings))
        return parse(text, vehicle_file.label, vehicle_file.path, layers, vehicle_file.on_disk)
    except FileError as error:
        joined_settings = " --set ".join(settings)
        raise UsageError.of("vehicle.set", setting=joined_settings, cause=error.diagnostic) from error
