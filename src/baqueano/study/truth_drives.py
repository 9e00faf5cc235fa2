"""Drive robots of the independent truth with the blocks of their vehicle files."""

from typing import Any, NamedTuple

import numpy as np

from baqueano import loop
from baqueano.contracts.values import Tree
from baqueano.estimators import PerfectState
from baqueano.guides import Idle
from baqueano.guides.repeat import Repeat
from baqueano.sensors.truth import truth_sensor
from baqueano.signals import Estimate, Reference, Slot, Tick, sensor_slots
from baqueano.simulate.open_loop import tick_times
from baqueano.study.counterpart.world import make_world
from baqueano.study.truth import Robots
from baqueano.study.truth.integrate import STEP_S
from baqueano.symbolic import function
from baqueano.vehicle_file import VehicleFile


class Loop:
    """Estimator, controller and supervisor of a file as one compiled step with the reference as input."""

    def __init__(
        self, vehicle_file: VehicleFile, perfect: bool, backend: str, controller: str | None = None
    ) -> None:
        self.file, self.perfect = vehicle_file, perfect
        estimator = PerfectState() if perfect else vehicle_file.estimator()
        self.blocks = loop.Blocks(
            estimator, Idle(float("inf")), vehicle_file.controller(controller), vehicle_file.supervisor()
        )
        sensors = truth_sensor() if perfect else vehicle_file.sensors
        self.slots = sensor_slots(tuple(sensors._fields))
        tick = Tick(1, np.zeros(3), self.slots(*(Slot(1.0, np.zeros(s.size)) for s in sensors)))
        reference = Reference(1, np.zeros(3), np.zeros(3), 0.0)
        self.step = function(self._step, self.start(np.zeros(3)), tick, reference, backend=backend)

    def start(self, eta: np.ndarray) -> tuple[Any, Any, Any]:
        """Return the initial states of the three blocks at the pose `eta` (3,)."""
        return self.blocks.estimator.init(eta), self.blocks.controller.init(), self.blocks.supervisor.init()

    def _step(self, states: Tree, tick: Tick, reference: Reference) -> Any:
        belief, estimate = self.blocks.estimator.step(states[0], tick)
        controller, requested_command = self.blocks.controller.step(states[1], reference, estimate)
        supervisor, command = self.blocks.supervisor.step(states[2], requested_command, tick, estimate)
        return (belief, controller, supervisor), (command.u, estimate)


class SimulatedDrives(NamedTuple):
    """The drives of n robots along one reference."""

    t_ns: np.ndarray  # (N,)
    references: list[Reference]  # N
    truth: np.ndarray  # (N, n, 4) pose, and forward speed
    commands: np.ndarray  # (N, n, 3)
    supervisors: list[Any]  # n, their states at the end


def simulate_drives(
    loops: list[Loop], robots: Robots, guide: Repeat, duration_s: float, seeds: list[int]
) -> SimulatedDrives:
    """Return the drives of the robots behind `guide`, from rest at the start of its route."""
    rate_hz, n = loops[0].file.rate_hz, len(loops)
    t_ns = tick_times(int(duration_s * rate_hz), rate_hz)
    state, references = guide.init(), []
    for t in t_ns:
        state, reference = guide.step(state, estimate_at(int(t)))
        references.append(reference)
    world, u = make_world(robots, seeds, STEP_S, np.tile(guide.eta[0], (n, 1))), np.zeros((n, 3))
    states = [robot_loop.start(guide.eta[0]) for robot_loop in loops]
    truth, commands = np.zeros((len(t_ns), n, 4)), np.zeros((len(t_ns), n, 3))
    for k, t in enumerate(t_ns):
        z = world.tick(u, 1.0 / rate_hz)
        now, previous_u, u = world.truth, u, np.zeros((n, 3))
        for i, robot_loop in enumerate(loops):
            true_state = np.concatenate([now.eta[i], now.nu[i]]) if robot_loop.perfect else z[i]
            tick = Tick(int(t), previous_u[i], robot_loop.slots(Slot(1.0, true_state)))
            states[i], (u[i], _) = robot_loop.step(states[i], tick, references[k])
        truth[k], commands[k] = np.column_stack([now.eta, now.nu[:, 0]]), u
    return SimulatedDrives(t_ns, references, truth, commands, [supervisor for _, _, supervisor in states])


def estimate_at(t_ns: int) -> Estimate:
    """Return an estimate for a guide that needs only its time."""
    return Estimate(t_ns, np.zeros(3), np.zeros(3), np.zeros((6, 6)))
