"""Precautions of a drive along a route: what is checked before it begins, and what slows and stops it."""
