"""English sentences of chosen terms, noise, calibration, forecasts, and parameters over time."""

AGAIN = (
    "noise: that of the own runs does not hold on {runs} (NIS {nis}). It was found again over all runs "
    "(NIS {again})"
)
HELD_OUT = "If accelerometers make it better, a held-out run with a camera or an odometer tells. Type: {fix}"
RATIO = "its error is {ratio:.2f} × that without it ({low:.2f} to {high:.2f}), by {by} of {runs}."
LAP = "A lap cannot be predicted:"
MOVED = (
    "{before:.4g} ± {before_sd:.1g} → {after:.4g} ± {after_sd:.1g}{unit} ({percent:+.0f} %, {z:.1f} standard "
    "errors)"
)

TEMPLATES: dict[str, str] = {
    "choose.taken": (
        "{subject} taken: held-out {channel} error {before:.3g} → {after:.3g}{unit}, {errors:.1f} standard errors "
        "({needed:.1f} needed)"
    ),
    "choose.refused": "{subject} refused: {why}",
    "choose.left-out-for": "{subject} left out: {why}",
    "choose.dropped": (
        "{subject} dropped again: beside the others it brings {percent:.1f} ± {percent_sd:.1f} % only, {errors:.1f} "
        "standard errors"
    ),
    "choose.left-out": (
        "{subject} left out: the held-out error falls by {percent:.1f} ± {percent_sd:.1f} %, {errors:.1f} standard "
        "errors ({needed:.1f} needed)"
    ),
    "term.best-without": "what fits best is a model without it",
    "term.brings-little": "fitted, it makes the cost smaller by {percent:.2f} % only",
    "term.same-as-others": "not identifiable: the other parameters of the model do the same",
    "term.not-identifiable": (
        "not identifiable here, {value:.3g} ± {sd:.2g}; the held-out error falls by {percent:.1f} ± {percent_sd:.1f} %"
    ),
    "term.battery-not-separable": (
        "cannot be told: {value:.2g} ± {half:.2g}, and it is 0 to 1. This needs a voltage that changes by itself: runs "
        "with a full and with an empty battery"
    ),
    "noise.too-short": "noise: {runs} is too short to tell if it is true; it is that of the own runs.",
    "noise.holds": "noise: it holds on {runs} (NIS {nis}).",
    "noise.found-again": f"{AGAIN}.",
    "noise.still-off": f"{AGAIN}: too sure of {{too_sure}}, too careful of {{too_careful}}.",
    "noise.lifted": "{subject}: {lifted} of {of} variances were lifted to the floor",
    "noise.correlations-reduced": "{subject}: correlations were reduced, so that the matrix is positive definite",
    "noise.of-the-file": "Q of {subject} is that of the file: not all of its channels took part in the fit",
    "noise.of-its-rest": "Q of {subject} is that at rest, σ = {sigma:.3g}: it took no part in the fit",
    "speed.by-the-file": f"speed: corrected by {{channels}}, as the file says. {HELD_OUT}",
    "speed.by-the-model": f"speed: left to the model. {HELD_OUT}",
    "speed.too-short": (
        "speed: {runs} is too short to tell if accelerometers help ({pieces} of {least} pieces of {block_s:g} s). It "
        "is left to the model."
    ),
    "speed.corrected": f"speed: corrected by {{channels}}; {RATIO}",
    "speed.left": f"speed: left to the model. With {{channels}}, the best of all, {RATIO}",
    "at-rest.bursts": (
        "{subject}: the stamps come in bursts (median step {median_ms:.3g} ms, mean {mean_ms:.4g} ms, longest "
        "{longest_ms:.3g} ms). They say when the samples arrived; they were taken as even at {rate_hz:.2f} Hz"
    ),
    "at-rest.repeats": "{subject}: {percent:.0f} % of the samples repeat the one before: read faster than measured",
    "at-rest.touched": "{subject}: {percent:.1f} % of the samples are far beyond its noise. Was it touched?",
    "at-rest.dead": "{subject} says {value:g} all the time. Is it connected?",
    "calibration.turn-more": "{subject} is known to ± {percent:.1f} % only: turn it more, to both sides",
    "calibration.drive-further": "{subject} is known to ± {percent:.1f} % only: drive it further",
    "calibration.loose-clock": "the clocks agree to ± {half_ms:.0f} ms only: change speed and turn often",
    "calibration.clock-at-end": "the clock offset {offset_s:.2f} s is at the end of what was looked for",
    "over-time.step": f"{{subject}} moved between {{first}} and {{second}}: {MOVED}",
    "over-time.drift": f"{{subject}} moved slowly from {{first}} to {{second}}: {MOVED}",
    "over-time.refused": "the fit of {subject} is refused, so it tells nothing",
    "forecast.off": (
        "After {duration_s:.0f} s of open loop, {drive} ({way_m:.2g} m), the fit's own errors put the vehicle "
        "{position} and {heading_deg}° off (rms)."
    ),
    "forecast.lost": (
        "After {duration_s:.0f} s of open loop, {drive} ({way_m:.2g} m), the fit's own errors put the heading "
        "{heading_deg}° off (rms): the place is lost."
    ),
    "forecast.as-the-runs": "driven as these runs",
    "forecast.longest-again": "the longest run again",
    "forecast.lap": "one lap",
    "forecast.lap-of": "one lap of {name}",
    "forecast.lap-of-circle": "one lap of a sinuous circle",
    "forecast.unseen-exact": "What the runs did not show counts as exact in this.",
    "forecast.more-errors": "Floor, battery and start add to this.",
    "forecast.no-controller": f"{LAP} the recommended controller cannot drive this vehicle: {{error}}",
    "forecast.strays": f"{LAP} the model strays {{far}} (rms) from it: it is too fast or too tight.",
}
