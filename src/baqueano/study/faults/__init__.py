"""Damage recordings and models, and count the faults that fits detect."""

from baqueano.study.faults.detection import FAULTS, Faults, faults
