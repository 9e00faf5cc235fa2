"""English names of parameters, and of the most informative motions, on the page of live identification."""

TEMPLATES: dict[str, str] = {
    "parameter.label": "{meaning:word}{entry}",
    "parameter.needs": "missing: {motion:word}",
    "motion.straight-steady": "drive straight forward at {percent:.0f} % and return, {t_s:g} s",
    "motion.straight-steps": "drive straight in short pulses, forward and then backward, {t_s:g} s",
    "motion.straight-ramp": (
        "drive straight, raising the command slowly to its maximum, and return the same way, {t_s:g} s"
    ),
    "motion.turn-steady": "turn on the spot at {percent:.0f} %, to the left and then to the right, {t_s:g} s",
    "motion.turn-steps": "turn on the spot in short pulses, to the left and then to the right, {t_s:g} s",
    "motion.turn-ramp": (
        "turn on the spot, raising the command slowly to its maximum, to the left and then to the right, "
        "{t_s:g} s"
    ),
    "motion.curve-steady": "drive a curve to the left at {percent:.0f} %, and return the same way, {t_s:g} s",
    "motion.curve-steps": "drive a curve to the left in short pulses, and return the same way, {t_s:g} s",
    "motion.curve-ramp": (
        "drive a curve to the left, raising the command slowly to its maximum, and return the same way, "
        "{t_s:g} s"
    ),
    "motion.circle-steady": "drive circles to the left at {percent:.0f} %, {t_s:g} s",
    "motion.circle-steps": "drive circles to the left in short pulses, {t_s:g} s",
    "motion.circle-ramp": "drive circles to the left, raising the command slowly to its maximum, {t_s:g} s",
}
