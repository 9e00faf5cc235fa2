"""Detect a wrong sensor: compare its readings with a model driven by the commands; other sensors are a third source.

agreement.py checks each channel, fit_errors.py contains the errors of the model, log_odds.py decides between sensor
and model, findings.py formulates the message.
"""

from baqueano.monitor.agreement import AgreementMonitor
from baqueano.monitor.findings import Finding
from baqueano.monitor.fit_errors import alternative_models
from baqueano.monitor.memory import DEGRADED_S, EVENT_S
from baqueano.monitor.rejections import REJECTIONS_SOURCE, Rejections, rejection_event, rejections_in
from baqueano.monitor.sensor_monitor import Notice, SensorMonitor, expected_innovation_cov

__all__ = ["Finding", "Rejections", "rejections_in"]
