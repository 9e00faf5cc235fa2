"""Find a wrong sensor: runs of readings against the model by the commands alone, and a third witness.

agreement.py judges numbers, witness.py decides between sensor and model, findings.py says it.
"""

from baqueano.monitor.agreement import Agreement
from baqueano.monitor.findings import Finding
from baqueano.monitor.memory import DEGRADED_S, EVENT_S
from baqueano.monitor.refusals import REFUSED, Refusals, counted, refusals_of
from baqueano.monitor.watching import Notice, Watching

__all__ = ["Finding", "Refusals", "refusals_of"]
