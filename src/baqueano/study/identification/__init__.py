"""Compare identification with the Cramér-Rao bound, on the independent truth."""

from baqueano.study.identification.result import Identification, identification
