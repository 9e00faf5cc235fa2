"""Identifiability of parameters, and advice on unobservable parameters."""
