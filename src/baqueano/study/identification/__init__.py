"""How near to the limit a fit comes, on physics that it did not write."""

from baqueano.study.identification.result import Identification, identification

__all__ = ["Identification", "identification"]
