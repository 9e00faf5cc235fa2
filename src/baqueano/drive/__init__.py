"""Drive blocks through a world and return the run: by first_drive, experiment, teach, repeat or replay.

session        the loop of a drive, with observers and a recording; budget, interrupt: its limits
tasks, replay  experiment, teach and repeat; a recorded run through blocks
mission        a drive as data, for a vehicle behind a door
first_drive    the drive of an unknown vehicle; closure: the scales that a return to a mark shows
manual         keys, game pad and display;  safety: precautions along a route;  health: the messages of a monitor
"""

from baqueano.drive.first_drive import FirstDrive, estimate_first_drive, first_drive, with_rough_gains
from baqueano.drive.replay import replay
from baqueano.drive.session import drive, drive_stop_reason
from baqueano.drive.tasks import TeachResult, experiment, repeat, run_route, teach

__all__ = ["FirstDrive", "TeachResult", "drive", "experiment", "first_drive", "repeat", "replay", "teach"]
