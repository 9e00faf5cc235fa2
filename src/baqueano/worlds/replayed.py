"""Use a recorded run as a world of the loop: its readings do not depend on the commands.

The blocks receive the ticks of the run, with the recorded commands that reached the motors. So the estimates of
different estimators are comparable, and the same blocks compute the same results, bit for bit. A sensor of the vehicle
that is not in the run is silent.
"""

from dataclasses import replace

import numpy as np

from baqueano.contracts.blocks import SensorBlocks, Supervision, World
from baqueano.diagnostics import Severity, note
from baqueano.errors import Invalid
from baqueano.runs import Channel, Run
from baqueano.signals import Command, Motion, Tick
from baqueano.supervisor import Supervisor
from baqueano.vehicle_file.file import VehicleFile
from baqueano.worlds.gaps import fill_gaps, period_ns


class ReplayedWorld(World):
    """A recorded run as a world of the loop; commands have no effect.

    Parameters
    ----------
    run : Run
        The recorded run; it has at least one tick.
    sensors : NamedTuple of Sensor
        Sensors of the vehicle; a sensor that the run does not contain is silent.

    Examples
    --------
    >>> run = bq.simulate(bq.load("small"), np.zeros((10, 3)))
    >>> len(ReplayedWorld(run).read(t_ns=50_000_000))
    5
    """

    def __init__(self, run: Run, sensors: SensorBlocks | tuple[()] = ()) -> None:
        if not len(run.t_ns):
            raise Invalid.of("replay.empty", run=run.name)
        missing_sensors = [name for name in getattr(sensors, "_fields", ()) if name not in run.sensors]
        no_rows = np.zeros(0, np.int64)
        run = replace(
            run,
            sensors=run.sensors
            | {
                name: Channel(no_rows, no_rows, np.zeros((0, getattr(sensors, name).size)))
                for name in missing_sensors
            },
        )
        self._ticks = list(fill_gaps(run.ticks(), period_ns(run.t_ns)))
        silent_count = len(self._ticks) - len(run.t_ns)
        gap_notes = [note("replay.holes", Severity.WARNING, count=silent_count)] if silent_count else []
        warnings = [note("replay.without-sensor", Severity.WARNING, sensor=name) for name in missing_sensors]
        self.notes = (*gap_notes, *warnings)
        self._truth = run.truth
        self._truth_row = 0  # row of the next truth
        self._next_index = 0  # index of the next tick
        self.commands: int = len(self._ticks[0].u)

    @property
    def times(self) -> list[int]:
        """Return the times [ns] of the recorded ticks, which are the clock of this world."""
        return [tick.t_ns for tick in self._ticks]

    def read(self, t_ns: int) -> list[Tick]:
        """Return the recorded ticks since the last call, up to `t_ns`."""
        first = self._next_index
        while self._next_index < len(self._ticks) and self._ticks[self._next_index].t_ns <= t_ns:
            self._next_index += 1
        return self._ticks[first : self._next_index]

    def write(self, command: Command) -> None:
        """Do nothing: a command cannot change a recorded run."""

    def new_truths(self) -> list[tuple[int, Motion]]:
        """Return the time [ns] and the true motion of each tick since the last call; [] for a run without truth."""
        log, first = self._truth, self._truth_row
        if log is None or self._next_index == 0:
            return []
        while (
            self._truth_row < len(log.t_ns)
            and log.t_ns[self._truth_row] <= self._ticks[self._next_index - 1].t_ns
        ):
            self._truth_row += 1
        level = np.zeros(2)
        rows = range(first, self._truth_row)
        return [(int(log.t_ns[k]), Motion(log.eta[k], log.nu[k], log.nu_dot[k], level)) for k in rows]


def replay_supervisor(run: Run, vehicle_file: VehicleFile) -> Supervision:
    """Return the supervisor of a replay: that of the file, or for an imported recording one without limits of motion.

    The supervisor of the file took part in a drive of ours, so its replay repeats its stop. A recording of others was
    made without it: it is processed to its end, also if the vehicle was faster than the file allows.
    """
    if run.metadata.get("kind") != "import":
        return vehicle_file.supervisor()
    return Supervisor(vehicle_file.command.limit, imu_timeout_s=np.inf)
