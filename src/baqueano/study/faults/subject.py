"""Create the vehicles of the fault study: a robot or a car of the independent truth, determined by its seed."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from baqueano.identify import excitation
from baqueano.runs.run import Run
from baqueano.study.counterpart import (
    FREE_CAR,
    FREE_ROBOT,
    car_file,
    car_values,
    drive_runs,
    robot_file,
    robot_values,
)  # fmt: skip
from baqueano.study.identification.trials import draw_car, draw_robot, quantised_commands
from baqueano.study.truth import Cars, Robots
from baqueano.vehicle_file import VehicleFile

VEHICLES = ("robot", "car")
REST_S = 1.0
CAR_LIMIT = [0.6, 0.2]  # of full throttle and lock: the tyres almost do not slip


class FaultSubject(NamedTuple):
    """A vehicle, its true file, and the parameters that a user would free."""

    seed: int
    vehicle: Robots | Cars
    vehicle_file: VehicleFile
    free: tuple[str, ...]

    @property
    def truth(self) -> dict[str, float]:
        """Return path → true value for the parameters that have one."""
        q = self.vehicle
        values = robot_values(q) if isinstance(q, Robots) else car_values(q)
        return {path: float(value[0]) for path, value in values.items()}

    def signal(self, seconds: float, kind: str = "random_steps") -> np.ndarray:
        """Return commands (N, m) as the motors receive them, with a rest of REST_S at the beginning."""
        vehicle_file = self.vehicle_file
        u = excitation(
            kind, vehicle_file.command.limit, seconds, vehicle_file.rate_hz, self.seed, rest_s=REST_S
        )
        return quantised_commands(u) if isinstance(self.vehicle, Robots) else u

    def runs(
        self,
        vehicles: Sequence[Robots | Cars],
        effective_commands: Sequence[np.ndarray],
        logged_commands: Sequence[np.ndarray],
    ) -> list[Run]:
        """Return the runs of the vehicles, simulated together, each with its `effective_commands`."""
        n = len(vehicles)
        return drive_runs(
            vehicles, effective_commands, [self.seed] * n, [self.vehicle_file] * n, logged=logged_commands
        )


def subject(name: str, seed: int) -> FaultSubject:
    """Return the robot or car of that seed."""
    if name == "robot":
        q = draw_robot(seed)
        return FaultSubject(seed, q, robot_file(q), FREE_ROBOT)
    c = draw_car(seed, "matched")
    return FaultSubject(seed, c, car_file(c).with_values({"command.limit": CAR_LIMIT}), FREE_CAR)
