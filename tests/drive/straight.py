"""Five metres straight ahead with unequal wheels: the remaining heading error and the sideways error."""

from datetime import date
from typing import NamedTuple

import numpy as np

from baqueano import vehicle_file
from baqueano.drive.tasks import drive_with_driver
from baqueano.vehicle_file import override
from baqueano.vehicle_file.provenance import Provenance

UNEQUAL = (1.075, 0.925)  # 15 % between the wheels
WAY_M = 5.0


class Straight(NamedTuple):
    """At the end of the way, and on it."""

    psi_deg: float
    most_deg: float
    beside_m: float
    run: object

    def text(self):
        return f"heading {self.psi_deg:+7.2f}°, at most {self.most_deg:6.2f}°, {100 * self.beside_m:+7.1f} cm beside"


def as_fitted(file, key="model.actuator_matrix"):
    """Return the same file with the mark that its model comes from a fit."""
    provenance = Provenance("runs/0001-experiment.mcap", date(2026, 11, 21), None, "USABLE")
    return file.with_values({key: np.asarray(file.value(key)).tolist()}, {key: provenance})


def random_vehicle(seed):
    """A random vehicle file with two wheels."""
    rng = np.random.default_rng(seed)

    def x(low, high):
        return float(rng.uniform(low, high))

    m, drag = x(0.4, 2.0), x(0.005, 0.03)
    values = {
        "model.mass_kg": m, "geometry.radius_m": 0.09, "model.inertia_kg_m2": 0.5 * m * 0.09**2 * x(0.7, 1.4),
        "model.friction.linear": [x(2, 8), 60.0, drag], "model.friction.quadratic": [0.0, 0.0, 0.0],
        "model.friction.coulomb": [x(0, 0.3), 0.0, x(0, 0.01)],
        "model.actuator_matrix": [[x(2, 8), 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, drag * x(6, 20)]],
        "model.centre_of_mass_x_m": x(-0.01, 0.03), "model.drivetrain.lag_s": x(0.02, 0.15),
        "model.drivetrain.delay_s": x(0.0, 0.05), "model.drivetrain.dead_zone_forward": [x(0, 0.3)] * 2,
        "model.drivetrain.gain": [1.0, 1.0],
    }  # fmt: skip
    return vehicle_file.load("small").with_values(values)


def body(file, yaw_gain=1.0):
    """The file of a body with unequal wheels whose yaw gain is `yaw_gain` times that of `file`."""
    T = np.array(file.vehicle.actuator_matrix)
    T[2] *= yaw_gain
    settings = (
        "model.drivetrain.mixing=two_wheels", f"model.drivetrain.gain={list(UNEQUAL)}",
        f"model.actuator_matrix={T.tolist()}",
    )  # fmt: skip
    return override(file, settings)


def hand_for(seconds, u, rate_hz):
    """Return a driver that commands `u` for this duration and then ends the drive."""
    ticks_to_go = [round(seconds * rate_hz)]

    def hand():
        ticks_to_go[0] -= 1
        if ticks_to_go[0] < 0:
            raise KeyboardInterrupt
        return np.array(u, dtype=float)

    return hand


def straight(file, truth, speed, speed_m_s, hold, seed=0):
    """Drive WAY_M with the command `speed`, at about this speed."""
    u = np.zeros(file.vehicle.commands)
    u[0] = speed
    hand = hand_for(1.2 * WAY_M / speed_m_s, u, file.rate_hz)
    return measured(drive_with_driver(file, hand, hold=hold, truth=truth, seed=seed))


def measured(run, way_m=WAY_M):
    """Return the errors of the first `way_m` of a run."""
    eta = run.truth.eta
    path_m = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(eta[:, :2], axis=0), axis=1))])
    assert path_m[-1] > way_m, f"only {path_m[-1]:.2f} m"
    rows = slice(0, int(np.searchsorted(path_m, way_m)) + 1)
    psi = np.degrees(np.unwrap(eta[rows, 2]) - eta[0, 2])
    sideways = np.array([-np.sin(eta[0, 2]), np.cos(eta[0, 2])])
    return Straight(psi[-1], np.abs(psi).max(), float((eta[rows][-1, :2] - eta[0, :2]) @ sideways), run)
