"""English sentences about sensors that disagree, a model that no longer fits, and motion outside the data of a fit."""

TEMPLATES: dict[str, str] = {
    "sensor.lost": "{subject} does not give readings. {consequence}.",
    "sensor.no-number": "{subject} does not give a finite number. {consequence}.",
    "sensor.at-its-end": "{subject} is at full scale, {reading:.3g}. {consequence}.",
    "sensor.frozen": "{subject} is stuck at {reading:.3g}; expected {expected:.3g}. {consequence}.",
    "sensor.zero": "{subject} reads 0; expected {expected:.3g}. {consequence}.",
    "sensor.slips": (
        "{subject} turns at {reading:.3g}; expected {expected:.3g}. Does its wheel slip? {consequence}."
    ),
    "sensor.scaled": "{subject} reads {ratio:.2f} times the expected value. {consequence}.",
    "sensor.contradicted": (
        "{subject} reads {reading:.3g}, as the model predicts, but another sensor contradicts it. {consequence}."
    ),
    "sensor.away": "{subject} reads {reading:.3g}; expected {expected:.3g}. {consequence}.",
    "sensor.error-in-sensor": "The error is in the sensor, not in the model",
    "sensor.error-in-model": "The error is in the model, not in the sensor. Type: {fix}",
    "sensor.error-in-unknown": (
        "The error can be in this sensor, in another sensor, or in the model. A third sensor of the same motion can "
        "show which"
    ),
    "sensor.degraded": "DEGRADED: {cause}.",
    "sensor.agrees-again": "{subject} agrees again, after {duration_s:.1f} s",
    "monitor.raised": "The sensors are no longer monitored: the monitor raised {error}",
    "model.fits-no-longer": (
        "for {window_s:.0f} s the errors of the model were {ratio:.1f} times as large as predicted: the "
        "model no longer describes this vehicle or this floor. Type: {fix}"
    ),
    "estimator.refused": "{reasons}",
    "envelope.this-run": "the run",
    "envelope.this-signal": "the signal",
    "envelope.left": (
        "{run} leaves the envelope of the fit: {subject} goes from {minimum:.2g} to "
        "{maximum:.2g}. It is outside the range of the fit, {low:.2g} to {high:.2g}, for "
        "{percent:.0f} % of the time"
    ),
}
