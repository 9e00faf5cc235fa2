"""English sentences of the Python functions, about blocks of the user, displayed results and notebooks."""

TEMPLATES: dict[str, str] = {
    "block.not-a-block": (
        '{role}={value} is not a block. Expected the name of a block, "file.py:Class", or a '
        "class or object with init() and step()."
    ),
    "block.lacks-method": "{role}={block} does not have the method {method}(). A block needs init() and step().",
    "block.of-other-role": (
        "{place} {block}.step({names}) was given as {role:word}, but the step of that type "
        "takes ({expected}). If it is the {actual_role:word}, type: {fix}"
    ),
    "block.step-arguments": (
        "{place} {block}.step({names}) was given as {role:word}, but the step of that type "
        "takes ({expected})."
    ),
    "call.missing": "{call}() needs more arguments: {names}. Type: {fix}",
    "call.positions": "Too many arguments of {call}() without names: at most {maximum}. Type: {fix}",
    "call.order": "The arguments of {call}() are in the wrong order. Type: {fix}",
    "call.unknown": "{call}() does not accept {value}. {suggestion}. Type: {fix}",
    "call.kind": "{call}(): {name} = {value}; expected {expected:word}. Type: {fix}",
    "call.of-other-argument": "{call}(): this value of {name} belongs to {function}. Type: {fix}",
    "front.no-attribute": "{owner} does not have attribute {value}. {suggestion}.",
    "call.option-of": "{call}() does not accept {value}, which is an option of {owner}. Add: {fix}",
    "front.advice": "Type: {fix}",
    "front.more": "more lines ({lines}): .table()",
    "front.fit": "Fit of {vehicle} to {runs}: {count} of {parameters} parameters have an estimate",
    "front.across-true": "{cm:.3g} cm rms across the path",
    "front.across-estimate": "{cm:.3g} cm according to its estimate",
    "front.position-off": "error of the estimated position {cm:.3g} cm rms",
    "front.across-first": "{cm:.3g} cm across the path of the first run",
    "front.whole": "the whole table",
    "front.route": "Route({poses} poses, {duration_s:.1f} s, {length_m:.2f} m, {ends:word})",
    "front.page": "Page('{title}', {sections} sections, {drawings} figures)",
    "front.vehicle": (
        "{vehicle} ({layers}): {model} at {rate_hz:g} Hz, commands {commands} [{unit_name}], sensors {sensors}"
    ),
    "front.rows-more": "the whole table has {rows} more rows",
    "front.card-fit": "Fit of {vehicle} to {runs}",
    "front.card-run": "{run}: {kind}, {duration_s:.1f} s",
    "front.card-comparison": "Comparison of runs: {runs:.0f}",
    "front.card-tuned": "Gains of {vehicle}",
    "front.card-check": "{block}, as {role}",
    "front.card-forecast": "Forecast",
    "front.card-route": "Route",
    "front.card-vehicle": "Vehicle file {vehicle}",
    "front.card-first-drive": "First drive: {run}",
    "front.card-closure": "Scales from the marks of a drive",
    "front.card-calibration": "Calibration of the sensors of {run}",
    "front.card-validation": "Test on held-out runs",
    "front.card-history": "{vehicle} over {runs} runs",
    "front.plot-unknown": "A {result} does not have the plot {value}. {suggestion}.",
    "front.no-data": "This {result} does not contain the data for the plot {value}. Its plots are {kinds}.",
    "front.nothing-to-draw": "This {result} does not contain the data for a plot.",
    "report.animation-ending": "{value}: expected a name that ends in .svg. Type: {fix}",
    "report.nothing-moves": (
        "Run {name} contains neither an estimate nor a truth, so it cannot be animated. Type: {fix}"
    ),
    "front.no-page": (
        "A report needs a run, a fit, a comparison, a forecast, a sweep, sensors at rest, or parameters over "
        "several runs. Found: {value}. For several runs, type: bq.report(bq.compare(runs))"
    ),
    "front.page-as-figure": (
        "A page is an HTML file, such as fit.html: {value} is a figure. For the figures, type: {fix}"
    ),
    "front.format-unknown": "Figures cannot be written as {value}. {suggestion}.",
    "front.save-file": (
        "{owner} does not have attribute save. Its values are saved as a vehicle file. Type: {fix}"
    ),
    "front.missing": "{package} is not installed, and {feature:word} needs it. Type: {fix}",
    "front.several-panels": (
        "This plot has {panels} panels, but an axes contains only one. Give figure= instead of ax=."
    ),
    "front.width-unknown": "The width {value} is not valid. Expected millimetres, or a name. {suggestion}.",
    "front.width-mm": "The width {value:g} mm is out of range. Expected 20 to 2000 mm.",
    "drive.text-unknown": (
        "This run does not contain the code of {role} {block}, because Python cannot find it. Write the "
        "class in a file or in a notebook cell."
    ),
    "drive.no-vehicle-in-run": (
        '{run} does not contain a vehicle file. Give one: replay(run, load("vehicle.toml")).'
    ),
}
