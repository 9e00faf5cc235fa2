"""Ticks of a drive as messages, with its vehicle and its route."""
