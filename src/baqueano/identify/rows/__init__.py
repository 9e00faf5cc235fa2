"""Runs → rows: what was commanded and measured, tick by tick, piece by piece, each clock set right."""
