"""English sentences of a fit: its verdict, what it did not identify, which cost to believe, and unseen runs."""

HELD = "held at {at:.4g}"

TEMPLATES: dict[str, str] = {
    "verdict.refused": "the vehicle file stays as it is",
    "verdict.warn": "usable with these doubts",
    "verdict.more": "and {more} more: --report fit.html shows all, with figures",
    "verdict.more-in-report": "and {more} more: the report shows all, with figures",
    "fit.converged": "converged, and the model explains what was measured",
    "fit.not-converged": (
        "the search did not converge. Begin with better numbers in the vehicle file, as --set KEY=VALUE, or free less, "
        "as {fix}"
    ),
    "fit.not-converged-moving": (
        "the search did not converge, {subject} still moved. Begin with better numbers in the vehicle file, as --set "
        "{key}=VALUE, or free less, as {fix}"
    ),
    "fit.explains-nothing": (
        "the model explains {percent:.0f} % of its best channel, no more. Did the vehicle move, and do the signs and "
        "units of commands and sensors agree with the file?"
    ),
    "fit.far-channel": (
        "{subject} is {times:.3g} times as far from the model as from its own mean. Are its unit, scale and sign "
        "right? Or fit without it: name the others with {fix}"
    ),
    "fit.nothing-seen": (
        "the measurements show none of the {asked} parameters. Do axes, signs and units agree with the file?"
    ),
    "fit.most-unseen": "the measurements do not show {unseen} of {asked} parameters",
    "fit.most-weak": (
        "of {asked} parameters {weak} have a large error only. The data are too few or too quiet: drive longer, and "
        "harder"
    ),
    "fit.most-unseen-or-weak": (
        "of {asked} parameters {unseen} are not seen and {weak} have a large error only. The data are too few or too "
        "quiet: drive longer, and harder"
    ),
    "fit.weak": "{names}: known with a large error only",
    "fit.unseen": "not seen: {count}, below",
    "fit.duty-step": (
        "the run shows that duties come in steps of 1/{steps}: duty_step was taken into [model.drivetrain]"
    ),
    "fit.envelope": "fitted to {ranges}; beyond, it is a guess",
    "bound.low-held": "{subject} is at its low bound, {bound:.4g}",
    "bound.high-held": "{subject} is at its high bound, {bound:.4g}",
    "bound.low-by-chance": (
        "{subject} is at its low bound, {bound:.4g}. The estimate without it is less than 3 standard errors beyond, "
        "so noise can explain this"
    ),
    "bound.high-by-chance": (
        "{subject} is at its high bound, {bound:.4g}. The estimate without it is less than 3 standard errors beyond, "
        "so noise can explain this"
    ),
    "runs.hardly-moved": (
        "{count} of {of} runs are further from the model in {subject} than from their own mean ({runs}). They moved by "
        "less than the model errs in the others, and hardly count"
    ),
    "runs.unlike-others": (
        "{count} of {of} runs are further from the model in {subject} than from their own mean ({runs}). Was it the "
        "same vehicle, floor and battery? Fit them by themselves"
    ),
    "seen.weakly": "{subject} has a large error only{why}. {needs}",
    "seen.weakly-beside": "{subject} and {others} are hardly separable{why}. {needs}",
    "seen.not": f"the measurements do not show {{subject}}{{why}}; {HELD}. {{needs}}",
    "seen.not-beside": f"{{subject}} and {{others}} are hardly separable{{why}}; {{subject}} {HELD}. {{needs}}",
    "seen.scale": f"{{subject}} would be known no better than from a data sheet, ± 3 %; {HELD}. {{needs}}",
    "seen.tied": (
        f"{{subject}} cannot be told from {{others}}: only their combination acts on what is measured; {HELD}. {{how}}"
        "{apart}"
    ),
    "seen.by-hand": "Take it from {by}",
    "seen.fix-one": "Fix one that you know from elsewhere",
    "seen.apart": ", or tell them apart by {motion}",
    "seen.apart-by-two": ", or tell them apart by {first} and by {second}",
    "seen.hardly-sideways": ": the vehicle hardly moved sideways",
    "seen.few-speeds": ": it drove at too few speeds",
    "seen.few-turn-rates": ": it turned at too few speeds",
    "seen.needs": "This needs {motion}",
    "seen.needs-command": "This needs {command} commands, and {motion} motion that comes of them",
    "seen.needs-run": "This needs a run in which it matters",
    "seen.command-still": "{names}: {command} was 0 all the time. This needs a run in which it moves",
    "seen.never": "{names}: the vehicle cannot move {command}, so this can never be seen and never matters",
    "seen.never-sideways": (
        "{names}: the vehicle has no sideways actuator, so this can never be seen and never matters"
    ),
    "seen.gyro-scale": (
        "{subject}: its gyro scale is not identifiable, held at {at:.4g} ± {percent:.2g} %: speeds are wrong by as "
        "much. Turn it twice on its mark, by hand, and rest before and after. Type: {fix}"
    ),
    "seen.accelerometer-scale": (
        "{subject}: its accelerometer scale is not identifiable, held at {at:.4g} ± {percent:.2g} %: speeds are wrong "
        "by as much. Lay it on a known slope"
    ),
    "bias.at-rest": "{subject}: gyro_bias = {bias_rad_s:.4f} ± {sd_rad_s:.2g} rad/s was measured at rest, in {runs}",
    "bias.contradicts-file": (
        "{subject} is further from the file's {value:.4g} ± {std:.2g}{unit} than chance allows. It is written, with "
        "its error ± {sd:.2g}"
    ),
    "bias.file-knows-better": (
        "{subject} is known to ± {sd:.2g}{unit} by the runs and to ± {std:.2g} by the file. The file keeps its "
        "{value:.4g}. To measure it, let the vehicle rest for 3 s"
    ),
    "delay.sum": (
        "a run shows the delay of the motors and that of {subject} as a sum, drivetrain.delay_s. If the data sheet "
        "tells the filter, write low_pass_hz into [sensors.{subject}]"
    ),
    "truth.horizon": (
        "{subject}: the model was compared with it over {span_s:.2g} s, {way_m:.2g} m of way. Longer drives may differ"
    ),
    "truth.horizon-of-pieces": (
        "{subject}: the model was compared with it over {span_s:.2g} s, {way_m:.2g} m of way, each time from a start "
        "of its own. Longer drives may differ"
    ),
    "truth.mount": "{subject}: into [truth] of the map, added to what stands there: {keys}",
    "noise.without-floor": "noise of the sensors without the floor: {noise}",
    "cost.floor-still": (
        "believe the simulation error. A floor that moves explains no more (likelihood ratio {ratio:.1f}, by chance "
        "{chance}), and a simulation is the harder test of a model"
    ),
    "cost.too-short": (
        "believe the simulation error. The floor disturbs the vehicle by {floor} in 1 s (likelihood ratio {ratio:.1f}, "
        "by chance {chance}), but the run is too short to leave segments out"
    ),
    "cost.neither": (
        "believe neither fit: the model is incomplete. If you must choose, believe the simulation error. The two "
        "answers are {apart:.1f} standard errors apart ({subject}), and {open_loop}. What looks like a disturbance of "
        "{floor} in 1 s (likelihood ratio {ratio:.1f}, by chance {chance}) is what the model lacks"
    ),
    "cost.innovations": (
        "believe the innovations. The floor disturbs the vehicle by {floor} in 1 s (likelihood ratio {ratio:.1f}, by "
        "chance {chance}). The two answers are {apart:.1f} standard errors apart at most, and {open_loop}"
    ),
    "cost.simulation": (
        "believe the simulation error. The floor disturbs the vehicle by {floor} in 1 s (likelihood ratio {ratio:.1f}, "
        "by chance {chance}). The two answers are {apart:.1f} standard errors apart at most, but {open_loop}"
    ),
    "cost.runs-away": "on segments left out the model by the innovations runs away",
    "cost.smaller": "on segments left out the innovations' error in open loop is {percent:.2g} % smaller",
    "cost.larger": "on segments left out the innovations' error in open loop is {percent:.2g} % larger",
    "cost.try-innovations": "{cause}. Type: {fix}",
    "unseen-runs.carries-over": "the model carries over {basis}",
    "unseen-runs.checked": "checked over {basis}",
    "unseen-runs.basis": "{span_s} s open loop {start}, in {pieces:.3g} independent pieces of motion",
    "unseen-runs.from-standstill": "from standstill",
    "unseen-runs.from-velocity": "from a fitted velocity",
    "unseen-runs.some-from-velocity": "from a fitted velocity in {count} of {of} runs",
    "unseen-runs.still": (
        "{subject} does not move in the held-out runs. Hold out {needed_s:.0f} s or more in which it goes to and fro"
    ),
    "unseen-runs.too-few": (
        "{subject} makes {pieces:.2g} independent pieces of motion in the held-out runs, and chance passes fewer than "
        "{least}. Hold out {needed_s:.0f} s or more in which it goes to and fro"
    ),
    "unseen-runs.worse-than-mean": (
        "of {subject} of {run} the model explains {explained:.4g} %, less than its mean does: it is off by "
        "{error:.3g}{unit}. Compare signs, units and mounting, or fit to runs with this motion"
    ),
    "unseen-runs.off": (
        "{subject} of {run} is off by {error:.3g}{unit}, {times:.1f} times what noise explains: the model explains "
        "{explained:.4g} % of it, and {of_own:.4g} % of the fitted runs"
    ),
    "unseen-runs.off-perhaps": "{off}. The runs are too short, or read too seldom, to exclude chance: hold out more",
    "unseen-runs.off-once": (
        "{subject} of {run} is off by {here:.3g}{unit} from {from_s:.0f} s to {to_s:.0f} s, and nowhere else. Did "
        "something happen there? Cut it with baqueano runs cut, or fit to such a run"
    ),
}
