"""python -m baqueano."""

from baqueano.cli import main

main()
