"""`baqueano study first-drives`: simulate careful first drives of unknown vehicles in a small room.

The robots of truth/ have independent physics; the planner uses the unchanged file garage/small. Both gains of a robot
are 0.3 to 3 times the file's gains (log-uniform, equal within ± 25 %). The four dead zones are 0 to 0.4, and friction
at rest is 1 to 1.3 times the friction in motion. The wirings alternate: correct, with the left or the right motor
inverted, or with both motors swapped. The criteria are contact of a body with a wall, the smallest distance to a
wall, and the correct diagnosis of the wiring.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from baqueano.contracts.blocks import World
from baqueano.contracts.values import TableRow
from baqueano.diagnostics import Verdict
from baqueano.drive import first_drive
from baqueano.messages.language import mark as N_, number, translate as _
from baqueano.messages.text_table import text_table
from baqueano.routes.room import vehicle_room
from baqueano.signals import Command, Motion, Tick
from baqueano.study.counterpart import LoopWorld, robot_values
from baqueano.study.truth import Robots, draw_robots
from baqueano.sweep.workers import run_in_processes
from baqueano.vehicle_file import VehicleFile, load

ROOM_SIZE = "1.5x1.5"
WIRINGS = (N_("well"), N_("left inverted"), N_("right inverted"), N_("swapped"))
MIN_GAIN_RATIO, MAX_GAIN_RATIO, DEAD_ZONE, BREAKAWAY_RATIO = 0.3, 3.0, 0.4, 1.3


class MiswiredLink(World):
    """A simulated two-wheeled vehicle with the motors wired according to `wiring`.

    The ticks contain the sent commands.
    """

    def __init__(self, inner: World, wiring: str) -> None:
        self.inner, self.wiring, self.commands = inner, wiring, inner.commands
        self._command = np.zeros(inner.commands)

    def read(self, t_ns: int) -> list[Tick]:
        """Return the ticks up to `t_ns`, with the command that was sent."""
        return [tick._replace(u=self._command) for tick in self.inner.read(t_ns)]

    def write(self, command: Command) -> None:
        """Send the command as the motors receive it through this wiring."""
        self._command = np.array(command.u, dtype=float)
        left, right = self._command[0] - self._command[2], self._command[0] + self._command[2]
        left = -left if self.wiring == "left inverted" else left
        right = -right if self.wiring == "right inverted" else right
        if self.wiring == "swapped":
            left, right = right, left
        self.inner.write(Command(command.t_ns, np.array([0.5 * (left + right), 0.0, 0.5 * (right - left)])))

    def new_truths(self) -> list[tuple[int, Motion]]:
        """Return the true motion since the previous call."""
        return self.inner.new_truths()


class FirstDriveRow(NamedTuple):
    """The results of all first drives with one wiring."""

    wiring: str
    drives: int
    touches: int  # drives in which the body touched a wall
    nearest_m: float  # the smallest distance between body and wall
    correct_names: int  # drives with the correct diagnosis of the wiring
    gain_off: (
        float  # median of the larger of (estimated ÷ true, true ÷ estimated) gain; NaN with wrong wiring
    )
    longest_s: float


@dataclass(frozen=True, slots=True, eq=False)
class FirstDrives:
    """The table of first drives, a row per wiring."""

    wiring_rows: tuple[FirstDriveRow, ...]

    @property
    def reasons(self) -> tuple[str, ...]:
        """Return a sentence if a body touched a wall, and one if a wiring was diagnosed wrongly."""
        touches = sum(row.touches for row in self.wiring_rows)
        wrong_names = sum(row.drives - row.correct_names for row in self.wiring_rows)
        reasons = []
        if touches:
            reasons.append(_("in {touched} drives the body touched a wall", touched=touches))
        if wrong_names:
            reasons.append(_("after {unnamed} drives the wiring was identified wrongly", unnamed=wrong_names))
        return tuple(reasons)

    @property
    def verdict(self) -> Verdict:
        """Return REFUSED if a wall was touched, WARN with other reasons, else USABLE."""
        if any(row.touches for row in self.wiring_rows):
            return Verdict.REFUSED
        if self.reasons:
            return Verdict.WARN
        return Verdict.USABLE

    def rows(self) -> list[TableRow]:
        """Return a flat row for each wiring."""
        return [row._asdict() for row in self.wiring_rows]

    def table(self) -> str:
        """Return the rows and reasons as a text table."""
        head = [_("wiring"), _("drives"), _("touched"), _("free space"), _("named"), _("gain"), _("time")]
        rows = (
            [_(r.wiring), str(r.drives), str(r.touches), f"{number(100.0 * r.nearest_m):.0f} cm", str(r.correct_names),
             f"{number(r.gain_off):.2f}×" if np.isfinite(r.gain_off) else "-", f"{number(r.longest_s):.0f} s"]
            for r in self.wiring_rows
        )  # fmt: skip
        lines = [_("room {room} m", room=ROOM_SIZE), *text_table("<>>>>>>", head, *rows)]
        return "\n".join([*lines, *(f"! {reason}" for reason in self.reasons)])


class FirstDriveFigures(NamedTuple):
    """The results of one simulated first drive."""

    wiring: str
    margin_m: float
    is_named: bool
    gain_off: float
    seconds: float


def first_drives(
    seeds: int = 40, first: int = 0, processes: int = 1, backend: str = "auto",
    advance: Callable[[int], None] = lambda k: None,
) -> FirstDrives:  # fmt: skip
    """Return the table over vehicles `first` … `first + seeds − 1`. `advance` is called with the number of drives
    that have just finished.
    """
    drives = run_in_processes(
        partial(drive_unknown_vehicle, backend=backend), range(first, first + seeds), processes, advance
    )
    drives_by_wiring = {wiring: [drive for drive in drives if drive.wiring == wiring] for wiring in WIRINGS}
    return FirstDrives(
        tuple(_row(wiring, figures) for wiring, figures in drives_by_wiring.items() if figures)
    )


def _row(wiring: str, figures: list[FirstDriveFigures]) -> FirstDriveRow:
    margins = np.array([drive.margin_m for drive in figures])
    gain = float(np.median([drive.gain_off for drive in figures]))
    walls = int(np.sum(margins < 0.0)), float(margins.min())
    named_count, longest_s = sum(drive.is_named for drive in figures), max(drive.seconds for drive in figures)
    return FirstDriveRow(wiring, len(figures), *walls, named_count, gain, longest_s)


def drive_unknown_vehicle(seed: int, backend: str = "auto") -> FirstDriveFigures:
    """Simulate the first drive of the unknown vehicle of that seed, and return its results."""
    vehicle_file, wiring = load("small"), WIRINGS[seed % len(WIRINGS)]
    robot = draw_unknown_robot(seed)
    world = MiswiredLink(LoopWorld(robot, seed, vehicle_file.rate_hz), wiring)
    drive = first_drive(vehicle_file, world=world, seed=seed, backend=backend)
    truth, room = drive.run.truth, vehicle_room(vehicle_file, ROOM_SIZE)
    assert truth is not None
    margin = float(np.min(room.free_half_width_m - np.abs(truth.eta[:, :2])))
    expected_codes = {
        "well": [],
        "left inverted": ["wiring.backwards-left"],
        "right inverted": ["wiring.backwards-right"],
        "swapped": ["wiring.swapped"],
    }[wiring]
    is_named = [message.code for message in drive.wiring] == expected_codes
    error_m = float("nan")
    if wiring == "well":
        ratio = np.array([drive.forward_gain, drive.turn_gain]) / gain_ratios(robot, vehicle_file)
        error_m = float(np.max(np.maximum(ratio, 1.0 / np.maximum(ratio, 1e-9))))
    return FirstDriveFigures(
        wiring, margin, is_named, error_m, float(drive.run.t_ns[-1] - drive.run.t_ns[0]) * 1e-9
    )


def draw_unknown_robot(seed: int) -> Robots:
    """Return a robot with random gains, dead zones and friction at rest."""
    draw, q = np.random.default_rng([seed, 70]), draw_robots(1, seed)
    gain = np.exp(draw.uniform(np.log(MIN_GAIN_RATIO), np.log(MAX_GAIN_RATIO))) * draw.uniform(0.75, 1.25, 2)
    forward_ratio, yaw_ratio = np.clip(gain, MIN_GAIN_RATIO, MAX_GAIN_RATIO)
    forward, backward = draw.uniform(0.0, DEAD_ZONE, (2, 1, 2))
    return q.with_parameters(
        gain=forward_ratio * q.gain, arm_m=yaw_ratio / forward_ratio * q.arm_m, forward=forward, backward=backward,
        breakaway=draw.uniform(1.0, BREAKAWAY_RATIO, 1),
    )  # fmt: skip


def gain_ratios(robot: Robots, vehicle_file: VehicleFile) -> np.ndarray:
    """Return the robot's gains (2,), acceleration per command along x and about z, divided by the file's gains."""
    true_values, body = robot_values(robot), vehicle_file.vehicle
    inertias = {0: (robot.mass_kg, body.mass_kg), 2: (robot.inertia_kg_m2, body.inertia_kg_m2)}
    return np.array([
        float(true_values[f"model.actuator_matrix[{i},{i}]"][0] / robot_inertia[0])
        / (body.actuator_matrix[i, i] / file_inertia)
        for i, (robot_inertia, file_inertia) in inertias.items()
    ])  # fmt: skip
