"""Define the subcommands that move a vehicle: experiment, teach, repeat, replay, drive.

targets         the vehicle that a subcommand drives: simulated, emulated or real
manual_drive    a manual drive from this terminal
iterate         repeated rounds of design, drive and fit
"""
