"""List the runs of a folder, a line for each file, as `baqueano runs ls` does."""

import re
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from baqueano.contracts.values import TableRow
from baqueano.errors import BaqueanoError, FileError
from baqueano.messages import text
from baqueano.messages.language import number, translate as _
from baqueano.messages.printable import join_rows
from baqueano.messages.text_table import text_table
from baqueano.runs.container.reader import read_run
from baqueano.runs.folder import number_and_name, run_number


class ListedRun(NamedTuple):
    """A line of `runs ls`."""

    number: int | None
    name: str
    kind: str
    duration_s: float | None
    vehicle: str
    verdict: str
    notes: str


def listing(folder: Path | str = "runs") -> list[ListedRun]:
    """Return all runs of a folder, sorted by number and name, with the fault of each file that is not a run.
    Raise FileError if the folder does not exist.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise FileError.of("runs.no-folder", "baqueano experiment", folder=folder)
    paths = sorted(folder.glob("*.mcap"), key=number_and_name)
    return [_listed_run(path) for path in paths]


def _listed_run(path: Path) -> ListedRun:
    try:
        run = read_run(path)
    except BaqueanoError as error:
        reason = replace(error.diagnostic, figures={**error.diagnostic.figures, "path": path.name})
        return ListedRun(run_number(path), path.stem, "?", None, "", "UNREADABLE", text(reason))
    verdict = run.metadata.get("verdict", "")
    notes = [run.metadata["note"]] if run.metadata.get("note") else []  # of older versions
    if source := run.metadata.get("recovered_from"):
        notes.append(_("recovered from {file}", file=source))
    severe_events = [event for event in run.events if event.level in ("error", "fatal")]
    if severe_events:
        notes.append(severe_events[0].sentence)
    if run.notes:
        verdict, notes = verdict or "RECOVERED", [*notes, text(run.notes[0])]
    return ListedRun(
        run_number(path), run.name, run.metadata.get("kind", ""), run.duration_s,
        vehicle_name(run.vehicle_text), verdict, "; ".join(notes),
    )  # fmt: skip


def vehicle_name(vehicle_text: str) -> str:
    """Return the name in the text of a vehicle file, or "" without a name."""
    match = re.search(r'^name\s*=\s*(?:"([^"]*)"|\'([^\']*)\')', vehicle_text, re.MULTILINE)
    return (match[1] or match[2] or "") if match else ""


def listing_table(rows: list[ListedRun]) -> str:
    """Return the table of runs, one line per run."""
    head = list(map(_, ("run", "kind", "duration", "vehicle", "verdict", "notes")))
    lines = [
        (
            r.name,
            _(r.kind),
            "" if r.duration_s is None else f"{number(r.duration_s):.1f} s",
            r.vehicle,
            _(r.verdict),
            r.notes,
        )
        for r in rows
    ]
    last = max((k for line in lines for k, entry in enumerate(line) if entry), default=len(head) - 1) + 1
    # no empty last column
    return join_rows(text_table("<" * last, head[:last], *(line[:last] for line in lines)))


def listing_rows(rows: list[ListedRun]) -> list[TableRow]:
    """Return the runs as flat dicts for --json; an unknown value is None."""
    return [{key: value if value != "" else None for key, value in row._asdict().items()} for row in rows]
