"""English sentences about faults of a simulated world, and about the parts of the software that detected them."""

TEMPLATES: dict[str, str] = {
    "shake.push": "push of {impulse_n_s:.2f} N s {direction}",
    "shake.way-ahead": "forward",
    "shake.way-left": "to the left",
    "shake.way-back": "backward",
    "shake.way-right": "to the right",
    "shake.tilt": "floor tilted by {slope_deg:.1f}°, up towards {uphill_deg:.0f}°",
    "shake.cut": "{target} cut",
    "shake.drift": "zero of {target} drifts by {size:g}{unit}",
    "shake.spikes": "spikes of ± {size:g}{unit} in {target}, {percent:.0f} % of its samples",
    "shake.slip": "{wheel} with {percent:.0f} % of the force",
    "shake.wheel-left": "left wheel slips,",
    "shake.wheel-right": "right wheel slips,",
    "shake.wheel-all": "wheels slip,",
    "shake.sag": "battery falls to {percent:.0f} % of its voltage",
    "shake.lose": "the line loses {percent:.0f} % of its frames",
    "shake.end": "ended after {duration_s:.1f} s: {fault}",
    "shake.kind": "The fault {value} does not exist: expected one of {valid}.",
    "shake.number": "{kind}: {name} = {value}: expected a number from {low:g} to {high:g}.",
    "shake.target": "{kind} of {value}: expected one of {valid}.",
    "shake.fields": "{value} does not have kind, or has an unknown field: expected some of {valid}.",
    "shake.syntax": (
        '{value} does not describe a fault. Expected a time and a kind, such as "12 s: push 0.3 N s left" '
        'or "3-6 s: cut imu". The kinds, each with an example: {valid}.'
    ),
    "shake.parts": '{value} does not describe a fault of the kind {kind}: expected for example "{kind} {example}".',
    "shake.no-inertia": "This vehicle is kinematic: its velocity is its command, so a {kind} cannot move it.",
    "shake.no-mass": (
        "The vehicle file does not have mass_kg, so the effect of a push of {value} is unknown. "
        "Tilt the floor instead."
    ),
    "shake.too-many": "A drive has at most {maximum} faults. Begin another drive.",
    "shake.no-number": "Fault number {value} does not exist: this drive had {maximum} so far.",
    "shake.of-another-world": (
        "Faults occur only in a simulation, but this drive has its own world, {world}. Remove `world` "
        "or `shake`."
    ),
    "shake.robot": "Faults occur only in a simulation. Remove --shake, or --robot {host}.",
    "shake.no-drive": (
        "The vehicle is not driving now. Start a mission first, or give the mission its faults with shake."
    ),
    "shake.no-mission": "No mission was driven yet, so none can be repeated.",
    "shake.manual": (
        "A manual drive cannot be driven again without its faults, because a person never drives twice in the "
        "same way. Repeat a route, or drive an experiment."
    ),
    "ledger.who-monitor": "monitor",
    "ledger.who-model": "model check",
    "ledger.who-supervisor": "supervisor",
    "ledger.who-gate": "gate",
    "ledger.who-nis": "NIS",
    "ledger.fault": "{t_s:.1f} s: {fault}",
    "ledger.detection-line": "    {detector} detected it after {delay_s:.2f} s: {reply}",
    "ledger.undetected-line": "    it was not detected {reply}",
    "ledger.not-reached": "{fault}: the drive ended at {end_s:.1f} s, so this fault did not occur.",
    "ledger.gate": "rejected {count} innovations within {limit_s:g} s",
    "ledger.nis": "its mean over {window_s:g} s is {nis:.2f}; chance gives at most {maximum:.2f}",
    "ledger.undetected": "for {delay_s:.1f} s: NIS at most {nis:.2f}. {reason}.",
    "ledger.undetected-error": "for {delay_s:.1f} s: NIS at most {nis:.2f}. {consequence}. {reason}.",
    "ledger.estimate-error": (
        "The estimate has an error of {error_cm:.1f} cm, but its own uncertainty is ± {bound_cm:.1f} cm."
    ),
    "ledger.why-push": "The push is within the disturbance that the filter expects from the floor.",
    "ledger.why-tilt": (
        "For an accelerometer a tilt looks like a bias, and other sensors do not measure it."
    ),
    "ledger.why-tilt-pose": "The measured pose corrects the effect of the tilt, so that effect is small.",
    "ledger.why-unused": "The estimator does not use {subject}.",
    "ledger.why-cut": "The filter continues with its model, and this sensor is not monitored.",
    "ledger.why-drift": "No other sensor shows this motion, so nothing contradicts {subject}.",
    "ledger.why-drift-others": "The drift is small compared with the noise of the other sensors.",
    "ledger.why-spikes": "The spikes are too few or too small compared with the noise.",
    "ledger.why-slip": "An IMU measures the motion of the vehicle, not that of its wheels.",
    "ledger.why-slip-wheels": "The slip is smaller than the filter expects.",
    "ledger.why-sag": "The battery is not measured here, and a weaker motor looks like a heavier vehicle.",
    "ledger.why-lose": "A filter continues with its model through gaps this short.",
}
