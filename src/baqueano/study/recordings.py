"""Evaluate fits on recordings of real vehicles by other authors, and compare the results with criteria.

Each module of `recorded` imports one recording by a map. It fits a vehicle file of guesses to one part, and evaluates
the fit on another part. The package does not contain the recordings: they are read from the folder BAQUEANO_DATA, else
from ../shared/data. A missing recording is skipped, and reported.
"""

import glob
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from baqueano.contracts.result import Result
from baqueano.contracts.values import JsonObject, TableRow
from baqueano.diagnostics import Verdict
from baqueano.errors import FileError
from baqueano.messages.language import mark as N_, number, translate as _
from baqueano.messages.text_table import text_table
from baqueano.runs.maps.column_map import data_folders, load_map

CPM_MAPS = ("cpm_run_a", "cpm_run_b")
STUDIES = ("cpm", "dart", "micromouse", "mpu6050", "warthog")


@dataclass(frozen=True, slots=True)
class RecordingStudy(Result):
    """The results of the fits on all recordings."""

    result_rows: tuple[JsonObject, ...]
    missing_recordings: tuple[str, ...]  # sentences on missing recordings
    is_interrupted: bool = False  # True after Ctrl-C, before all recordings were evaluated

    def rows(self) -> list[TableRow]:
        """Return the rows of all recordings, with recording, quantity, value, criterion and ok."""
        return list(self.result_rows)

    @property
    def reasons(self) -> tuple[str, ...]:
        """Return a sentence for each criterion that is not met."""
        misses = (r | {"value": cell_text(r["value"])} for r in self.result_rows if not r["ok"])
        return tuple(_("{recording}: {quantity} is {value}", **r) for r in misses)

    @property
    def verdict(self) -> Verdict:
        """Return WARN if a criterion is not met or a recording is missing, else USABLE."""
        return Verdict.WARN if self.reasons or self.missing_recordings else Verdict.USABLE

    def table(self) -> str:
        """Return the rows, the missing recordings and the verdict as a text table."""
        head = [_("recording"), _("quantity"), _("ok"), _("criterion"), _("value")]
        rows = (
            [r["recording"], r["quantity"], _("yes") if r["ok"] else _("NO"), r["bar"], cell_text(r["value"])]
            for r in self.result_rows
        )
        lines = text_table("<<<<<", head, *rows)
        lines += self.missing_recordings
        passes = sum(bool(r["ok"]) for r in self.result_rows)
        figures = {"verdict": _(self.verdict), "met": passes, "all": len(self.result_rows)}
        return "\n".join([*lines, _("{verdict}: {met} of {all} requirements are met", **figures)])


def recordings(
    backend: str = "auto",
    progress: Callable[[str], object] = lambda text: None,
    names: Sequence[str] = STUDIES,
) -> RecordingStudy:
    """Return the results of the recordings `names`; after Ctrl-C only the finished results.
    Without any result, raise FileError with the names of the missing files of the CPM µCar.
    """
    rows, left_out = [], []
    for name in names:
        module = import_module(f"baqueano.study.recorded.{name}")
        missing_files = missing_paths(getattr(module, "files", lambda: map_files(CPM_MAPS))())
        if missing_files:
            left_out.append(exclusion_sentence(name, missing_files))
        else:
            try:
                rows += module.rows(progress, backend)
            except KeyboardInterrupt:
                if not rows:
                    raise
                stopped_note = _(
                    "stopped from the keyboard: {name} and all later results are excluded", name=name
                )
                return RecordingStudy(tuple(rows), (*left_out, stopped_note), is_interrupted=True)
    if not rows:
        check_cpm_present()
    return RecordingStudy(tuple(rows), tuple(left_out))


def map_files(maps: Sequence[str]) -> list[str]:
    """Return the files that the maps require."""
    return sorted({spec.path for name in maps for spec in load_map(name).files.values() if spec.path})


def missing_paths(paths: Sequence[str]) -> list[str]:
    """Return the paths that the folders of recordings do not contain; a path may contain the wildcard *."""
    folders = data_folders()
    return [path for path in paths if not any(glob.glob(str(folder / path)) for folder in folders)]


def recorded_path(name: str) -> Path:
    """Return the first path with this name in a folder of recordings; it must exist."""
    return next(path for folder in data_folders() if (path := folder / name).exists())


def exclusion_sentence(name: str, missing_files: Sequence[str]) -> str:
    """Return the sentence on recordings that a study excludes, because these files are missing."""
    sentence = N_("{name} is excluded: {missing} is missing; set BAQUEANO_DATA to its folder")
    return _(sentence, name=name, missing=missing_files[0])


def check_cpm_present() -> None:
    """Raise FileError with the names of the missing files of the CPM µCar, if any."""
    missing_files = missing_paths(map_files(CPM_MAPS))
    if missing_files:
        raise FileError.of(
            "study.recordings-missing",
            recordings=missing_files,
            folders=" or ".join(map(str, data_folders())),
            first=missing_files[0].partition("/")[0],
        )


def cell_text(value: object) -> str:
    """Return a value of a row as text."""
    if isinstance(value, bool):
        return _("yes") if value else _("no")
    return f"{number(value):.4g}" if isinstance(value, float) else str(value)
