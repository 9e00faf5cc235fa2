"""English sentences of the front door: own blocks, results that are shown, notebooks."""

TEMPLATES: dict[str, str] = {
    "block.not-a-block": (
        '{room}={found}: expected a kind of ours, "file.py:Class", or a class or an object with init() and step().'
    ),
    "block.of-other-room": "{block} was given as the {room}, and its step() is that of a {other}. Type: {fix}",
    "front.more": "{lines} lines more: .table()",
    "front.fit": "Fit of {vehicle} to {runs}: {known} of {parameters} parameters known",
    "front.across-true": "{cm:.2g} cm rms across the path",
    "front.across-estimate": "{cm:.2g} cm as it believed",
    "front.position-off": "estimated position {cm:.2g} cm rms off",
    "front.across-first": "{cm:.2g} cm across the first run's path",
    "front.whole": "the whole table",
    "front.rows-more": "{rows} rows more in the whole table",
    "front.card-fit": "Fit of {vehicle} to {runs}",
    "front.card-run": "{run}: {kind}, {duration_s:.1f} s",
    "front.card-comparison": "Comparison of {runs:.0f} runs",
    "front.card-tuned": "Gains of {vehicle}",
    "front.card-check": "{block}, as {room}",
    "front.card-forecast": "Forecast",
    "front.plot-unknown": "there is no drawing {found} of a {result}. {near}.",
    "front.nothing-to-draw": "this {result} holds nothing to draw{kind}.",
    "front.no-page": "a report of {found}: expected a run or a fit.",
    "front.format-unknown": "figures as {found}: that is not written here. {near}.",
    "front.missing": "{package} is not installed, and {what} needs it. Type: {fix}",
    "front.several-panels": "this drawing has {panels} panels, and an axes holds one. Give figure= in place of ax=.",
    "front.width-unknown": "a width of {found}: expected millimetres, or a name. {near}.",
    "front.width-mm": "a width of {found:g} mm: expected 20 to 2000.",
    "drive.text-unknown": (
        "the text of {room} {block} is not in this run: Python does not know it. Write it in a file or in a cell."
    ),
    "drive.no-vehicle-in-run": '{run} holds no vehicle file. Give one: replay(run, load("vehicle.toml")).',
}
