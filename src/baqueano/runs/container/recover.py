"""Write a cut or damaged run as a new, complete file: verified data are saved, the original is unchanged."""

from pathlib import Path
from typing import NamedTuple

from baqueano.diagnostics import Diagnostic
from baqueano.runs.container.reader import read_run
from baqueano.runs.container.writer import write_run
from baqueano.runs.folder import RECOVERED_SUFFIX
from baqueano.runs.run import Run


class RecoveredRun(NamedTuple):
    """The new file, and the run saved in this file."""

    path: Path
    run: Run
    notes: tuple[Diagnostic, ...]  # empty: the original was already complete


def recover(path: Path | str, to: Path | str | None = None) -> RecoveredRun:
    """Save the intact part of a cut or damaged run in a new file; the original is unchanged.

    Parameters
    ----------
    path : path
        The damaged file.
    to : path, optional
        The new file; by default `NAME-recovered.mcap` next to the damaged file.

    Returns
    -------
    RecoveredRun
        The new file, and its run with notes on the losses.

    Raises
    ------
    FileError
        If the file is unreadable, or the new file exists.

    Examples
    --------
    >>> from baqueano.runs import write_run
    >>> whole = write_run(Run("still", None, np.arange(3), np.zeros((3, 1))), "whole.mcap")
    >>> recover(whole).path.name, recover(whole, "again.mcap").notes
    ('whole-recovered.mcap', ())
    """
    path = Path(path)
    run = read_run(path)
    target = Path(to) if to is not None else path.with_name(f"{path.stem}{RECOVERED_SUFFIX}.mcap")
    if run.notes:
        run.metadata["recovered_from"] = path.name
    return RecoveredRun(write_run(run, target), run, run.notes)
