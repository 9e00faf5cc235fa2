"""English sentences about chosen terms, noise, calibration, predictions, and parameters over time."""

INCONSISTENT_NOISE_TEXT = (
    "noise: the covariances of the fitted runs are inconsistent with {runs} (NIS {nis}). They were estimated again "
    "from all runs (NIS {new_nis})"
)
HELD_OUT = "To test whether accelerometers improve it, hold out a run with a camera or an odometer: {fix}"
ERROR_RATIO_TEXT = (
    "its error is {ratio:.2f} × the error without them ({low:.2f} to {high:.2f}), measured by {reference:word} "
    "of {runs}."
)
LAP = "A lap cannot be predicted"
CHANGE_TEXT = (
    "{first_value:.4g} ± {first_std:.1g} → {last_value:.4g} ± {last_std:.1g}{unit} ({percent:+.0f} %, {z:.1f} standard "
    "errors)"
)

TEMPLATES: dict[str, str] = {
    "choose.taken": (
        "{term:word} was added: the held-out error of {channel:word} changed from {first_error:.3g} to "
        "{last_error:.3g}{unit}, {errors:.1f} standard errors ({threshold:.1f} needed)"
    ),
    "choose.refused": "{term:word} was refused: {reason}",
    "choose.left-out-for": "{term:word} was excluded: {reason}",
    "choose.dropped": (
        "{term:word} was added, and then removed: together with the other terms it lowers the error by "
        "only {percent:.1f} ± {percent_std:.1f} %, {errors:.1f} standard errors"
    ),
    "choose.left-out": (
        "{term:word} was excluded: the held-out error decreases by {percent:.1f} ± {percent_std:.1f} %, "
        "{errors:.1f} standard errors ({threshold:.1f} needed)"
    ),
    "term.best-without": "the best fit is the model without it",
    "term.brings-little": "it lowers the cost by only {percent:.2f} %",
    "term.same-as-others": "not identifiable: the other parameters of the model have the same effect",
    "term.not-identifiable": (
        "not identifiable here, {value:.3g} ± {std:.2g}; the held-out error decreases by {percent:.1f} ± "
        "{percent_std:.1f} %"
    ),
    "term.battery-not-separable": (
        "not identifiable: {value:.2g} ± {half_width:.2g}, in a range of 0 to 1. This needs a voltage that changes by "
        "itself: runs with a full and with an empty battery"
    ),
    "term.battery-outside": (
        "{value:.2g} ± {half_width:.2g} is outside of 0 to {maximum:.2g}, so the voltage stands for another effect "
        "that the model lacks"
    ),
    "noise.no-field": (
        "{block} lacks a field for the noise that a fit measures. Add to this class "
        "measurement_noise_cov: np.ndarray | None = None, and return it from cov if it is not None. With "
        "--no-noise, the noise is not measured"
    ),
    "noise.too-short": "noise: {runs} is too short to test the noise of the fitted runs, which is kept.",
    "noise.consistent": "noise: the covariances are consistent with {runs} (NIS {nis}).",
    "noise.consistent-in-simulation": (
        "noise: the covariances are consistent with {runs} (NIS {nis}) and with a simulation of the fitted "
        "vehicle (NEES {nees})."
    ),
    "noise.nees-inconsistent": (
        "noise: the covariances are inconsistent with a simulation of the fitted vehicle (NEES {nees}): "
        "{states}."
    ),
    "noise.estimated-again": f"{INCONSISTENT_NOISE_TEXT}.",
    "noise.still-inconsistent": f"{INCONSISTENT_NOISE_TEXT}: {{states}}.",
    "noise.too-small-for": "too small for {states}",
    "noise.too-large-for": "too large for {states}",
    "noise.state": "{name:word}",
    "noise.square": "{name:word}: {mean:.2f} ({low:.2f} … {high:.2f})",
    "noise.raised": "{subject}: {count} of {total} variances were raised to the lower limit",
    "noise.correlations-reduced": "{subject}: correlations were reduced, so that the matrix is positive definite",
    "noise.of-the-file": "Q of {subject} comes from the file: not all of its channels were part of the fit",
    "noise.sideways-of-the-file": (
        "noise: no sensor in use shows the sideways velocity. velocity_walk_std[1] is that of the file."
    ),
    "noise.of-its-rest": (
        "Q of {subject} is the noise at rest, σ = {sigma:.3g}: the sensor was not part of the fit"
    ),
    "noise.of-its-readings": (
        "Q of {subject} is the fast part of all its readings, σ = {sigma:.3g}: the sensor was not part of the fit, and "
        "no run contains a rest of 2 s. The true noise can be smaller"
    ),
    "noise.without-readings": "Q of {subject} is a guess, σ = {sigma:.3g}: no run contains its readings",
    "speed.by-the-file": f"speed: corrected by {{channels}}, as in the file. {HELD_OUT}",
    "speed.by-the-model": f"speed: {{origin}}. {HELD_OUT}",
    "speed.of-the-model": "obtained only from the model",
    "speed.of-sensors": "measured by {sensors}",
    "speed.too-short": (
        "speed: {runs} is too short to test the accelerometers ({pieces} of {minimum} segments of "
        "{block_s:g} s). The setting in the vehicle file does not change."
    ),
    "speed.corrected": f"speed: corrected by {{channels}}; {ERROR_RATIO_TEXT}",
    "speed.left": f"speed: {{origin}}. With {{channels}}, the best choice, {ERROR_RATIO_TEXT}",
    "at-rest.bursts": (
        "{subject}: the timestamps come in bursts (step: median {median_ms:.3g} ms, mean {mean_ms:.4g} ms, "
        "longest {longest_ms:.3g} ms), so they are times of arrival. The samples were spaced evenly, at "
        "{rate_hz:.2f} Hz"
    ),
    "at-rest.repeats": (
        "{subject}: {percent:.0f} % of the samples repeat the previous one: the sensor is read faster than "
        "it measures"
    ),
    "at-rest.touched": "{subject}: {percent:.1f} % of the samples are far beyond its noise. Was it touched?",
    "at-rest.dead": "{subject} is constant at {value:g}. Is it connected?",
    "calibration.turn-more": "the error of {subject} is still ± {percent:.1f} %: turn more, to both sides",
    "calibration.not-determined": (
        "the run does not determine {subject}: the vehicle must turn for a gyro and drive for an odometer"
    ),
    "calibration.inverted": (
        "{subject} is {scale:.3f}: the channel has the wrong sign. Correct the sign in the map of the recording, or "
        "the axes of the IMU"
    ),
    "calibration.drive-further": "the error of {subject} is still ± {percent:.1f} %: drive a longer distance",
    "calibration.loose-clock": (
        "the clock offset is known only to ± {half_ms:.0f} ms: change speed and turn often"
    ),
    "calibration.clock-at-end": "the clock offset {offset_s:.2f} s is at the end of the searched range",
    "over-time.step": f"{{subject}} changed between {{first}} and {{second}}: {CHANGE_TEXT}",
    "over-time.drift": f"{{subject}} changed slowly from {{first}} to {{second}}: {CHANGE_TEXT}",
    "over-time.refused": "the fit of {subject} is refused, so it is excluded",
    "forecast.error": (
        "After {duration_s:.0f} s of open loop, {drive} ({distance_m:.2g} m), the errors of the fit "
        "cause errors of {position} and {heading_deg}° (rms)."
    ),
    "forecast.lost": (
        "After {duration_s:.0f} s of open loop, {drive} ({distance_m:.2g} m), the errors of the fit cause a "
        "heading error of {heading_deg}° (rms). The position is then unusable."
    ),
    "forecast.as-the-runs": "driven like these runs",
    "forecast.repeat-longest": "the longest run again",
    "forecast.lap": "one lap",
    "forecast.lap-of": "one lap of {name}",
    "forecast.lap-of-circle": "one lap of a sinuous circle",
    "forecast.scales": (
        "The scales of {subject} cause most of this error. That of the gyro is known to ± {percent:.2g} %. "
        "To measure it, turn the vehicle twice on its mark by hand, with a rest before and after. Type: {fix}"
    ),
    "forecast.fixed": (
        "{subject} was not fitted, and its value {value:.4g} ± {std:.2g} {unit} causes most of this error (1 σ). "
        "Measure it again."
    ),
    "forecast.battery": (
        "The runs do not contain the voltage of the battery. At {low_v:.2g} V, where it must stop, the vehicle "
        "is {percent:.0f} % slower than at {full_v:.2g} V."
    ),
    "forecast.unidentifiable-exact": "Parameters that are not identifiable are treated as exact here.",
    "forecast.more-errors": "Another floor, another voltage and the start position add more errors.",
    "forecast.no-controller": f"{LAP}, because the recommended controller cannot drive this vehicle: {{error}}",
    "forecast.strays": f"{LAP}: the model leaves the route by {{distance}} (rms). The route is too fast or too tight.",
}
