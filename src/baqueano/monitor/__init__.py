"""Detect a wrong sensor: compare its readings with a model driven by the commands; other sensors are a third source.

agreement.py checks each channel, witness.py decides between sensor and model, findings.py formulates the message.
"""

from baqueano.monitor.agreement import Agreement
from baqueano.monitor.findings import Finding
from baqueano.monitor.memory import DEGRADED_S, EVENT_S
from baqueano.monitor.refusals import REFUSED_SOURCE, Refusals, refusal_event, refusals_of
from baqueano.monitor.watching import Notice, Watching

__all__ = ["Finding", "Refusals", "refusals_of"]
