"""Check every command before the motors: limits, health, stop.

`Supervisor` is a block like the others, pure and traceable. It clips every command to its limits, and sends a zero
command for any of its `REASONS`. A stop is latched until the operator starts the vehicle again.

`guard_block` protects against faults of a block that the supervisor cannot detect: an exception, or a wrong output. The
clocked loop wraps every block in `guard_block`; `BlockFault` then names the block and the line.
"""

import inspect
import traceback
from collections.abc import Container
from dataclasses import dataclass, replace
from operator import attrgetter
from typing import NamedTuple

import numpy as np

from baqueano.contracts import optional
from baqueano.contracts.blocks import Block
from baqueano.contracts.values import Tree, Value, array_text
from baqueano.diagnostics import Diagnostic, StopReason, note, stop
from baqueano.errors import cell_name, error_text, is_interruption
from baqueano.messages.language import translate as _
from baqueano.parameter import INF, document, parameter
from baqueano.signals import Command, Estimate, Reference, Tick, seconds
from baqueano.vehicles.bounds import check_bounds

PLAIN_NUMBERS = (int, float, bool, np.float64, np.int64, np.bool_)
MAX_SQUARABLE_M_S = 1e150  # the square of a larger estimated speed overflows
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
    """The state of a supervisor: the latched stop, its reason, and the time of the IMU's last measurement."""

    stopped: float  # 1.0 from the first reason on
    reason: float  # index into REASONS
    imu_ns: int  # time of the IMU's last measurement; -1 before the first tick


@document
@dataclass(frozen=True, slots=True, eq=False)
class Supervisor:
    """A supervisor that clips the command to `limit` and stops the vehicle for each of `REASONS`.

    The defaults of the speeds and of the standard deviation are infinite, so that they never stop the vehicle.
    """

    limit: np.ndarray = parameter("unit of u", "largest command, one per channel, (n,)", low=0.0, shape=None)
    max_speed_m_s: float = parameter(
        "m/s", "estimated speed above which the vehicle is stopped", low=0.0, default=INF
    )
    max_yaw_rate_rad_s: float = parameter(
        "rad/s", "estimated yaw rate above which the vehicle is stopped", low=0.0, default=INF
    )
    max_position_std_m: float = parameter(
        "m", "standard deviation of the position above which the vehicle is stopped", low=0.0, default=INF
    )
    imu_timeout_s: float = parameter(
        "s", "time without data from the IMU after which the vehicle is stopped", low=0.0, default=0.5
    )
    watch: str = "imu"  # the sensor that must not be silent; without this sensor, silence is not checked

    def __post_init__(self) -> None:
        check_bounds(self)

    def init(self) -> SupervisorState:
        """Return the state before the first tick: not stopped."""
        return SupervisorState(0.0, 0.0, -1)

    def step(
        self, state: SupervisorState, command: Command, tick: Tick, estimate: Estimate
    ) -> tuple[SupervisorState, Command]:
        """Return the next state, and the command (n,) that is allowed to reach the motors."""
        imu_ns: Value = np.where((self._has(tick) > 0.0) | (state.imu_ns < 0), tick.t_ns, state.imu_ns)
        eta, nu, cov = estimate.eta, estimate.nu, estimate.cov
        speed = np.minimum(np.abs(nu[:2]), MAX_SQUARABLE_M_S)
        faults = (  # in the order of REASONS
            ~np.all(np.isfinite(command.u)),
            ~np.all(np.isfinite(np.concatenate([eta, nu, cov.reshape(-1)]))),
            speed @ speed > self.max_speed_m_s * self.max_speed_m_s,
            np.abs(nu[2]) > self.max_yaw_rate_rad_s,
            position_std(cov) > self.max_position_std_m,
            seconds(tick.t_ns, imu_ns) > self.imu_timeout_s,
        )
        reason: Value = 0.0
        for code in range(len(faults), 0, -1):
            reason = np.where(faults[code - 1], float(code), reason)
        reason = np.where(state.stopped > 0.0, state.reason, reason)
        is_stopped: Value = np.where(reason > 0.0, 1.0, 0.0)
        u = np.where(is_stopped > 0.0, 0.0, np.clip(command.u, -self.limit, self.limit))
        return SupervisorState(is_stopped, reason, imu_ns), Command(command.t_ns, u)

    def _has(self, tick: Tick) -> Value:
        return getattr(tick.sensors, self.watch).is_new if self.watch in tick.sensors._fields else 1.0


def position_std(cov: Value) -> Value:
    """Return the standard deviation [m] of the position along its longest axis, from the covariance (6, 6)."""
    p = np.where(np.isfinite(cov[:2, :2]), cov[:2, :2], 0.0)
    half_difference = np.hypot(0.5 * (p[0, 0] - p[1, 1]), p[0, 1])
    return np.sqrt(np.maximum(0.5 * (p[0, 0] + p[1, 1]) + half_difference, 0.0))


def stop_reason(state: Tree) -> Diagnostic | None:
    """Return the reason why a supervisor stopped; None without a stop, or if the user's supervisor does not report it.

    `reason` in the state is an index into REASONS, or, in a supervisor with other reasons, a diagnostic or a sentence.
    """
    reason = getattr(state, "reason", None) or 0.0
    if isinstance(reason, Diagnostic):
        return reason
    if isinstance(reason, str):
        return stop(StopReason.OWN_REASON, words=reason)
    return reason_diagnostic(int(reason)) if getattr(state, "stopped", 0.0) > 0.0 else None


def reason_diagnostic(reason: int) -> Diagnostic:
    """Return the diagnostic of an index into REASONS; a general diagnostic for an index of a user's supervisor."""
    stop_code = REASONS[reason] if 0 < reason < len(REASONS) else None
    if stop_code is None:
        return stop(
            StopReason.OWN_REASON,
            words=_("the supervisor stopped the vehicle, reason {reason}", reason=reason),
        )
    return stop(stop_code)


class BlockFault(Exception):
    """The error of a block that violates its contract. `reason` names the block, the file and the line."""

    def __init__(self, role: str, reason: Diagnostic) -> None:
        super().__init__(reason.code)
        self.role, self.reason = role, reason


@dataclass(frozen=True, slots=True, eq=False)
class GuardedBlock:
    """A block whose `step` checks its output, and raises only BlockFault or interruptions from outside."""

    role: str  # "controller"
    block: Block
    output_class: type  # of its output
    zeros: dict[str, np.ndarray]  # its fields that must be finite, in their shapes; () of a number

    def init(self, *start: np.ndarray) -> Tree:
        """Return the start state of the block. Raise BlockFault if `init` of the block raises."""
        try:
            return self.block.init(*start)
        except BlockFault:
            raise
        except BaseException as error:
            raise self._fault(error, StopReason.BLOCK_RAISED_IN_INIT) from error

    def step(self, state: Tree, *inputs: Tree) -> tuple[Tree, Tree]:
        """Return the result of the block's step. Raise BlockFault if the step raises or violates the contract."""
        try:
            result = self.block.step(state, *inputs)
        except BlockFault:  # of an inner block, which the fault names
            raise
        except BaseException as error:
            reason = self._fault(error)
            self._ask_parts(state, inputs)
            raise reason from error
        if type(result) is not tuple or len(result) != 2:  # a NamedTuple is an output, not a pair
            raise self._return_fault(_value_text(result), "(state, output)")
        try:
            output = _checked_output(result[1], self.output_class, self.zeros)
        except _WrongOutput as problem:
            self._ask_parts(state, inputs)
            raise self._return_fault(*problem.args) from None
        return result if output is result[1] else (result[0], output)

    def __getattr__(self, name: str) -> Tree:
        return getattr(object.__getattribute__(self, "block"), name)

    def _ask_parts(self, state: Tree, inputs: tuple[Tree, ...]) -> None:
        """Raise the fault of the part that caused it, if any: repeat the step with a guard around every part."""
        text = _innermost_block(self.block)
        if any(type(part) is not GuardedBlock for part in _parts(text).values()):
            command_count = len(self.zeros.get("u", ()))
            replace(self, block=with_guarded_parts(self.role, text, command_count, compiled_too=True)).step(
                state, *inputs
            )

    def _return_fault(self, result_text: str, expected: Diagnostic | str) -> BlockFault:
        figures = {"value": result_text, "expected": expected}
        return BlockFault(self.role, stop(StopReason.BLOCK_RETURNED, **_block_figures(self), **figures))

    def _fault(self, error: BaseException, reason: StopReason = StopReason.BLOCK_RAISED) -> BlockFault:
        """Return the fault of an exception of the block, even of sys.exit(). Re-raise an interruption from outside."""
        if is_interruption(error):
            raise error
        return BlockFault(self.role, stop(reason, **_block_figures(self, error), error=error_text(error)))


def guard_block(role: str, block: Block, command_count: int = 0) -> GuardedBlock:
    """Return a guard around `block` of `role` and around its parts, for a vehicle with `command_count` channels."""
    pose = {"t_ns": np.zeros(()), "eta": np.zeros(3), "nu": np.zeros(3)}
    command = {"t_ns": np.zeros(()), "u": np.zeros(command_count)}
    contract: dict[str, tuple[type, dict[str, np.ndarray]]] = {
        "estimator": (Estimate, pose | {"cov": np.zeros((6, 6))}),
        "guide": (Reference, pose | {"at_end": np.zeros(())}),
        "controller": (Command, command),
        "supervisor": (Command, command),
    }
    return GuardedBlock(role, with_guarded_parts(role, block, command_count), *contract[role])


def with_guarded_parts(role: str, block: Tree, command_count: int, compiled_too: bool = False) -> Tree:
    """Return the block with guarded parts; a block that is compiled or not a dataclass is returned unchanged.

    A compiled part has a guard only with `compiled_too`: the guard of the block around it detects its fault.
    """
    guarded_parts = {
        name: guard_block(role, part, command_count)
        for name, part in _parts(block).items()
        if compiled_too or not optional.attribute(part, "is_compiled")
    }
    return replace(block, **guarded_parts) if guarded_parts else block


def _parts(block: Tree) -> dict[str, Tree]:
    """Return the blocks inside a dataclass, by the name of their fields."""
    names = [name for name in optional.attribute(block, "inner_blocks") if optional.has_field(block, name)]
    return {name: getattr(block, name) for name in names}


@dataclass(frozen=True, slots=True, eq=False)
class FallbackBlock:
    """A block that replaces a faulty one: zero command, reference at rest at the estimated pose, estimate of NaN."""

    role: str
    command_count: int

    def init(self, *start: np.ndarray) -> None:
        """Return None: this block does not have a state."""

    def step(self, state: None, *inputs: Tree) -> tuple[None, Tree]:
        """Return the output of the role for a vehicle at rest: zero command or velocity, or an estimate of NaN."""
        t_ns = inputs[-1].t_ns
        if self.role == "estimator":
            return None, Estimate(t_ns, np.full(3, np.nan), np.full(3, np.nan), np.full((6, 6), np.nan))
        if self.role == "guide":
            return None, Reference(t_ns, inputs[-1].eta, np.zeros(3), 0.0)
        return None, Command(t_ns, np.zeros(self.command_count))


class _WrongOutput(Exception):
    """The exception of an output that violates its contract: a text about the output, and what was expected."""


def _checked_output(output: Tree, output_class: type, zeros: dict[str, np.ndarray]) -> Tree:
    """Return the output, with arrays instead of lists. Raise _WrongOutput if it is not of this class, these shapes and
    finite."""
    if not isinstance(output, output_class):
        fields = ", ".join(
            f for f in output_class.__annotations__ if not f.startswith(("innovation", "weight"))
        )
        raise _WrongOutput(f"(state, {_value_text(output)})", f"(state, {output_class.__name__}({fields}))")
    checked_output: Tree = output
    for (field, zero), value in zip(zeros.items(), attrgetter(*zeros)(output), strict=True):
        shape = zero.shape
        is_plain = type(value) is np.ndarray and value.shape == shape and value.dtype is zero.dtype
        if is_plain and np.vdot(value, zero) == 0.0:  # NaN · 0 and ∞ · 0 are NaN: all entries are finite
            continue
        if type(value) in PLAIN_NUMBERS and not shape and -INF < value < INF:
            continue
        if np.shape(value) != shape:
            raise _WrongOutput(f"{output_class.__name__}.{field}.shape = {np.shape(value)}", str(shape))
        if not _is_finite(value):
            raise _WrongOutput(f"{output_class.__name__}.{field} = {array_text(value)}", note("block.finite"))
        if shape and type(value) is not np.ndarray:
            checked_output = checked_output._replace(**{field: np.asarray(value, dtype=float)})
    return checked_output


def _is_finite(value: Value) -> bool:
    try:
        return bool(np.isrealobj(value) and np.isfinite(value).all())
    except TypeError:
        return False


def _value_text(value: object) -> str:
    if type(value) is tuple:
        return f"({', '.join('…' for _part in value)})"
    return "None" if value is None else type(value).__name__


def _block_figures(guard: GuardedBlock, error: BaseException | None = None) -> dict[str, str]:
    """Return the role of a block, its kind as in a vehicle file, and as `block` a text with its file and line.

    The line is the line of the error or, without an error, the first line of `step`.
    """
    frames = traceback.extract_tb(error.__traceback__) if error is not None else []
    block = _faulty_part(guard.block, {frame.filename for frame in frames})
    block_class: Tree = type(block)
    class_name, file_name = block_class.__name__, _step_file(block)
    block_text = f"{guard.role} {class_name}"
    if file_name is None:
        return {"role": guard.role, "kind": class_name, "block": block_text}
    line = block_class.step.__code__.co_firstlineno
    line_numbers = [
        frame.lineno for frame in frames if frame.filename == file_name and frame.lineno is not None
    ]
    shown_name = cell_name(file_name) or file_name
    place = f"{shown_name}:{line_numbers[-1] if line_numbers else line}"
    return {"role": guard.role, "kind": f"{shown_name}:{class_name}", "block": f"{block_text} ({place})"}


def _innermost_block(block: Tree) -> Tree:
    """Return the block inside a timed, limited or compiled block, which contains it as `block`."""
    while (inner_block := getattr(block, "block", None)) is not None:
        block = inner_block
    return block


def _faulty_part(block: Tree, files: Container[str | None]) -> Tree:
    """Return the innermost part of a block that is written in one of `files`; the block if no part is."""
    block = _innermost_block(block)
    parts = [_faulty_part(getattr(block, name), files) for name in optional.attribute(block, "inner_blocks")]
    return next((part for part in parts if _step_file(part) in files), block)


def _step_file(block: Tree) -> str | None:
    """Return the path of the file with the block's `step`; None if `step` is not Python code."""
    try:
        step: Tree = type(block).step
        return inspect.getfile(step) if step.__code__ else None
    except (AttributeError, TypeError):
        return None
