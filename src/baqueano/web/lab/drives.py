"""Identify drives in the worker: the current drive from its rows, and finished runs."""

from pathlib import Path
from typing import TYPE_CHECKING

from baqueano.contracts.values import JsonObject

if TYPE_CHECKING:
    from baqueano.vehicle_file.file import VehicleFile
    from baqueano.web.lab.identification import DriveIdentification

MAX_ANSWERS = 8  # stored answers about runs


class DriveIdentifications:
    """The identification of the current drive, and the stored answers about finished runs."""

    def __init__(self) -> None:
        self._vehicle: tuple[str, int] | None = None
        self._number = 0
        self._drive: DriveIdentification | None = None
        self._answers: dict[tuple[str, int], JsonObject] = {}

    def answer(self, request: JsonObject) -> tuple[JsonObject, bytes]:
        """Add rows to the drive with the number `drive`, and return the state of its identification and b""."""
        from baqueano.web.lab.identification import DriveIdentification

        is_new_drive = request["drive"] != self._number
        if self._drive is None or (is_new_drive and _version_key(request["vehicle"]) != self._vehicle):
            if self._drive is not None:
                self._drive.close()
            self._vehicle = _version_key(request["vehicle"])
            self._drive = DriveIdentification(_vehicle_file(request["vehicle"]))
            self._drive.compile_kernels()
        elif is_new_drive:
            self._drive.restart()
        self._number = request["drive"]
        if request["rows"]:
            self._drive.add_rows(request["names"], request["rows"])
        return self._drive.state(), b""

    def answer_run(self, request: JsonObject) -> tuple[JsonObject, bytes]:
        """Return the identification of a run and b""."""
        from baqueano.drive.replay import recorded_vehicle_file
        from baqueano.runs import read_run
        from baqueano.web.lab.identification import DriveIdentification
        from baqueano.web.lab.recorded import pack_run

        path = Path(request["path"])
        key = str(path), path.stat().st_mtime_ns
        if key not in self._answers:
            run = read_run(path)
            packed_run, drive = pack_run(run), DriveIdentification(recorded_vehicle_file(run))
            drive.add_rows([field["name"] for field in packed_run.fields], packed_run.columns.tolist())
            self._answers[key] = drive.run_state(run)
            drive.close()
            while len(self._answers) > MAX_ANSWERS:
                del self._answers[next(iter(self._answers))]
        return self._answers[key], b""


def _version_key(source: str) -> tuple[str, int]:
    """Return a key that changes if the file of a vehicle changes."""
    path = Path(source)
    return source, path.stat().st_mtime_ns if path.is_file() else 0


def _vehicle_file(source: str) -> "VehicleFile":
    """Return the vehicle file with a name, at a path, or in a run."""
    if source.endswith(".mcap"):
        from baqueano.drive.replay import recorded_vehicle_file
        from baqueano.runs import read_run

        return recorded_vehicle_file(read_run(Path(source)))
    from baqueano.vehicle_file import load

    return load(source)
