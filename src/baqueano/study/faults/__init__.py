"""Faults of recordings and of models, and what fits say of them."""

from baqueano.study.faults.detection import FAULTS, Faults, faults
