"""Integrate n vehicles by Runge-Kutta at 1 kHz; each vehicle has its own command delay.

A command that is sent at t takes effect from t + d on, with the delay d. A step of a vehicle ends at this time. So the
force inside a step is smooth, and only the method causes an integration error.
"""

from collections.abc import Callable

import numpy as np

STEP_S = 1e-3
MIN_STEP_S = 1e-9  # a remainder of a step below this is rounding
STORED_COMMANDS = 50  # number of latest commands that are stored


class CommandDelayLine:
    """A delay line for the commands of n vehicles, with the delays `delay_s` (n,)."""

    def __init__(self, delay_s: np.ndarray, commands: int) -> None:
        self._delay_s, self._indices = delay_s, np.arange(len(delay_s))
        # when each of the last commands was sent; at the end infinity, as no next command is known
        self._sent_s = np.append(np.full(STORED_COMMANDS, -np.inf), np.inf)
        self._commands = np.zeros((STORED_COMMANDS, len(delay_s), commands))

    def send(self, t_s: float, u: np.ndarray) -> None:
        """Store the commands u (n, m), which are sent at `t_s` and valid until the next commands are sent."""
        self._sent_s[:-2], self._sent_s[-2] = self._sent_s[1:-1].copy(), t_s
        self._commands = np.concatenate([self._commands[1:], np.array(u, dtype=float)[None]])

    def effective_commands(self, t_s: np.ndarray) -> np.ndarray:
        """Return the commands (n, m) in effect at `t_s` (n,)."""
        return self._commands[self._sent_s.searchsorted(t_s - self._delay_s, side="right") - 1, self._indices]

    def current_commands(self, t_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the commands (n, m) from `t_s` (n,) on, and the time (n,) [s] when others take effect, or infinity."""
        next_index = self._sent_s.searchsorted(t_s + MIN_STEP_S - self._delay_s, side="right")
        return self._commands[next_index - 1, self._indices], self._sent_s[next_index] + self._delay_s


def integrate(
    step: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray],
    x: np.ndarray,
    span_s: tuple[float, float],
    line: CommandDelayLine,
    impulse: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None,
    step_s: float = STEP_S,
) -> np.ndarray:
    """Return the states (n, k) at the end of the span.

    `step` takes states, commands in effect (n, m) and lengths of the steps (n, 1) [s], and returns the next states.
    `impulse` takes the states at the end of a step and its lengths (n,) [s].
    It returns these states with the kicks of a rough floor.
    """
    t_s, end = np.full(len(x), span_s[0]), span_s[1]
    while (t_s < end).any():
        u, next_s = line.current_commands(t_s)
        stop = np.minimum(t_s + step_s, next_s)
        stop = np.where(stop > end - MIN_STEP_S, end, stop)
        h = stop - t_s
        x = step(x, u, h[:, None])
        t_s = stop
        if impulse is not None:
            x = impulse(x, h)
    return x


def runge_kutta(f: Callable[[np.ndarray], np.ndarray], x: np.ndarray, h: np.ndarray) -> np.ndarray:
    """Return the states (n, k) after the time steps h (n, 1), with dx/dt = f(x)."""
    a = f(x)
    b = f(x + 0.5 * h * a)
    c = f(x + 0.5 * h * b)
    return x + h / 6.0 * (a + 2.0 * b + 2.0 * c + f(x + h * c))
