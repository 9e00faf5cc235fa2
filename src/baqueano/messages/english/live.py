"""English names of parameters for people, and motions that would tell most, on the page of live identification."""

TEMPLATES: dict[str, str] = {
    "known.label": "{meaning:word}{entry}",
    "known.needs": "missing: {motion:word}",
    "motion.straight-steady": "drive straight ahead at {percent:.0f} % and back, {t_s:g} s",
    "motion.straight-steps": "drive straight in bursts, ahead and then back, {t_s:g} s",
    "motion.straight-ramp": "drive straight, slowly faster up to full, then the same back, {t_s:g} s",
    "motion.turn-steady": "turn on the spot at {percent:.0f} %, to the left and then to the right, {t_s:g} s",
    "motion.turn-steps": "turn on the spot in bursts, left and then right, {t_s:g} s",
    "motion.turn-ramp": "turn on the spot, slowly faster up to full, left and then right, {t_s:g} s",
    "motion.curve-steady": "drive a curve to the left at {percent:.0f} %, and back the same way, {t_s:g} s",
    "motion.curve-steps": "drive a curve to the left in bursts, and back the same way, {t_s:g} s",
    "motion.curve-ramp": "drive a curve to the left, slowly faster up to full, and back, {t_s:g} s",
    "motion.circle-steady": "drive circles to the left at {percent:.0f} %, {t_s:g} s",
    "motion.circle-steps": "drive circles to the left in bursts, {t_s:g} s",
    "motion.circle-ramp": "drive circles to the left, slowly faster up to full, {t_s:g} s",
}
