"""A cut or damaged run written anew, whole: what could be verified is saved, the original stays as it is."""

from pathlib import Path
from typing import NamedTuple

from baqueano.runs.container.reader import read_run
from baqueano.runs.container.writer import write_run
from baqueano.runs.folder import RECOVERED
from baqueano.runs.run import Run


class Recovered(NamedTuple):
    """The new file and what was saved in it."""

    path: Path
    run: Run
    notes: tuple[str, ...]  # empty: the original was whole already


def recover(path: Path | str, to: Path | str | None = None) -> Recovered:
    """Saves what is whole of `path` in `to`, by default `NAME-recovered.mcap` beside it. FileError where nothing is
    left of it, or `to` is there already."""
    path = Path(path)
    run = read_run(path)
    target = Path(to) if to is not None else path.with_name(f"{path.stem}{RECOVERED}.mcap")
    if run.notes:
        run.metadata["note"] = "recovered from " + path.name
    return Recovered(write_run(run, target), run, run.notes)
