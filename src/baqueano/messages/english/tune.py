"""English sentences of simulations and of tuning."""

TEMPLATES: dict[str, str] = {
    "tune.uncontrolled": (
        "with the best gains the vehicle stays {distance_m:.3g} m rms from its route, hardly less than without "
        "control. Is the route faster than the vehicle, or its speed below the dead zone of its motors?"
    ),
    "tune.at-lower-limit": "{subject} is at its lower limit, {limit:.3g}{unit}",
    "tune.at-upper-limit": "{subject} is at its upper limit, {limit:.3g}{unit}",
    "tune.one-start": "only 1 of {starts} starts reached this cost: there may be a better one",
    "tune.saturated": (
        "the command is at its limit {percent:.0f} % of the time: drive slower, or give jerks a higher price "
        "(effort_m2, --effort)"
    ),
    "simulate.lost": "{lost} of {vehicles} vehicles diverged and are not counted",
    "simulate.clipped": "{clipped} of {vehicles} draws were moved to a bound",
    "compare.inconsistent": "{subject} {how}",
    "compare.diverged": "The estimate diverged at {t_s:.1f} s. Its figures are of the time before.",
    "compare.no-covariance": (
        "The covariance is not positive definite at {ticks} of {of} ticks, first at {from_s:.2f} s, so it "
        "gives no probability."
    ),
}
