"""Verbs between runs and vehicle files: simulate, runs, identify, tune, forecast, compare, report, study."""
