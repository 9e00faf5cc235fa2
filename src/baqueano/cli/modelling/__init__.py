"""Define the subcommands for runs and models: simulate, runs, identify, tune, forecast, compare, report, study."""
