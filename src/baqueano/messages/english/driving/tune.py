"""English sentences about simulations and tuning."""

TEMPLATES: dict[str, str] = {
    "tune.uncontrolled": (
        "with the best gains the vehicle is {distance_m:.3g} m rms from its route, almost as far as "
        "without control. Is the route too fast for the vehicle? Or is its speed below the dead zone of "
        "the motors?"
    ),
    "tune.at-lower-limit": "{subject} is at its lower limit, {limit:.3g}{unit}",
    "tune.at-upper-limit": "{subject} is at its upper limit, {limit:.3g}{unit}",
    "tune.one-start": "only 1 of {starts} start points reached this cost: a better solution might exist",
    "tune.saturated": (
        "the command is at its limit {percent:.0f} % of the time. Drive slower, or raise the weight of "
        "changes of the command (jerk_m2, --jerk)"
    ),
    "tune.narrow-margin": (
        "with {gain:.2f} times the gain of {subject}, {phase_deg:.0f}° more phase lag, or {delay_ms:.0f} ms more "
        "delay, the vehicle would oscillate. Raise the weight of changes of the command (jerk_m2): {fix}"
    ),
    "tune.unstable": (
        "with these gains a small error grows on a straight drive at {speed_m_s:.2g} m/s. Raise the weight of changes "
        "of the command (jerk_m2): {fix}"
    ),
    "simulate.lost": "{count} of {vehicles} vehicles diverged and were excluded",
    "simulate.clipped": "in {count} of {vehicles} draws a parameter was moved to its bound",
    "compare.inconsistent": "{subject}: {verdict:word}",
    "tune.offset": "offset_m = {offset_m:g}: expected a finite distance [m], 0 for a start on the route.",
    "tune.starts": "starts = {starts}: expected at least 1 descent.",
    "tune.all-run-away": (
        "{vehicle}: with every gain in the search the simulated vehicle diverges. Limit the "
        "command ([command] limit), or give smaller bounds."
    ),
    "tune.no-effect": (
        "{vehicle}: the commands do not affect the speed of {speed_m_s:.2g} m/s or the yaw rate of "
        "{yaw_rate_rad_s:.2g} rad/s that the route needs. Look at [command] limit and at the forces of the commands "
        "in [model]."
    ),
    "tune.no-gains": (
        "{kind} does not have a gain to tune. Each number that its class receives is a gain. Write it as a field, "
        "such as k: float = 3.0, or as an argument of __init__ that is stored under the same name."
    ),
    "tune.no-such-gain": "{kind} does not have the gain {value}. {suggestion}",
    "tune.bounds": (
        'bounds["{name}"] = ({low:g}, {high:g}): expected two finite numbers, the smaller one first.'
    ),
    "tune.weights": (
        "radian_m = {radian_m:g}, huber_m = {huber_m:g}, jerk_m2 = {jerk_m2:g}, effort_m2 = {effort_m2:g}: expected "
        "huber_m above 0, the others at least 0."
    ),
    "tune.nothing-to-drive": "{routes} routes and {seeds} seeds: expected at least one of each.",
    "tune.as-written": (
        "{controller} cannot be tuned: its step calls a library, which does not give a "
        "gradient. Compare several values of its parameters with a sweep."
    ),
    "tune.of-a-cell": (
        "{controller} is not defined in a file, so a vehicle file cannot name it. Drive with "
        "controller=tuned.controller, or write the class into a file."
    ),
    "tune.too-many": "{dimensions} gains at once: expected at most {maximum}. Name fewer, and fix the rest.",
    "lab.scipy-for-tuning": "scipy is not installed, and tuning needs it. Type: {fix}",
    "compare.diverged": "The estimate diverged at {t_s:.1f} s. Its results cover only the time before that.",
    "compare.estimator-failed": (
        "The estimator failed at {t_s:.1f} s: {cause}. Its results cover only the time before that. Correct it, and "
        "test it alone. Type: {fix}"
    ),
    "compare.no-covariance": (
        "The covariance is not positive definite at {ticks} of {total} ticks, first at {start_s:.2f} s, so a "
        "probability cannot be computed."
    ),
}
