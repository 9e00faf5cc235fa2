"""Recordings that others made of real vehicles: the findings in each, and the bar for them.

Each module of `recorded` knows one recording: it imports it by a map and fits a vehicle file of guesses to one part of
it. It judges the fit on another part. The recordings do not come with the package: they are read from the folder
BAQUEANO_DATA, else from ../shared/data; what is not there is left out, and named.
"""

import glob
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING

from baqueano.diagnostics import Verdict, fault
from baqueano.errors import FileError
from baqueano.language import number
from baqueano.language import translated as _
from baqueano.runs.maps.column_map import data_folders, load_map

if TYPE_CHECKING:
    from baqueano.contracts.values import JsonObject, TableRow

MAPS = ("cpm_run_a", "cpm_run_b")
RECORDED = ("cpm", "dart", "micromouse", "mpu6050", "warthog")


@dataclass(frozen=True, slots=True)
class RecordingStudy:
    """The results on all recordings."""

    each: tuple["JsonObject", ...]
    left_out: tuple[str, ...]  # sentences on recordings that are not there
    stopped: bool = False  # from the keyboard, before all were judged

    def rows(self) -> list["TableRow"]:
        """recording, quantity, value, bar, ok."""
        return list(self.each)

    @property
    def reasons(self) -> tuple[str, ...]:
        """The bars that are missed."""
        return tuple(
            _(
                "{recording}: {quantity} is {value}",
                recording=r["recording"],
                quantity=r["quantity"],
                value=cell_text(r["value"]),
            )
            for r in self.each
            if not r["ok"]
        )

    @property
    def verdict(self) -> Verdict:
        """WARN where a bar is missed or a recording is not there."""
        return Verdict.WARN if self.reasons or self.left_out else Verdict.USABLE

    def table(self) -> str:
        """Return the table as text."""
        width = max((len(r["quantity"]) for r in self.each), default=0)
        lines = [f"{_('recording'):20} {_('quantity'):{width}}  {_('ok'):3}  {_('bar'):26} {_('value')}"]
        for r in self.each:
            ok = _("yes") if r["ok"] else _("NO")
            lines.append(
                f"{r['recording']:20} {r['quantity']:{width}}  {ok:3}  {r['bar']:26} {cell_text(r['value'])}"
            )
        lines += self.left_out
        passes = sum(bool(r["ok"]) for r in self.each)
        return "\n".join(
            [
                *lines,
                _(
                    "{verdict}: {met} of {all} bars are met",
                    verdict=_(self.verdict),
                    met=passes,
                    all=len(self.each),
                ),
            ]
        )


def recordings(
    backend: str = "auto", say: Callable[[str], object] = lambda text: None, names: Sequence[str] = RECORDED
) -> RecordingStudy:
    """Return the results of all recordings; after Ctrl-C those before it. FileError, with the names of the files,
    where none is."""
    rows, left_out = [], []
    for name in names:
        module = import_module(f"baqueano.study.recorded.{name}")
        missing = missing_of(getattr(module, "files", lambda: files_of(MAPS))())
        if missing:
            left_out.append(
                _(
                    "{name} is left out: {missing} is missing; set BAQUEANO_DATA to its folder",
                    name=name,
                    missing=missing[0],
                )
            )
        else:
            try:
                rows += module.rows(say, backend)
            except KeyboardInterrupt:
                if not rows:
                    raise
                last = _("stopped from the keyboard: {name} and what follows are left out", name=name)
                return RecordingStudy(tuple(rows), (*left_out, last), stopped=True)
    if not rows:
        check_present()
    return RecordingStudy(tuple(rows), tuple(left_out))


def files_of(maps: Sequence[str]) -> list[str]:
    """The files that the maps ask for."""
    return sorted({spec.path for name in maps for spec in load_map(name).files.values() if spec.path})


def missing_of(paths: Sequence[str]) -> list[str]:
    """Return the missing ones in all folders of recordings; a name may have *."""
    folders = data_folders()
    return [path for path in paths if not any(glob.glob(str(folder / path)) for folder in folders)]


def check_present() -> None:
    """FileError that names the files of the CPM µCar that no folder holds."""
    missing = missing_of(files_of(MAPS))
    if missing:
        raise FileError(
            fault(
                "study.recordings-missing",
                missing=missing,
                folders=" or ".join(map(str, data_folders())),
                first=missing[0].partition("/")[0],
            )
        )


def cell_text(value: object) -> str:
    """A value of a row as text."""
    if isinstance(value, bool):
        return _("yes") if value else _("no")
    return f"{number(value):.4g}" if isinstance(value, float) else str(value)
