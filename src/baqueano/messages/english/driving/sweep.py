"""English sentences about a sweep."""

TEMPLATES: dict[str, str] = {
    "sweep.head": "medians over the drives ({drives})",
    "sweep.head-ratio": (
        "medians over the drives ({drives}); ratio: {figure} divided by that of {reference}, with its 95 % interval"
    ),
    "sweep.stopped": (
        "{subject}: {count} of {drives} drives were stopped (the first: {cause}). Only the result laps includes them"
    ),
    "sweep.guesses": (
        "The models of these vehicle files are guesses: {names}. To measure the first one, type: {fix}"
    ),
    "sweep.omitted": "The comparison omits {count} of {total} files of the patterns, because of their errors: {names}.",
    "sweep.several-vehicles": (
        "Recorded runs are replayed with one vehicle file, but --vehicle names several: {value}. Give only one."
    ),
    "sweep.gains": (
        "Controllers with the gains of a vehicle file of their own: {count} of {total}, such as {label} with {file}."
    ),
    "sweep.gains-of-code": "Controllers with the gains of their code: {names}.",
    "sweep.gains-choice": "gains = {value}: expected one of {valid}.",
    "sweep.vehicles": (
        "Each cell is the median of one vehicle: {heading}. The best combination is the first. In a cell without a "
        "number, all drives were stopped."
    ),
    "sweep.part": "{count} of {total} drives are done; type the same command again to continue",
    "sweep.spread": "Each dot is a drive, each bar the median of a combination.",
    "sweep.ratios": (
        "The error of each combination divided by that of {reference} on the same drives, with its 95 % interval."
    ),
    "sweep.interval": (
        "A ratio below 1 is better than the reference. Its 95 % interval is Student's t, "
        "from a jackknife that excludes one block at a time. A block is a drive. With fewer "
        "than 5 drives, a block is a segment of 10 s, or of 4 correlation times if that is "
        "longer. With fewer than 5 blocks, no decision is possible."
    ),
    "sweep.reference": "No combination has the label {value}. {suggestion}.",
    "sweep.setting": "{call}() does not accept {value}. {suggestion}.",
    "sweep.seeds": "seeds = {value}: expected several whole numbers, such as range(10).",
    "sweep.numbers": (
        "The sweep received {laps} laps and a span of {interval_s:g} s. Expected 1 lap or more, and more than "
        "0 s."
    ),
    "sweep.nothing": (
        "The sweep is empty. Vehicles: {vehicles}, routes: {routes}, seeds: {seeds}. Expected one or more of "
        "each. Type: {fix}"
    ),
    "sweep.mixed": "A sweep accepts vehicles or runs, not both. The list of vehicles contains a {value}.",
    "sweep.route": (
        "A sweep drives routes, such as guides.shapes.eight(1.0, 0.25) or the name of a taught route. Found: {value}."
    ),
    "sweep.of-runs": (
        "A recorded run is replayed, so only its estimator can vary. To compare controllers, guides or routes, "
        "simulate drives: give a vehicle instead of runs."
    ),
    "sweep.no-distributed": "A cluster needs the package distributed. Type: {fix}",
    "sweep.no-cluster": "No Dask scheduler answers at {address}: {cause}. Start one: dask scheduler.",
    "cli.sweep": "drives: {drives}",
}
