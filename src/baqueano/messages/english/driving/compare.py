"""English sentences about comparisons, and about the requirements of their figures."""

CONSISTENCY = (
    "{figure} of {quantity:word} is {mean:.3g}. A correct covariance gives {low:.3g} to {high:.3g}{worst}"
)

TEMPLATES: dict[str, str] = {
    "compare.laps": (
        "{laps} laps, the last in {seconds:.1f} s. Cross-track error of the {quantity:word}: {first_cm:.1f} cm rms "
        "in the first lap and {last_cm:.1f} in the last, at most {max_cm:.1f} in lap {worst}. After each lap the "
        "vehicle is at most {gap_cm:.1f} cm from the point at which this lap began."
    ),
    "compare.no-runs": "A comparison needs one or more runs. For example, type: {type[baqueano compare last]}",
    "compare.times": (
        "interval_s = {interval_s:g} s, skip_s = {skip_s:g} s: expected interval_s above 0, skip_s at least 0."
    ),
    "compare.names": "Number of names: {names}, number of runs or fits: {runs}. Expected one name for each.",
    "lab.scipy-for-bands": "scipy is not installed, and the χ² bands need it. Type: {fix}",
    "forecast.no-covariance": (
        "The estimator {estimator:word} does not give a covariance of the pose, so its "
        "uncertainty cannot be predicted. Type: {fix}"
    ),
    "compare.alignment": 'alignment = "{value}": expected one of {valid}.',
    "compare.no-first-heading": (
        'alignment = "start" needs the first heading, but the truth contains only positions. Align by all '
        "positions. Type: {fix}"
    ),
    "compare.reference-short": "The reference path has {points} points: expected at least 2.",
    "compare.advice-too-sure": (
        "The filter underestimates its errors (NEES above the band): its noise is too small, or "
        "its model is incomplete. Fit the model again to find the cause."
    ),
    "compare.advice-too-cautious": (
        "The filter overestimates its errors (NEES below the band). In a simulation of the same model this is "
        "normal, because the model is exact there. With runs of the vehicle, measure the noise again. Type: "
        "{type[baqueano identify last --update]}"
    ),
    "consistency.not-reported": "The run does not contain an estimate with a covariance",
    "consistency.cannot-tell": (
        "There are not enough data: the errors of {quantity:word} are equivalent to {samples:.1f} independent "
        "samples"
    ),
    "consistency.consistent": f"Consistent: the {CONSISTENCY}",
    "consistency.too-sure": f"The {CONSISTENCY}",
    "consistency.too-cautious": f"The {CONSISTENCY}",
    "consistency.worst": "; the worst state is {state:word}, {nees:.3g}",
    "consistency.unknown": "{quantity:word} cannot be evaluated with this run",
    "consistency.correlated": (
        "The innovations are correlated ({correlation:.2f} at lag 1): the model or the noise is incomplete"
    ),
    "corridor.lost": "lost after {t_s:.0f} s: from then on the heading is unknown",
    "corridor.lost-in-lap": "lost after {t_s:.0f} s (lap {lap}): from then on the heading is unknown",
    "corridor.after-time": "after {t_s:.0f} s the estimator expects errors within {bound} (95 %)",
    "corridor.after-lap": "after 1 lap the estimator expects errors within {bound} (95 %)",
    "corridor.after-laps": "after {laps} laps the estimator expects errors within {bound} (95 %)",
    "corridor.cm": "± {across_cm:.2g} cm across the path, ± {heading_deg:.2g}° in heading",
    "corridor.m": "± {across_m:.2g} m across the path, ± {heading_deg:.2g}° in heading",
    "corridor.with-truth": "{corridor}. The true position error there is {error_cm:.2g} cm.",
    "compare.few-fits": (
        "A comparison of fits needs two that are accepted; found {accepted_count} of {count}. For the reasons, "
        "type: {fix}"
    ),
    "compare.mixed": "Runs are compared with runs, and fits with fits. Type: {fix}",
    "compare.of-run": "{run}: {cause}.",
}
