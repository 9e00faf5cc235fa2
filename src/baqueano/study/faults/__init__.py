"""Faults of recordings and of models, and their detection by fits."""

from baqueano.study.faults.detection import FAULTS, Faults, faults
