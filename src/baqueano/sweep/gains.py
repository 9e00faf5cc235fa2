"""Find the vehicle file whose gains a controller of a sweep has.

A vehicle file can name a controller: "pd.toml" is the block of its table [controller], with the gains of this table. A
controller "ana/my.py:Mine" belongs to ana/vehicle.toml, if the table [controller] of that file names this class.
"""

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from baqueano.blocks import WORKING_FILE, resolve
from baqueano.contracts.blocks import OwnBlock
from baqueano.contracts.values import Tree
from baqueano.vehicle_file import VehicleFile, load, parse
from baqueano.vehicle_file.build import DEFAULT_KINDS
from baqueano.vehicle_file.text.toml_text import read_text, tables

CODE = "code"


class FileText(NamedTuple):
    """A vehicle file in the form that is sent to another process."""

    text: str
    label: str
    path: Path | None
    on_disk: str | None

    def parse(self) -> VehicleFile:
        """Parse the text and return the vehicle file."""
        return parse(self.text, self.label, self.path, on_disk=self.on_disk)


class ControllerGains(NamedTuple):
    """The controller of a drive, and the source of its gains: a file, CODE for the defaults of its class, or "" for
    the vehicle file of the drive.
    """

    controller: OwnBlock | None = None
    source: str = ""
    file: FileText | None = None


def find_gains(
    vehicle_file: VehicleFile, controller: OwnBlock | None, choice: str = "own"
) -> ControllerGains:
    """Return the controller that `controller` names, and its gains. The choice "vehicle" excludes the vehicle file in
    the folder of a class.

    Raise FileError for a vehicle file that cannot be read.
    """
    file_name, _colon, class_name = (
        controller.rpartition(":") if isinstance(controller, str) else ("", "", "")
    )
    if isinstance(controller, str) and controller.endswith(".toml"):
        owner, path = load(controller), Path(controller)
        kind = owner.data.get("controller", {}).get("kind", DEFAULT_KINDS["controller"])
        file = FileText(owner.text, path.as_posix(), path, owner.on_disk)
        return ControllerGains(_with_folder(kind, path), file.label, file)
    if not file_name.endswith(".py"):
        return ControllerGains(controller)
    path = _code_path(file_name, vehicle_file.folder)
    own_path = path.with_name(WORKING_FILE)
    is_of_drive = vehicle_file.path is not None and own_path.resolve() == vehicle_file.path.resolve()
    if choice == "own" and own_path.is_file() and not is_of_drive:
        text, label = read_text(own_path), _shown_path(own_path)
        table = tables(text, label).get("controller", {})
        own_file, _colon, own_class = str(table.get("kind", "")).rpartition(":")
        if own_class == class_name and _code_path(own_file, str(own_path.parent)).resolve() == path.resolve():
            kind = f"{_shown_path(path)}:{class_name}"
            return ControllerGains(kind, label, FileText(text, label, own_path, text))
    is_named = vehicle_file.kind("controller") is resolve("controller", str(controller), vehicle_file.folder)
    return ControllerGains(controller, vehicle_file.label if is_named else CODE)


def build_controller(vehicle_file: VehicleFile, gains: ControllerGains) -> Tree:
    """Return the controller of a drive. Raise FileError for a wrong or missing gain, with the file of the gains."""
    controller, _source, file = gains
    if file is None:
        return vehicle_file.controller(controller)
    table = {**tables(file.text, file.label).get("controller", {}), "kind": controller}
    owner = replace(
        vehicle_file, data=vehicle_file.data | {"controller": table},
        text=file.text, label=file.label, path=file.path,
    )  # fmt: skip
    return owner.controller(controller)


def _with_folder(kind: str, path: Path) -> str:
    """Return a kind of the vehicle file at `path`; the file of a class is relative to the working directory."""
    file_name, _colon, class_name = kind.rpartition(":")
    return f"{_code_path(file_name, str(path.parent)).as_posix()}:{class_name}" if file_name else kind


def _shown_path(path: Path) -> str:
    """Return a path for messages: relative to the working directory if it is there."""
    working_folder = Path.cwd()
    return (path.relative_to(working_folder) if path.is_relative_to(working_folder) else path).as_posix()


def _code_path(file_name: str, folder: str | None) -> Path:
    """Return the path of the code of a block: in `folder` if it is there, else in the working directory."""
    path = Path(file_name).expanduser()
    in_folder = Path(folder or ".") / path
    return in_folder if in_folder.is_file() else path
