"""Identifiable parameters, and advice on the others."""
