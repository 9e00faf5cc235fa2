"""English sentences of comparisons, and of what their figures need."""

TEMPLATES: dict[str, str] = {
    "compare.not-a-list": "alignment is a {kind}: several runs go into a list, as compare([one, other]).",
    "compare.no-runs": ("the list of runs is empty: give one or more, as baqueano compare last"),
    "compare.times": (
        "over_s = {over_s:g} s, skip_s = {skip_s:g} s: expected over_s above 0, skip_s at least 0."
    ),
    "compare.names": "names has {names} names, and there are {runs} runs: expected one for each.",
    "lab.scipy-for-bands": "scipy is not installed, and the χ² bands need it. Type: {fix}",
    "forecast.no-covariance": (
        "the estimator {estimator} gives no covariance of the pose, so there is nothing to forecast. Type: {fix}"
    ),
    "compare.alignment": 'alignment = "{found}": expected one of {known}.',
    "compare.no-first-heading": (
        'alignment = "start" turns the path by the first heading, and the truth has positions alone. Lay it on '
        "by all positions. Type: {fix}"
    ),
    "compare.reference-short": "the reference path has {points} points: expected at least 2.",
    "compare.of-run": "{run}: {cause}.",
}
