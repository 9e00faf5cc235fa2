"""A run on disk: write, read, recover, cut, list, import, export."""

from baqueano.runs.export import export_csv, export_tum
from baqueano.runs.folder import find, listing, new_path
from baqueano.runs.importing import Imported, import_run, import_runs
from baqueano.runs.reader import read_run
from baqueano.runs.recover import recover
from baqueano.runs.route_file import read_route, write_route
from baqueano.runs.run import Channel, EstimateLog, Event, ReferenceLog, Run, TruthLog
from baqueano.runs.show import show
from baqueano.runs.writer import RunWriter, write_run

__all__ = [
    "Channel",
    "EstimateLog",
    "Event",
    "Imported",
    "ReferenceLog",
    "Run",
    "RunWriter",
    "TruthLog",
    "export_csv",
    "export_tum",
    "find",
    "import_run",
    "import_runs",
    "listing",
    "new_path",
    "read_route",
    "read_run",
    "recover",
    "show",
    "write_route",
    "write_run",
]
