"""Drive blocks through a world and return the run: by first_drive, experiment, teach, repeat or replay."""

from baqueano.drive.first_drive import FirstDrive, estimate_first_drive, first_drive, with_rough_gains
from baqueano.drive.replay import replay
from baqueano.drive.session import drive, drive_stop_reason
from baqueano.drive.tasks import TeachResult, experiment, repeat, run_route, teach

__all__ = ["FirstDrive", "TeachResult", "drive", "experiment", "first_drive", "repeat", "replay", "teach"]
