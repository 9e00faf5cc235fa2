"""Run the loop: measure → estimate → guide → control → supervise → act.

`step` is pure: from the blocks, their states and a tick it computes new states and a record. The clocked loop below, a
simulation in one kernel and the tuning of gains all call this function.
"""

from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

import numpy as np

from baqueano.contracts.blocks import Controller, Estimator, Guide, Supervision, World
from baqueano.contracts.values import Tree
from baqueano.diagnostics import Diagnostic, StopReason, stop
from baqueano.monitor.findings import Finding
from baqueano.signals import Command, Estimate, Reference, Tick, seconds
from baqueano.supervisor import BlockFault, FallbackBlock, guard_block, stop_reason


class Blocks(NamedTuple):
    """The four blocks of a loop: estimator, guide, controller and supervisor."""

    estimator: Estimator
    guide: Guide
    controller: Controller
    supervisor: Supervision


class States(NamedTuple):
    """The states of the four blocks, in the order of `Blocks`."""

    estimator: Tree
    guide: Tree
    controller: Tree
    supervisor: Tree


class Record(NamedTuple):
    """The record of a tick. `tick.u` is the command that acted before the tick, `sent_command` the command after it."""

    tick: Tick
    requested_command: Command  # by the controller
    sent_command: Command  # by the supervisor, to the motors
    estimate: Estimate
    reference: Reference
    sensor_findings: tuple[Finding, ...] = ()  # on sensors that have been wrong for a long time
    states: States | None = None  # of the blocks after the tick, in the clocked loop; not in a run


def init(blocks: Blocks, eta: np.ndarray | None = None) -> States:
    """Return the states at the start; `eta` starts the estimator: pose (3,), pose and velocity (6,), or None."""
    start = () if eta is None else (eta,) if len(eta) == 3 else (eta[:3], eta[3:])
    belief = blocks.estimator.init(*start)
    return States(belief, blocks.guide.init(), blocks.controller.init(), blocks.supervisor.init())


def step(blocks: Blocks, states: States, tick: Tick) -> tuple[States, Record]:
    """Return the states after a tick through all blocks, and the record of the tick."""
    belief, estimate = blocks.estimator.step(states.estimator, tick)
    guide, reference = blocks.guide.step(states.guide, estimate)
    controller, requested_command = blocks.controller.step(states.controller, reference, estimate)
    supervisor, command = blocks.supervisor.step(states.supervisor, requested_command, tick, estimate)
    return States(belief, guide, controller, supervisor), Record(
        tick, requested_command, command, estimate, reference
    )


class Outcome(NamedTuple):
    """The end of a run of the loop: the reason of a stop, the guide's end, and the number of ticks."""

    stop_reason: Diagnostic | None  # None if the motors were not stopped
    at_end: bool  # True if the guide reached its end
    ticks: int


ROLL_OUT_S = 1.0  # a stopped vehicle is recorded for this time, because it still rolls


def run(
    blocks: Blocks,
    world: World,
    clock: Iterable[int],
    on_record: Callable[[Record], None] = lambda record: None,
    on_event: Callable[[int, Diagnostic], None] = lambda t_ns, reason: None,
    eta: np.ndarray | None = None,
) -> Outcome:
    """Run the clocked loop over a world. The last command is always zero.

    After a fault of a block or a stop by the supervisor the command stays zero; the reason names a faulty block. The
    loop then records for ROLL_OUT_S and ends. `eta` (3,) is the pose at the start, in the map.
    """
    n = world.commands
    blocks = Blocks(*(guard_block(role, b, n) for role, b in zip(Blocks._fields, blocks, strict=True)))
    end_reason: Diagnostic | None = None
    since_ns, at_end, ticks, t_ns = 0, False, 0, 0
    try:
        for record, reason in _records(blocks, world, clock, eta):
            ticks, t_ns = ticks + 1, record.tick.t_ns
            on_record(record)
            if reason is not None and end_reason is None:
                end_reason, since_ns = reason, t_ns
                on_event(t_ns, reason)
            at_end = bool(record.reference.at_end > 0.0)
            if at_end or (end_reason is not None and seconds(t_ns, since_ns) >= ROLL_OUT_S):
                break
    except BlockFault as fault:  # in init, before any motion
        end_reason = fault.reason
        on_event(t_ns, end_reason)
    except KeyboardInterrupt:
        end_reason = stop(StopReason.INTERRUPTED)
        on_event(t_ns, end_reason)
    finally:
        world.write(Command(t_ns, np.zeros(n)))
    return Outcome(end_reason, at_end and end_reason is None, ticks)


def _records(
    blocks: Blocks, world: World, clock: Iterable[int], eta: np.ndarray | None
) -> Iterator[tuple[Record, Diagnostic | None]]:
    """Yield the record of every tick, and the reason why the motors are stopped; None while they are allowed to run."""
    states = init(blocks, eta)
    for t_ns in clock:
        records = []
        for tick in world.read(t_ns):
            blocks, states, record, reason = careful_step(blocks, states, tick)
            records.append((record, reason))
        if records:
            world.write(records[-1][0].sent_command)  # first act, then record
        yield from records


def careful_step(
    blocks: Blocks, states: States, tick: Tick
) -> tuple[Blocks, States, Record, Diagnostic | None]:
    """Return the blocks, the states and the record after `step`, and the reason of a stop; None without a stop.

    After a fault, blocks with a zero command replace guide, controller and supervisor. The estimator is replaced only
    if it caused the fault.
    """
    try:
        states, record = step(blocks, states, tick)
    except BlockFault as fault:
        roles = {fault.role, "guide", "controller", "supervisor"}
        blocks = Blocks(
            *(FallbackBlock(r, len(tick.u)) if r in roles else b for r, b in blocks._asdict().items())
        )
        states = States(*(None if r in roles else s for r, s in states._asdict().items()))
        return *careful_step(blocks, states, tick)[:3], fault.reason
    return blocks, states, record._replace(states=states), stop_reason(states.supervisor)
