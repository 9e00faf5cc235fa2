"""Blocks + world → run: experiment, teach, repeat, replay."""

from baqueano.drive.session import drive, stop_of
from baqueano.drive.verbs import Taught, experiment, repeat, replay, route_of, teach

__all__ = ["Taught", "drive", "experiment", "repeat", "replay", "route_of", "stop_of", "teach"]
