"""Define the verbs for runs and vehicle files: simulate, runs, identify, tune, forecast, compare, report, study."""
