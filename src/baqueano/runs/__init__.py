"""Write, read, recover, cut, list, import and export runs on disk.

The code that records a drive is imported here; the other modules are imported when they are first used.

run            the run in memory;  folder, show, export, route_file: operations on it
container/     its MCAP file, and the recovery of a damaged one
importing/     recordings of other tools, by a map of maps/, from tables/, checked by diagnostics/
"""

from typing import TYPE_CHECKING

from baqueano.on_demand import on_demand
from baqueano.runs.container.reader import read_run
from baqueano.runs.container.recover import recover
from baqueano.runs.container.writer import RunWriter, write_run
from baqueano.runs.run import Channel, EstimateLog, Event, ReferenceLog, Run, TruthLog
from baqueano.runs.show import show

if TYPE_CHECKING:
    from baqueano.runs.export import export_csv, export_tum
    from baqueano.runs.folder import find
    from baqueano.runs.folder_listing import listing
    from baqueano.runs.importing import ImportedRun, import_run, import_runs
    from baqueano.runs.importing.draft import draft_map
    from baqueano.runs.route_file import read_route, write_route

__all__ = [
    "Channel",
    "EstimateLog",
    "Event",
    "ReferenceLog",
    "Run",
    "TruthLog",
    "draft_map",
    "export_csv",
    "export_tum",
    "import_run",
    "read_route",
    "read_run",
    "recover",
    "write_route",
    "write_run",
]

__getattr__ = on_demand(
    __name__,
    {
        "export": ("export_csv", "export_tum"),
        "folder": ("find",),
        "importing.draft": ("draft_map",),
        "importing": ("ImportedRun", "import_run", "import_runs"),
        "folder_listing": ("listing",),
        "route_file": ("read_route", "write_route"),
    },
)
