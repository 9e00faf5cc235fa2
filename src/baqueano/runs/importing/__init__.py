"""Recordings of other people → runs, by a map.

sources, timing    the files, their rows in the order of time, and their clocks
recordings         rows → runs, with what looks wrong in them
"""

from baqueano.runs.importing.recordings import ImportedRun, ImportedRuns, import_run, import_runs
