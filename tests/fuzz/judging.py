"""The judge of an input: a baqueano error with its code, or a value, within 10 s; everything else is a finding."""

import signal
import threading
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from baqueano.errors import BaqueanoError, ExternalError

LONGEST_S = 10.0
SHOWN = 6


class Hang(ExternalError):
    """An input takes longer than LONGEST_S."""


class Silent(Exception):
    """A file with a checksum reads differently from its original without any report."""


@dataclass
class Outcome:
    """The results of the inputs of one format."""

    values: int = 0
    errors: Counter[str] = field(default_factory=Counter)  # by code
    findings: dict[str, list[int]] = field(default_factory=dict)  # the finding, and the numbers of its inputs
    slowest_s: float = 0.0

    @property
    def table(self) -> str:
        """Return the counts in a line, and below them the findings."""
        head = f"{self.values} values, {sum(self.errors.values())} errors of {len(self.errors)} codes"
        lines = [f"{head}, slowest {self.slowest_s:.2f} s"]
        lines += [f"{len(k)} × {name}; inputs {k[:SHOWN]}" for name, k in self.findings.items()]
        return "\n".join(lines)


@contextmanager
def within(limit_s: float) -> Iterator[None]:
    """Raise Hang if the block takes longer; only in a main thread of a system with such a timer."""
    if not hasattr(signal, "setitimer") or threading.current_thread() is not threading.main_thread():
        yield
        return

    def ring(number: int, frame: object) -> None:
        raise Hang

    before = signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, limit_s)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def judge(read_mutant: Callable[[int], object], numbers: Iterable[int]) -> Outcome:
    """Return the outcome of the inputs with these numbers."""
    outcome = Outcome()
    for number in numbers:
        start_s = time.perf_counter()
        try:
            with within(LONGEST_S):
                read_mutant(number)
            outcome.values += 1
        except BaqueanoError as error:
            outcome.errors[str(error.diagnostic.code)] += 1
            if error.diagnostic.code.startswith("error."):
                outcome.findings.setdefault(f"an error without a code: {error!r}", []).append(number)
        except (Exception, Hang) as error:
            last = traceback.extract_tb(error.__traceback__)[-1]
            cause = f"{type(error).__name__} at {Path(last.filename).name}:{last.lineno}: {str(error)[:200]}"
            outcome.findings.setdefault(cause if not isinstance(error, Hang) else "hang", []).append(number)
        outcome.slowest_s = max(outcome.slowest_s, time.perf_counter() - start_s)
    return outcome
