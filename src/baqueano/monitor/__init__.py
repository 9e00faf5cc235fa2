"""Detect a wrong sensor: compare runs of readings with the model of the commands; other numbers are the third witness.

agreement.py judges the numbers, witness.py decides between sensor and model, findings.py formulates the message.
"""

from baqueano.monitor.agreement import Agreement
from baqueano.monitor.findings import Finding
from baqueano.monitor.memory import DEGRADED_S, EVENT_S
from baqueano.monitor.refusals import REFUSED, Refusals, counted, refusals_of
from baqueano.monitor.watching import Notice, Watching

__all__ = ["Finding", "Refusals", "refusals_of"]
