"""Faults of a simulated world: their kinds, their times, and the checks that detected them."""

from typing import TYPE_CHECKING

from baqueano.on_demand import on_demand

if TYPE_CHECKING:
    from baqueano.worlds.faults.fault import Fault
    from baqueano.worlds.faults.ledger import Ledger, fault_ledger

__all__ = ["Fault", "Ledger", "fault_ledger"]

__getattr__ = on_demand(__name__, {"fault": ("Fault",), "ledger": ("Ledger", "fault_ledger")})
