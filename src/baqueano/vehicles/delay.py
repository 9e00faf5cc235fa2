"""Delay signals: store past values, newest first, each with the duration δ_j of its tick.

A command u_j is sent for its tick and acts d later. From the beginning of the present tick it acts at

    b_0 = d,    b_j = b_{j−1} − δ_j                                                                       (1)

So three commands act during the tick, one after the other (more only if the ticks differ by a factor). The first is
u_k, the oldest one, with b_k ≤ 0 < b_{k−1}; then u_{k−1} acts from b_{k−1} on, and u_{k−2} from b_{k−2} on.

A signal h with the samples h_j, of age a_0 = 0, a_j = a_{j−1} + δ_{j−1}, is interpolated between two of them:

    h(a) = h_0 + Σ_j (h_j − h_{j−1}) clip((a − a_{j−1}) / (a_j − a_{j−1}), 0, 1)                          (2)

(1) and (2) are differentiable with respect to the delay, even for a fraction of a tick. (1) is exact for commands that
are constant during a tick. If the delay is longer than the stored past, the oldest value is used.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from baqueano.contracts.values import Value
from baqueano.errors import Invalid

MIN_TICK_S = 1e-9  # one count of the clock: the length used for a tick without duration
INITIAL_STEP_S = 1.0  # assumed duration of each past value before the first tick


class CommandSegment(NamedTuple):
    """A segment of a tick in which one command acts."""

    u: np.ndarray  # (n,)
    begin_s: Value  # from the beginning of the tick
    length_s: Value


def command_segments(
    u: np.ndarray, past_commands: np.ndarray, steps_s: np.ndarray, delay_s: Value, dt_s: Value
) -> list[CommandSegment]:
    """Return the segments of a tick of `dt_s` with the command that acts in each, in order.  (1)

    `u` (n,) is the command of this tick. `past_commands` (slots, n) are the earlier commands, which were sent for
    `steps_s` (slots,).
    """
    slots = past_commands.shape[0]
    if slots == 0:
        return [CommandSegment(u, 0.0, dt_s)]
    # two placeholders, which never act, come first
    values, begins_s = ([u, u, u, *past_commands], [dt_s, dt_s, delay_s])
    for step_s in steps_s[: slots - 1]:
        begins_s.append(begins_s[-1] - step_s)
    selection = values[-1], values[-2], values[-3], begins_s[-1], begins_s[-2]
    for k in range(slots - 1, -1, -1):
        is_active = begins_s[k + 2] <= 0.0
        next_selection = values[k + 2], values[k + 1], values[k], begins_s[k + 1], begins_s[k]
        selection = tuple(np.where(is_active, a, b) for a, b in zip(next_selection, selection, strict=True))
    first, second, third, second_begin_s, third_begin_s = selection
    first_end_s, second_end_s = np.clip(second_begin_s, 0.0, dt_s), np.clip(third_begin_s, 0.0, dt_s)
    pieces = [
        CommandSegment(first, 0.0, first_end_s),
        CommandSegment(second, first_end_s, second_end_s - first_end_s),
        CommandSegment(third, second_end_s, dt_s - second_end_s),
    ]
    return pieces[: slots + 1]


def delayed_value(
    newest_value: np.ndarray,
    line: np.ndarray,
    steps_s: np.ndarray,
    age_s: Value,
    subtract: Callable[[np.ndarray, np.ndarray], np.ndarray] = np.subtract,
) -> np.ndarray:
    """Return the value (m,) that the signal had `age_s` ago, interpolated between its samples.  (2)

    `line` (slots, m) are the samples before the `newest_value`. `steps_s` (slots,) is the time from each sample to the
    previous one, and `subtract` returns the difference of two samples.
    """
    value, previous, age = newest_value, newest_value, 0.0
    for k in range(line.shape[0]):
        step_s = np.maximum(steps_s[k], MIN_TICK_S)
        fraction = np.clip((age_s - age) / step_s, 0.0, 1.0)
        value = value + fraction * subtract(line[k], previous)
        previous, age = line[k], age + step_s
    return value


def with_newest_value(line: np.ndarray, newest_value: Value) -> np.ndarray:
    """Return the past values (slots, …) one tick later: `newest_value` is first, and the oldest value is removed."""
    if line.shape[0] == 0:
        return line
    first = np.stack([newest_value]) if line.ndim == 1 else newest_value[None, :]
    return np.concatenate([first, line[:-1]])


def check_delay(name: str, delay_s: float, delay_slots: int) -> None:
    """Raise Invalid for a delay above 0 without slots, or for a number of slots that is not an integer ≥ 0."""
    if not isinstance(delay_slots, int) or isinstance(delay_slots, bool) or delay_slots < 0:
        raise Invalid.of("delay.slots", name=name, value=repr(delay_slots))
    if delay_s > 0.0 and delay_slots == 0:
        raise Invalid.of("delay.no-slots", name=name, delay_s=delay_s, slots=int(np.ceil(delay_s * 100.0)))
