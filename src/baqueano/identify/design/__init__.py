"""Experiments that are designed: as much information as a room, a vehicle and a time allow.

room = room_of(file, "2x2")
plan = designed(file, room, 60.0)         # the best commands for this vehicle
safe = contained(u, file, room)           # any other signal, kept inside by the same rule
"""

from baqueano.identify.design.information import Informant, mean_error
from baqueano.identify.design.plan import Plan, designed
from baqueano.identify.design.room import ContainedSignal, Room, body_radius, contained, room_of
from baqueano.identify.design.vehicle_cloud import VehicleDistribution, possible_vehicles

__all__ = [
    "ContainedSignal",
    "Informant",
    "Plan",
    "Room",
    "VehicleDistribution",
    "body_radius",
    "contained",
    "designed",
    "mean_error",
    "possible_vehicles",
    "room_of",
]
