"""Import recordings of other tools as runs, with a map.

sources, timing    the files, their rows in order of time, and their clocks
recordings         make runs of the rows, with findings about errors in the rows
"""

from baqueano.runs.importing.recordings import ImportedRun, ImportedRuns, import_run, import_runs
