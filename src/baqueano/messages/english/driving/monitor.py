"""English sentences about sensors that disagree, a model that no longer fits, and motion that no fit has seen."""

TEMPLATES: dict[str, str] = {
    "sensor.no-number": "{subject} gives no finite number. {off}.",
    "sensor.at-its-end": "{subject} stands at the end of its range, {reading:.3g}. {off}.",
    "sensor.frozen": "{subject} is stuck at {reading:.3g}, where {expected:.3g} is expected. {off}.",
    "sensor.zero": "{subject} reads nothing, where {expected:.3g} is expected. {off}.",
    "sensor.slips": (
        "{subject} turns at {reading:.3g}, where {expected:.3g} is expected: does its wheel slip? {off}."
    ),
    "sensor.scaled": "{subject} reads {ratio:.2f} times what is expected. {off}.",
    "sensor.away": "{subject} reads {reading:.3g}, where {expected:.3g} is expected. {off}.",
    "sensor.off-sensor": "The sensor is off, not the model",
    "sensor.off-model": "The model is off, not the sensor. Type: {fix}",
    "sensor.off-unknown": "If it is the sensor or the model that is off, no third witness tells",
    "sensor.degraded": "DEGRADED: {cause}.",
    "sensor.agrees-again": "{subject} agrees again, after {lasted_s:.1f} s",
    "monitor.raised": "the sensors are not watched any more: the monitor raised {error}",
    "model.fits-no-longer": (
        "for {window_s:.0f} s the sensors were {times:.1f} times as far from the model as it predicts: it no longer "
        "fits this vehicle or this floor. Type: {fix}"
    ),
    "estimator.refused": "{each}",
    "envelope.this-run": "the run",
    "envelope.this-signal": "the signal",
    "envelope.left": (
        "{run} leaves the envelope of the fit: {subject} goes from {least:.2g} to {most:.2g}, {beyond_percent:.0f} % "
        "of the time beyond {low:.2g} to {high:.2g}, which the model was fitted to"
    ),
}
