"""English sentences of comparisons, and of what their figures need."""

CONSISTENCY = (
    "the {figure} of {of:word} is {mean:.2f}, and of a right covariance between {low:.2f} and {high:.2f}"
    "{worst}"
)

TEMPLATES: dict[str, str] = {
    "compare.not-a-list": "alignment is a {kind}: several runs go into a list, as compare([one, other]).",
    "compare.no-runs": ("the list of runs is empty: give one or more, as baqueano compare last"),
    "compare.times": (
        "over_s = {over_s:g} s, skip_s = {skip_s:g} s: expected over_s above 0, skip_s at least 0."
    ),
    "compare.names": "names has {names} names, and there are {runs} runs: expected one for each.",
    "lab.scipy-for-bands": "scipy is not installed, and the χ² bands need it. Type: {fix}",
    "forecast.no-covariance": (
        "the estimator {estimator:word} gives no covariance of the pose, so there is nothing to forecast. Type: {fix}"
    ),
    "compare.alignment": 'alignment = "{found}": expected one of {known}.',
    "compare.no-first-heading": (
        'alignment = "start" turns the path by the first heading, and the truth has positions alone. Lay it on '
        "by all positions. Type: {fix}"
    ),
    "compare.reference-short": "the reference path has {points} points: expected at least 2.",
    "compare.advice-too-sure": (
        "It errs more than it says: its noise is too small, or its model lacks something. A fit tells."
    ),
    "compare.advice-too-cautious": (
        "It errs less than it says, which is safe and not sharp: its noise is larger than it need be. Where that "
        "stays after a fit: smaller disturbance_std or process_noise_cov in [estimator]."
    ),
    "consistency.not-reported": "The run does not hold an estimate with a covariance",
    "consistency.cannot-tell": "Cannot tell: errors of {of:word} count for {samples:.1f} independent samples",
    "consistency.consistent": f"Consistent: {CONSISTENCY}",
    "consistency.too-sure": f"Too sure: {CONSISTENCY}",
    "consistency.too-cautious": f"Too cautious: {CONSISTENCY}",
    "consistency.worst": "; the furthest off is {state:word} with {nees:.2f}",
    "consistency.unknown": "Of {of:word} the run cannot tell",
    "consistency.correlated": (
        "Innovations are correlated ({correlation:.2f} at lag 1), so model or noise lacks something"
    ),
    "corridor.lost": "lost since {t_s:.0f} s: from there on its heading is a guess",
    "corridor.lost-in-lap": "lost since {t_s:.0f} s (lap {lap}): from there on its heading is a guess",
    "corridor.after-time": "after {t_s:.0f} s the vehicle is known to {within} (95 %)",
    "corridor.after-lap": "after 1 lap the vehicle is known to {within} (95 %)",
    "corridor.after-laps": "after {laps} laps the vehicle is known to {within} (95 %)",
    "corridor.cm": "± {across_cm:.2g} cm across, ± {heading_deg:.2g}°",
    "corridor.m": "± {across_m:.2g} m across, ± {heading_deg:.2g}°",
    "compare.of-run": "{run}: {cause}.",
}
