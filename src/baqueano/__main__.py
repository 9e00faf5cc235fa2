"""Run the command line as `python -m baqueano`."""

from baqueano.cli import main

main()
