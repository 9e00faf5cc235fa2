"""Print text for people and data for programs: results on stdout, messages on stderr, in any encoding.

A control character in the text of a robot or a file is printed as its code (printable.py).
"""

import codecs
import errno
import os
import shutil
import signal
import stat
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from types import FrameType
from typing import Any, TextIO

import click

from baqueano.contracts.values import JsonObject, TableRow
from baqueano.diagnostics import Diagnostic, note
from baqueano.messages import json_row, text
from baqueano.messages.language import number
from baqueano.messages.printable import one_line, printable

printed_objects: list[str] = []  # JSON that this command printed; it prints at most one object
PROGRESS_PERIOD_S = 30.0  # seconds between the progress lines of work without a terminal
_LETTERS = {
    "α": "alpha", "β": "beta", "γ": "gamma", "δ": "delta", "η": "eta", "μ": "mu", "ν": "nu", "π": "pi",
    "ρ": "rho", "σ": "sigma", "Σ": "Sigma", "τ": "tau", "φ": "phi", "χ": "chi", "ψ": "psi", "ω": "omega",
    "ẋ": "x_dot", "ν̇": "nu_dot", "≤": "<=", "≥": ">=", "→": "->", "−": "-", "×": "x", "·": "*", "²": "^2",
    "³": "^3", "±": "+-", "°": " deg", "√": "sqrt ", "∞": "inf", "…": "...", "✓": "ok", "–": "-", "‖": "|",
    "₁": "1", "₂": "2", "₃": "3", "⁻": "^-", "¹": "1", "̇": "_dot", "Δ": "Delta", "≈": "~",
}  # fmt: skip


def _ascii_spelling(error: UnicodeError) -> tuple[str, int]:
    assert isinstance(error, UnicodeEncodeError)
    characters = error.object[error.start : error.end]
    return "".join(_LETTERS.get(c, "?") for c in characters), error.end


def replace_unprintable_letters(*streams: TextIO) -> None:
    """Replace characters that the terminal's encoding does not contain, such as ψ by psi, so that printing does
    not fail."""
    codecs.register_error("baqueano", _ascii_spelling)
    for stream in streams:
        reconfigure = getattr(stream, "reconfigure", None)
        if reconfigure is not None:
            reconfigure(errors="baqueano")


def print_message(message: Diagnostic | str) -> None:
    """Print a line on stderr for the user who waits; the line is not part of the result."""
    _print(text(message), sys.stderr)


def print_result(message: Diagnostic | str) -> None:
    """Print a result on stdout. The work continues if its reader has ended (`| head`, a terminal that hung up)."""
    _print(text(message), sys.stdout)


def _print(line: str, stream: TextIO) -> None:
    try:
        click.echo(_wrap_lines(stream, printable(line)), file=stream)
        if stream is not None:
            stream.flush()
    except OSError as error:
        hung_up = error.errno == errno.EIO and stat.S_ISCHR(os.fstat(stream.fileno()).st_mode)
        if not hung_up and error.errno not in (errno.EPIPE, errno.EINVAL):  # EINVAL: Windows' word for it
            raise
        null_file = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null_file, stream.fileno())
        os.close(null_file)


def _wrap_lines(stream: TextIO, lines: str) -> str:
    """Return sentences wrapped at words for the width of a terminal. Tables, commands and JSON stay unchanged."""
    if stream is None or not stream.isatty() or lines.startswith("{"):
        return lines
    columns, line_list = shutil.get_terminal_size().columns, lines.split("\n")
    if max(map(len, line_list)) <= columns:
        return lines
    from baqueano.contracts.result import wrap_sentences

    return "\n".join(
        part
        for line in line_list
        for part in (
            wrap_sentences([line], columns) if len(line) > columns and "  " not in line.strip() else [line]
        )
    )


def print_answer(
    result: Any, as_json: bool, tail: list[TableRow] | None = None, table: str | None = None,
    **more_rows: list[TableRow],
) -> None:  # fmt: skip
    """Print a result: its table, or another `table`, for people, or one JSON object for programs.

    The object contains `rows` (of the result, then `tail`), `verdict`, `reasons` if the result has them, and the rows
    `beside`, each list under its name.
    """
    if not as_json:
        print_result(result.table() if table is None else table)
        return
    import json

    reply = {"rows": [_finite_row(row) for row in [*result.rows(), *(tail or [])]], "verdict": result.verdict}
    if hasattr(result, "reasons"):
        reply["reasons"] = [
            json_row(reason) if isinstance(reason, Diagnostic) else reason for reason in result.reasons
        ]
    reply |= {name: list(map(_finite_row, rows)) for name, rows in more_rows.items()}
    printed_objects.append(json.dumps(reply, allow_nan=False))
    print_result(printed_objects[-1])


def _finite_row(row: TableRow) -> JsonObject:
    """Return a row with Python numbers instead of NumPy numbers.
    NaN and infinity become null, because JSON does not have them.
    """
    import numpy as np

    def finite_value(value: object) -> Any:
        if isinstance(value, np.generic):
            value = value.item()
        if isinstance(value, np.ndarray | list | tuple):
            return [finite_value(v) for v in value]
        if isinstance(value, float) and not np.isfinite(value):
            return None
        return value

    return {name: finite_value(value) for name, value in row.items()}


def is_terminal() -> bool:
    """Return True if stderr is a terminal."""
    return sys.stderr is not None and sys.stderr.isatty()


@contextmanager
def show_progress(label: Diagnostic | str, length: int) -> Iterator[Callable[[int], None]]:
    """Show a progress bar on stderr for long work, if stderr is a terminal. Yield the function advance(n)."""
    if not is_terminal():
        yield lambda n: None
        return
    with click.progressbar(length=length, label=text(label), file=sys.stderr, width=30) as bar:

        def advance(n: int) -> None:
            if bar.pos == 0:  # the preparation, such as the compilation of a filter, is done only once
                bar.start = bar.last_eta = time.time()
            bar.update(n)

        yield advance


@contextmanager
def show_time_progress(label: Diagnostic | str, duration_s: float) -> Iterator[Callable[[float], None]]:
    """Show a bar on stderr that follows the time of a run [s]; `duration_s` is 0 for an unknown end. Yield
    show(t_s)."""
    progress_tenths = 0
    if duration_s <= 0.0:
        yield (
            lambda t_s: (
                _rewrite(text(note("cli.elapsed-time", label=label, t_s=t_s))) if is_terminal() else None
            )
        )
        _rewrite("")
        return

    def show(t_s: float) -> None:
        nonlocal progress_tenths
        advance(max(0, round(10 * t_s) - progress_tenths))
        progress_tenths = max(progress_tenths, round(10 * t_s))

    with show_progress(label, max(1, round(10 * duration_s))) as advance:
        yield show
        show(duration_s)


def real_time_display(show: Callable[[float], None]) -> Callable[[float], None]:
    """Return a function that shows the time of a run [s] and then waits until as much time has passed on the clock."""
    start_s = time.monotonic()

    def wait(t_s: float) -> None:
        show(t_s)
        time.sleep(max(0.0, t_s - (time.monotonic() - start_s)))

    return wait


class ProgressLine:
    """A function that replaces the previous progress report. It returns True after the user has pressed Ctrl-C.

    After the first call, Ctrl-C requests the result so far. A second Ctrl-C ends the work at once.
    """

    def __init__(self) -> None:
        self.text, self.stopped = "", False
        self._previous_handler: Any = None

    def __call__(self, message: Diagnostic | str) -> bool:
        if not self.stopped:
            self.text = text(message)
        from baqueano.drive.interrupt import is_default_handler

        if self._previous_handler is None and is_default_handler():
            self._previous_handler = signal.signal(signal.SIGINT, self._stop)
        return self.stopped

    def _stop(self, number: int, frame: FrameType | None) -> None:
        self.stopped, self.text = True, text(note("cli.ending"))
        signal.signal(signal.SIGINT, signal.default_int_handler)
        if not is_terminal():
            print_message(self.text)

    def done(self) -> None:
        """Restore the previous handler of Ctrl-C."""
        if self._previous_handler is not None:
            signal.signal(signal.SIGINT, self._previous_handler)


@contextmanager
def show_activity(label: Diagnostic | str, is_delayed: bool = False) -> Iterator[ProgressLine]:
    """Show a line on stderr for work of unknown duration. Yield a function that prints a text.

    On a terminal it counts the seconds, and shows the progress of the work. Otherwise a line is printed
    every PROGRESS_PERIOD_S. Nothing is shown about work that is often quick, until the first of these times.
    """
    status, person, label = ProgressLine(), is_terminal(), text(label)
    start_s, end_event = time.monotonic(), threading.Event()

    def count() -> None:
        nonlocal is_shown
        while not end_event.wait(0.5 if person else PROGRESS_PERIOD_S):
            suffix = f"  {status.text}" if status.text else ""
            line = f"{label}  {time.monotonic() - start_s:.0f} s{suffix}"
            _rewrite(line) if person else print_message(line)
            is_shown = True

    is_shown = not is_delayed
    if is_shown:
        _rewrite(label) if person else print_message(label)
    count_thread = threading.Thread(target=count, daemon=True)
    count_thread.start()
    try:
        yield status
    finally:
        end_event.set()
        count_thread.join()
        status.done()
        if is_shown:
            _rewrite(f"{label}  {number(time.monotonic() - start_s):.1f} s\n")


@contextmanager
def show_steps() -> Iterator[Callable[[Diagnostic | str], ProgressLine]]:
    """Show a line on stderr for each step of the work. Yield begin(label), which returns the line of the step."""
    with ExitStack() as step:

        def begin(label: Diagnostic | str) -> ProgressLine:
            step.close()
            return step.enter_context(show_activity(label))

        yield begin


def _rewrite(line: str) -> None:
    """Replace the previous line on a terminal by `line`, cut to the terminal's width."""
    if is_terminal():
        import shutil  # this import loads bz2 and lzma, which would delay --help

        width = max(20, shutil.get_terminal_size((100, 24)).columns - 1)
        visible = one_line(line.removesuffix("\n"))[:width]
        click.echo(f"\r{visible:<{width}}" + "\n" * line.endswith("\n"), nl=False, err=True)
