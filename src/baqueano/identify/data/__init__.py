"""Runs as rows of a fit."""
