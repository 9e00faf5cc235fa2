"""Collect the options with which a subcommand chooses the vehicle of its drives, records them and shows them."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from baqueano.cli import options
from baqueano.cli.driving.targets import Target, open_target
from baqueano.cli.page.live import live_page

if TYPE_CHECKING:
    from baqueano.vehicle_file.file import VehicleFile


@dataclass(frozen=True)
class DriveOptions:
    """The options --vehicle, --set, --robot, --seed, --backend, --runs, --out, --page, --pace and --shake."""

    vehicle: str | None
    settings: tuple[str, ...]
    robot: str
    seed: int
    backend: str
    folder: str
    out: Path | None
    show_page: bool
    pace: float
    shake: tuple[str, ...] = ()

    @property
    def kind(self) -> str:
        """Return the kind of --robot: "simulated", "emulated" or a host."""
        return self.robot.partition(":")[0]

    def load_vehicle(self) -> "VehicleFile":
        """Return the vehicle file with its changes."""
        return options.load_vehicle(self.vehicle, self.settings)

    def run_path(self, label: str) -> Path:
        """Return the file for a new run, as `options.run_path`."""
        return options.run_path(self.out, self.folder, label)

    @contextmanager
    def open(self, vehicle_file: "VehicleFile") -> Iterator[Target]:
        """Yield the target of the drives, which are shown on a page if --page is given."""
        with (
            live_page(self.show_page, self.robot, vehicle_file, self.folder, self.pace) as page,
            open_target(self.robot, vehicle_file, self.seed, self.backend, page, self.shake) as target,
        ):
            yield target


drive_options = options.collect("drive", DriveOptions)
