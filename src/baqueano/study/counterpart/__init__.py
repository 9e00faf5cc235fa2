"""Vehicles of the independent truth in the form of the package: vehicle files, true parameters, and runs."""

from baqueano.study.counterpart.cars import FREE_CAR, car_file, car_unknowns, car_values, with_car_unknowns
from baqueano.study.counterpart.recorded import GroupDrive, drive_group, drive_runs, logged_run, vehicle_run
from baqueano.study.counterpart.robots import FREE_ROBOT, robot_file, robot_values, with_values
from baqueano.study.counterpart.world import LoopWorld, make_world
