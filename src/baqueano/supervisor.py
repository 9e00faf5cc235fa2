"""The last word before the motors: limits, health, stop.

`Supervisor` is a block like the others, pure and traceable. It clips every command to its limits, and
answers any of its `REASONS` with a zero command, for good: a stop is latched until somebody starts the
vehicle again.

`guarded` is the same care for what a block may do that arithmetic cannot show: raise, or return something
else than promised. The clocked loop wraps every block in it; `BlockFault` then names the block and the
line.
"""

import inspect
import traceback
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from baqueano.contracts.blocks import Block
from baqueano.contracts.values import Tree, Value
from baqueano.diagnostics import Diagnostic, StopReason, stop
from baqueano.errors import from_outside, named
from baqueano.parameter import INF, documented, parameter
from baqueano.signals import Command, Estimate, Reference, Tick, seconds
from baqueano.vehicles.bounds import check_bounds

SQUARABLE = 1e150  # m/s: of a faster belief the speed itself overflows
REASONS = (
    None,
    StopReason.COMMAND_NOT_FINITE,
    StopReason.ESTIMATE_NOT_FINITE,
    StopReason.SPEED,
    StopReason.YAW_RATE,
    StopReason.POSITION_UNCERTAIN,
    StopReason.SENSOR_SILENT,
)


class SupervisorState(NamedTuple):
    """The past that a stop and a silence depend on."""

    stopped: float  # 1.0 for good, once there was a reason
    reason: float  # index into REASONS
    heard_ns: int  # when the IMU last spoke; -1 before the first tick


@documented
@dataclass(frozen=True, slots=True, eq=False)
class Supervisor:
    """Clips the command to `limit` and stops for the reasons above. A limit that is not given is infinite."""

    limit: np.ndarray = parameter("unit of u", "largest command, one per channel, (n,)", low=0.0, shape=None)
    max_speed_m_s: float = parameter("m/s", "estimated speed that stops the vehicle", low=0.0, default=INF)
    max_yaw_rate_rad_s: float = parameter("rad/s", "estimated yaw rate that stops it", low=0.0, default=INF)
    max_position_std_m: float = parameter(
        "m", "uncertainty of the position that stops it", low=0.0, default=INF
    )
    imu_timeout_s: float = parameter("s", "silence of the IMU that stops it", low=0.0, default=0.5)
    watch: str = "imu"  # the sensor that must not be silent; a vehicle without it is not watched

    def __post_init__(self) -> None:
        check_bounds(self)

    def init(self) -> SupervisorState:
        """Not stopped."""
        return SupervisorState(0.0, 0.0, -1)

    def step(
        self, state: SupervisorState, command: Command, tick: Tick, estimate: Estimate
    ) -> tuple[SupervisorState, Command]:
        """The command (n,) that may reach the motors."""
        heard_ns: Value = np.where((self._has(tick) > 0.0) | (state.heard_ns < 0), tick.t_ns, state.heard_ns)
        eta, nu, cov = estimate.eta, estimate.nu, estimate.cov
        p = np.where(np.isfinite(cov[:2, :2]), cov[:2, :2], 0.0)
        spread = np.hypot(0.5 * (p[0, 0] - p[1, 1]), p[0, 1])
        position_std = np.sqrt(np.maximum(0.5 * (p[0, 0] + p[1, 1]) + spread, 0.0))  # along the longest axis
        numbers = np.concatenate([eta, nu, cov.reshape(-1)])
        faults = (  # in the order of REASONS
            np.sum(np.isfinite(command.u)) < len(self.limit),
            np.sum(np.isfinite(numbers)) < len(numbers),
            np.hypot(*np.minimum(np.abs(nu[:2]), SQUARABLE)) > self.max_speed_m_s,
            np.abs(nu[2]) > self.max_yaw_rate_rad_s,
            position_std > self.max_position_std_m,
            seconds(tick.t_ns, heard_ns) > self.imu_timeout_s,
        )
        reason: Value = 0.0
        for code in range(len(faults), 0, -1):
            reason = np.where(faults[code - 1], float(code), reason)
        reason = np.where(state.stopped > 0.0, state.reason, reason)
        stopped: Value = np.where(reason > 0.0, 1.0, 0.0)
        u = np.where(stopped > 0.0, 0.0, np.clip(command.u, -self.limit, self.limit))
        return SupervisorState(stopped, reason, heard_ns), Command(command.t_ns, u)

    def _has(self, tick: Tick) -> Value:
        return getattr(tick.sensors, self.watch).has if self.watch in tick.sensors._fields else 1.0


def stop_reason(state: Tree) -> Diagnostic | None:
    """Return why a supervisor stopped; None if it did not, or is somebody else's and does not say.

    One that has reasons of its own holds them as `why`: a diagnostic, or its words.
    """
    if why := getattr(state, "why", None):
        return why if isinstance(why, Diagnostic) else stop(StopReason.OWN_REASON, words=str(why))
    if getattr(state, "stopped", 0.0) > 0.0:
        return numbered(int(getattr(state, "reason", 0.0)))
    return None


def numbered(reason: int) -> Diagnostic:
    """Return the diagnostic of an index into REASONS; a supervisor of the user's may have others."""
    ours = REASONS[reason] if 0 < reason < len(REASONS) else None
    if ours is None:
        return stop(StopReason.OWN_REASON, words=f"the supervisor stopped, reason {reason}")
    return stop(ours)


class BlockFault(Exception):
    """A block did not keep its promise. `why` names the block, the file and the line."""

    def __init__(self, room: str, why: Diagnostic) -> None:
        super().__init__(why.code)
        self.room, self.why = room, why


@dataclass(frozen=True, slots=True, eq=False)
class GuardedBlock:
    """A block whose `step` raises nothing but BlockFault, and returns what its room promises."""

    room: str  # "controller"
    block: Block
    kind: type  # of its output
    zeros: dict[str, np.ndarray]  # its fields that must be finite, in their shapes

    def init(self, *start: np.ndarray) -> Tree:
        """The block's own start."""
        try:
            return self.block.init(*start)
        except BaseException as error:
            raise self._fault(error, StopReason.BLOCK_RAISED_IN_INIT) from error

    def step(self, state: Tree, *inputs: Tree) -> tuple[Tree, Tree]:
        """The block's own step, checked."""
        try:
            result = self.block.step(state, *inputs)
        except BaseException as error:
            raise self._fault(error) from error
        if type(result) is not tuple or len(result) != 2:  # a NamedTuple is an output, not a pair
            raise self._returned(_text_of(result), "(state, output)")
        if wrong := _wrong(result[1], self.kind, self.zeros):
            raise self._returned(*wrong)
        return result

    def _returned(self, found: str, expected: str) -> BlockFault:
        why = stop(StopReason.BLOCK_RETURNED, block=_where(self), found=found, expected=expected)
        return BlockFault(self.room, why)

    def _fault(self, error: BaseException, reason: StopReason = StopReason.BLOCK_RAISED) -> BlockFault:
        """Return the fault of any exception of the block, sys.exit() too; raise again what comes from outside."""
        if from_outside(error):
            raise error
        return BlockFault(self.room, stop(reason, block=_where(self, error), error=named(error)))


def guarded(room: str, block: Block, commands: int) -> GuardedBlock:
    """`block` of a room of the loop, for a vehicle with `commands` channels."""
    pose = {"eta": np.zeros(3), "nu": np.zeros(3)}
    command = {"u": np.zeros(commands)}
    promised: dict[str, tuple[type, dict[str, np.ndarray]]] = {
        "estimator": (Estimate, pose | {"cov": np.zeros((6, 6))}),
        "guide": (Reference, pose),
        "controller": (Command, command),
        "supervisor": (Command, command),
    }
    return GuardedBlock(room, block, *promised[room])


@dataclass(frozen=True, slots=True, eq=False)
class Off:
    """A block that replaces a faulty one: zero command, zero reference, unchanged estimate."""

    room: str
    commands: int

    def init(self, *start: np.ndarray) -> None:
        """Return an empty state."""

    def step(self, state: None, *inputs: Tree) -> tuple[None, Tree]:
        """The output of the room that moves nothing."""
        t_ns = inputs[-1].t_ns
        if self.room == "estimator":
            return None, Estimate(t_ns, np.full(3, np.nan), np.full(3, np.nan), np.full((6, 6), np.nan))
        if self.room == "guide":
            return None, Reference(t_ns, inputs[-1].eta, np.zeros(3), 0.0)
        return None, Command(t_ns, np.zeros(self.commands))


def _wrong(output: Tree, kind: type, zeros: dict[str, np.ndarray]) -> tuple[str, str] | None:
    """Return what is wrong with `output` and what was expected; None if nothing is."""
    if not isinstance(output, kind):
        fields = ", ".join(f for f in kind.__annotations__ if not f.startswith(("innovation", "weight")))
        return f"{_text_of(output)} as its output", f"{kind.__name__}({fields})"
    for field, zero in zeros.items():
        value, shape = getattr(output, field), zero.shape
        plain = type(value) is np.ndarray and value.shape == shape and value.dtype is zero.dtype
        if plain and np.vdot(value, zero) == 0.0:  # NaN · 0 and ∞ · 0 are NaN: all entries are finite
            continue
        if np.shape(value) != shape:
            return f"{kind.__name__}.{field} with shape {np.shape(value)}", str(shape)
        if not _finite(value):
            return f"{kind.__name__}.{field} = {np.asarray(value).tolist()}", "finite numbers"
    return None


def _finite(value: Value) -> bool:
    try:
        return bool(np.isfinite(value).all())
    except TypeError:
        return False


def _text_of(value: object) -> str:
    if type(value) is tuple:
        return f"a tuple of {len(value)}"
    return "nothing" if value is None else type(value).__name__


def _where(guard: GuardedBlock, error: BaseException | None = None) -> str:
    """The block and the line of its own file: where it raised, or where its step begins."""
    block: Tree = guard.block
    while (
        inner := getattr(block, "block", None)
    ) is not None:  # timed, limited, compiled: each holds the one inside
        block = inner
    kind: Tree = type(block)
    who = f"{guard.room} {kind.__name__}"
    try:
        file, line = inspect.getfile(kind.step), kind.step.__code__.co_firstlineno
    except (AttributeError, TypeError):
        return who
    frames = traceback.extract_tb(error.__traceback__) if error is not None else []
    own = [frame.lineno for frame in frames if frame.filename == file and frame.lineno is not None]
    return f"{who} ({file}:{own[-1] if own else line})"
