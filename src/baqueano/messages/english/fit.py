"""English sentences of a fit: its verdict, what it did not identify, which cost to believe, and unseen runs."""

HELD = "it is fixed at {at:.4g}"

TEMPLATES: dict[str, str] = {
    "verdict.refused": "the vehicle file stays as it is",
    "verdict.warn": "usable with these warnings",
    "verdict.more": "and {more} more: --report fit.html shows all, with figures",
    "verdict.more-in-report": "and {more} more: the report shows all, with figures",
    "fit.converged": "converged, and the model explains the measurements",
    "fit.not-converged": (
        "the search did not converge. Start from better values in the vehicle file, as --set KEY=VALUE, or free fewer "
        "parameters, as {fix}"
    ),
    "fit.not-converged-moving": (
        "the search did not converge, {subject} still changed. Start from better values in the vehicle file, as --set "
        "{key}=VALUE, or free fewer parameters, as {fix}"
    ),
    "fit.explains-nothing": (
        "the model explains only {percent:.0f} % of its best channel. Did the vehicle move, and do the signs and units "
        "of commands and sensors agree with the file?"
    ),
    "fit.far-channel": (
        "{subject} is {times:.3g} times as far from the model as from its own mean. Are its unit, scale and sign "
        "right? Or fit without it: name the others with {fix}"
    ),
    "fit.nothing-seen": (
        "the data determine none of the {asked} parameters. Do axes, signs and units agree with the file?"
    ),
    "fit.most-unseen": "the data do not determine {unseen} of {asked} parameters",
    "fit.most-weak": (
        "of {asked} parameters {weak} are poorly identified. The data are too few or too quiet: drive longer, and "
        "harder"
    ),
    "fit.most-unseen-or-weak": (
        "of {asked} parameters {unseen} are not identifiable and {weak} are poorly identified. The data are too few or "
        "too quiet: drive longer, and harder"
    ),
    "fit.weak": "{names}: poorly identified",
    "fit.unseen": "not identifiable: {count}, below",
    "fit.duty-step": (
        "the run shows that duties come in steps of 1/{steps}: duty_step was added to [model.drivetrain]"
    ),
    "fit.envelope": "fitted to {ranges}; outside, it is a guess",
    "bound.low-held": "{subject} is at its low bound, {bound:.4g}",
    "bound.high-held": "{subject} is at its high bound, {bound:.4g}",
    "bound.low-by-chance": (
        "{subject} is at its low bound, {bound:.4g}. The unconstrained estimate is less than 3 standard errors below "
        "it, so noise can explain this"
    ),
    "bound.high-by-chance": (
        "{subject} is at its high bound, {bound:.4g}. The unconstrained estimate is less than 3 standard errors above "
        "it, so noise can explain this"
    ),
    "runs.hardly-moved": (
        "{count} of {of} runs are further from the model in {subject} than from their own mean ({runs}). They moved "
        "less than the error of the model in the others, and hardly count"
    ),
    "runs.unlike-others": (
        "{count} of {of} runs are further from the model in {subject} than from their own mean ({runs}). Was it the "
        "same vehicle, floor and battery? Fit them by themselves"
    ),
    "seen.weakly": "{subject} is poorly identified{why}. {needs}",
    "seen.weakly-beside": "{subject} and {others} are hardly separable{why}. {needs}",
    "seen.not": f"the data do not determine {{subject}}{{why}}; {HELD}. {{needs}}",
    "seen.not-beside": "{subject} and {others} are hardly separable{why}; {subject} is fixed at {at:.4g}. {needs}",
    "seen.scale": f"{{subject}} cannot be identified better than a data sheet gives it, ± 3 %; {HELD}. {{needs}}",
    "seen.tied": (
        f"{{subject}} and {{others}} are not separable: only their combination affects the data; {HELD}. {{how}}"
        "{apart}"
    ),
    "seen.by-hand": "Measure it with {by:word}",
    "seen.fix-one": "Fix one whose value you have from elsewhere",
    "seen.apart": ", or separate them by {motion:word}",
    "seen.apart-by-two": ", or separate them by {first:word} and by {second:word}",
    "seen.hardly-sideways": ": the vehicle hardly moved sideways",
    "seen.few-speeds": ": it drove at too few speeds",
    "seen.few-turn-rates": ": it turned at too few speeds",
    "seen.needs": "This needs {motion:word}",
    "seen.needs-command": "This needs {command:word} commands, and {motion:word} motion caused by them",
    "seen.needs-run": "This needs a run in which it matters",
    "seen.command-still": "{names}: {command} was 0 all the time. This needs a run in which it changes",
    "seen.never": (
        "{names}: the vehicle cannot move {command}, so this is never identifiable and never matters"
    ),
    "seen.never-sideways": (
        "{names}: the vehicle cannot be driven sideways, so this is never identifiable and never matters"
    ),
    "seen.gyro-scale": (
        "{subject}: its gyro scale is not identifiable, so it is fixed at {at:.4g} ± {percent:.2g} %. Speeds have the "
        "same relative error. Turn it twice on its mark, by hand, and rest before and after. Type: {fix}"
    ),
    "seen.accelerometer-scale": (
        "{subject}: its accelerometer scale is not identifiable, so it is fixed at {at:.4g} ± {percent:.2g} %. Speeds "
        "have the same relative error. Lay it on a known slope"
    ),
    "bias.at-rest": "{subject}: gyro_bias = {bias_rad_s:.4f} ± {sd_rad_s:.2g} rad/s was measured at rest, in {runs}",
    "bias.contradicts-file": (
        "{subject} differs from the file's {value:.4g} ± {std:.2g}{unit} by more than noise explains. The new value is "
        "written, with its error ± {sd:.2g}"
    ),
    "bias.file-knows-better": (
        "{subject}: the error from the runs, ± {sd:.2g}{unit}, is larger than that of the file, ± {std:.2g}. The file "
        "keeps its {value:.4g}. To measure it, let the vehicle rest for 3 s"
    ),
    "delay.sum": (
        "a run identifies only the sum of the delay of the motors and that of {subject}, drivetrain.delay_s. If the "
        "data sheet gives the filter, write low_pass_hz into [sensors.{subject}]"
    ),
    "truth.horizon": (
        "{subject}: the model was compared with it over {span_s:.2g} s, {way_m:.2g} m of way. Longer drives may differ"
    ),
    "truth.horizon-of-pieces": (
        "{subject}: the model was compared with it over {span_s:.2g} s, {way_m:.2g} m of way, with a new start each "
        "time. Longer drives may differ"
    ),
    "truth.mount": "{subject}: into [truth] of the map, added to what stands there: {keys}",
    "noise.without-floor": "noise of the sensors without the disturbance of the floor: {noise}",
    "cost.floor-still": (
        "use the simulation error. A disturbed floor explains no more (likelihood ratio {ratio:.1f}, by chance "
        "{chance}), and simulation is the harder test of a model"
    ),
    "cost.too-short": (
        "use the simulation error. The floor disturbs the vehicle by {floor} in 1 s (likelihood ratio {ratio:.1f}, by "
        "chance {chance}). The run is too short to hold segments out"
    ),
    "cost.neither": (
        "neither fit is reliable: the model is incomplete. If you must choose, use the simulation-error fit. The two "
        "fits differ by {apart:.1f} standard errors ({subject}), and {open_loop}. The model's defect looks like a "
        "disturbance of {floor} in 1 s (likelihood ratio {ratio:.1f}, by chance {chance})"
    ),
    "cost.innovations": (
        "use the innovations. The floor disturbs the vehicle by {floor} in 1 s (likelihood ratio {ratio:.1f}, by "
        "chance {chance}). The two fits differ by {apart:.1f} standard errors at most, and {open_loop}"
    ),
    "cost.simulation": (
        "use the simulation error. The floor disturbs the vehicle by {floor} in 1 s (likelihood ratio {ratio:.1f}, by "
        "chance {chance}). The two fits differ by {apart:.1f} standard errors at most, but {open_loop}"
    ),
    "cost.runs-away": "on held-out segments the innovations fit diverges in open loop",
    "cost.smaller": (
        "on held-out segments the open-loop error of the innovations fit is {percent:.2g} % smaller"
    ),
    "cost.larger": (
        "on held-out segments the open-loop error of the innovations fit is {percent:.2g} % larger"
    ),
    "cost.try-innovations": "{cause}. Type: {fix}",
    "unseen-runs.carries-over": "the model carries over {basis}",
    "unseen-runs.checked": "checked over {basis}",
    "unseen-runs.basis": "{span_s} s open loop {start}, in {pieces:.3g} independent segments of motion",
    "unseen-runs.from-standstill": "from standstill",
    "unseen-runs.from-velocity": "from a fitted velocity",
    "unseen-runs.some-from-velocity": "from a fitted velocity in {count} of {of} runs",
    "unseen-runs.still": (
        "{subject} does not move in the held-out runs. Hold out {needed_s:.0f} s or more in which it moves to and fro"
    ),
    "unseen-runs.too-few": (
        "{subject} has {pieces:.2g} independent segments of motion in the held-out runs. With fewer than {least}, a "
        "wrong model may pass by chance. Hold out {needed_s:.0f} s or more in which it moves to and fro"
    ),
    "unseen-runs.worse-than-mean": (
        "for {subject} of {run} the model explains {explained:.4g} %, less than the mean does: it is off by "
        "{error:.3g}{unit}. Compare signs, units and mounting, or fit to runs with this motion"
    ),
    "unseen-runs.off": (
        "{subject} of {run} is off by {error:.3g}{unit}, {times:.1f} times what noise explains. The model explains "
        "{explained:.4g} % of it, and {of_own:.4g} % of the fitted runs"
    ),
    "unseen-runs.off-perhaps": (
        "{off}. The runs are too short, or sampled too rarely, to exclude chance: hold out more"
    ),
    "unseen-runs.off-once": (
        "{subject} of {run} is off by {here:.3g}{unit} from {from_s:.0f} s to {to_s:.0f} s, but not elsewhere. Did "
        "something happen there? Cut it off with baqueano runs cut {run} --to {from_s:.0f}, or fit to such a run"
    ),
}
