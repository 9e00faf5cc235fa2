"""Runs → vehicle file: signals that show what a vehicle is, the fit, its error bars and its verdict."""

from baqueano.identify.fit import identify
from baqueano.identify.result import ChannelFit, Fit
from baqueano.identify.signals import KINDS, excitation, multisine, prbs, ramps, random_steps

__all__ = [
    "KINDS",
    "ChannelFit",
    "Fit",
    "excitation",
    "identify",
    "multisine",
    "prbs",
    "ramps",
    "random_steps",
]
