"""English sentences of a sweep."""

TEMPLATES: dict[str, str] = {
    "sweep.head": "medians of {drives} drives",
    "sweep.head-ratio": (
        "medians of {drives} drives; ratio: {figure} divided by that of {reference}, with its "
        "interval of 95 %"
    ),
    "sweep.stopped": "{subject}: {stopped} of {drives} drives were stopped",
    "sweep.part": "{done} of {asked} drives are done; the same command continues",
    "sweep.spread": "Each dot is a drive, each bar the median of a cell.",
    "sweep.ratios": "The error of each cell over that of {reference} on the same drives, and its interval of 95 %.",
    "sweep.interval": (
        "A ratio below 1 is better than the reference. Its interval of 95 % is Student's, by leaving out one block "
        "after the other. A block is a drive. With fewer than 5 drives it is a segment of 10 s, or of 4 correlation "
        "times if that is longer. Fewer than 5 blocks cannot tell."
    ),
    "sweep.reference": "No cell is called {found}. {near}.",
    "sweep.setting": "sweep() does not take {found}. {near}.",
    "sweep.numbers": "A sweep got {laps} laps and a span of {over_s:g} s. Expected 1 lap or more, and more than 0 s.",
    "sweep.nothing": (
        "Nothing is to be driven: {vehicles} vehicles, {routes} routes, {seeds} seeds. Expected one or more of each."
    ),
    "sweep.mixed": "A sweep takes vehicles or runs, not both. Among the vehicles is a {found}.",
    "sweep.route": "A sweep drives routes, such as guides.shapes.eight(1.0, 0.25). Found: {found}.",
    "sweep.of-runs": (
        "A recorded run is replayed, so its {what} cannot vary. Give vehicles in place of runs, or estimators alone."
    ),
    "sweep.no-distributed": "A cluster needs the package distributed. Type: {fix}",
    "sweep.no-cluster": "No Dask scheduler answers at {address}: {cause}. Start one: dask scheduler.",
    "cli.sweep": "drives: {drives}",
}
