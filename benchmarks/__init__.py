"""Measure speed, as ratios within one run: `make bench`, or `python -m benchmarks [--json] [--smallest] [name …]`."""
