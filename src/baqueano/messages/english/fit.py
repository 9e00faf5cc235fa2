"""English sentences about a fit: verdict, parameters that were not identified, choice of the cost, held-out runs."""

FIXED_AT_TEXT = "the parameter is fixed at {value:.4g}"

TEMPLATES: dict[str, str] = {
    "verdict.refused": "the vehicle file is not changed",
    "verdict.warn": "usable with these warnings",
    "verdict.more": "and {count} more: {type[--report fit.html]} shows all, with figures",
    "verdict.more-in-report": "and {count} more: the report shows all, with figures",
    "fit.converged": "converged, and the model explains the measurements",
    "fit.not-converged": (
        "the search did not converge. Give better start values, with {arg[start]:…}, or free "
        "fewer parameters, with {fix}"
    ),
    "fit.not-converged-moving": (
        "the search did not converge: {subject} still changed. Give better start values, with "
        "{arg[start]:…}, or free fewer parameters, with {fix}"
    ),
    "fit.explains-nothing": (
        "the model explains only {percent:.0f} % of its best channel. Did the vehicle move? Do the signs "
        "and units of commands and sensors agree with the file?"
    ),
    "fit.channel-far-from-model": (
        "the error of {subject} is {ratio:.3g} times its own variation: the model does not predict it "
        "at all. Are its unit, scale and sign right? Or fit without this channel: name the other "
        "channels with {fix}"
    ),
    "fit.nothing-identifiable": (
        "the data determine none of the {total} parameters. Do axes, signs and units agree with the file?"
    ),
    "fit.most-unidentifiable": "the data do not determine {missing_count} of {total} parameters",
    "fit.most-poor": "of {total} parameters {weak_count} are poorly identified. {reason}",
    "fit.most-not-identified": (
        "of {total} parameters {missing_count} are not identifiable and {weak_count} are poorly identified. {reason}"
    ),
    "fit.speed-unknown": (
        "the data do not determine {names}, so the model may predict a wrong speed. Drive faster and longer. "
        "Type: {fix}"
    ),
    "fit.little-motion": (
        "The runs are too short, or the motion is too small: drive longer, with larger commands"
    ),
    "fit.incomplete-model": (
        "The residuals of {subject} are autocorrelated and large, so the model lacks a part of this motion, and all "
        "error bars are wide. Longer drives do not help. Test further terms: type {fix}; or begin with better "
        "guesses of friction and lag"
    ),
    "fit.poor": "the data hardly determine {names}",
    "fit.unidentifiable": "parameters that are not identifiable: {count}",
    "fit.duty-step": (
        "the run shows that duties come in steps of 1/{steps}: duty_step was added to [model.drivetrain]"
    ),
    "envelope.range": "{subject} from {low:.2g} to {high:.2g}",
    "fit.envelope": "fitted to {ranges}; outside this range, the model is not verified",
    "bound.low-held": "{subject} is at its lower bound, {bound:.4g}",
    "bound.high-held": "{subject} is at its upper bound, {bound:.4g}",
    "bound.integrable": (
        "the lower bound of {subject} is the least value that a step of the integrator permits with the fitted friction"
    ),
    "bound.high-default": (
        "{subject} is at its upper bound, {bound:.4g}. This bound is not physical. Type: {fix}"
    ),
    "bound.low-by-chance": (
        "{subject} is at its lower bound, {bound:.4g}. The unconstrained estimate is less than 3 "
        "standard errors below it, so noise can explain this"
    ),
    "bound.high-by-chance": (
        "{subject} is at its upper bound, {bound:.4g}. The unconstrained estimate is less than 3 "
        "standard errors above it, so noise can explain this"
    ),
    "runs.little-motion": (
        "in {count} of {total} runs ({runs}) the error of {subject} is larger than its variation. This "
        "variation is smaller than the error of the model in the other runs, so these runs have little "
        "weight"
    ),
    "runs.unlike-model": (
        "in {count} of {total} runs ({runs}) the error of {subject} is larger than its variation. Were the "
        "vehicle, the floor and the battery the same? Fit these runs separately"
    ),
    "identifiability.poor": "{subject} is poorly identified{reason}. {advice}",
    "identifiability.poor-pair": "{subject} and {others} cannot be separated reliably{reason}. {advice}",
    "identifiability.fixed": f"the data do not determine {{subject}}{{reason}}; {FIXED_AT_TEXT}. {{advice}}",
    "identifiability.fixed-pair": (
        "{subject} and {others} cannot be separated reliably{reason}; {subject} is fixed at {value:.4g}. {advice}"
    ),
    "identifiability.scale": (
        f"{{subject}} cannot be identified better than ± 3 %, as in a data sheet; {FIXED_AT_TEXT}. {{advice}}"
    ),
    "identifiability.collinear": (
        "{subject} and {others} are not separable: only their combination affects the data. {subject} is fixed at "
        "{value:.4g}. {advice}{motion}"
    ),
    "identifiability.measure": "Measure it with {tool:word}",
    "identifiability.fix-one": "Fix one of them at a value from another source",
    "identifiability.separate": ", or separate them with {motion:word}",
    "identifiability.separate-by-two": ", or separate them with {first:word} and with {second:word}",
    "identifiability.little-sideways": ": the vehicle moved too little sideways",
    "identifiability.few-speeds": ": the vehicle drove at too few different speeds",
    "identifiability.few-turn-rates": ": the vehicle turned at too few different rates",
    "identifiability.needs": "This needs {motion:word}",
    "identifiability.needs-bound": (
        "This needs {motion:word}. If the delay can be longer than {bound:.4g} s, enlarge its bound. Type: {fix}"
    ),
    "identifiability.needs-command": "This needs {command:word} commands, and {motion:word} motion caused by them",
    "identifiability.needs-run": "This needs a run in which the parameter has an effect",
    "identifiability.command-still": (
        "{names}: {command} was 0 all the time. To identify this, record a run in which the command changes"
    ),
    "identifiability.no-command": (
        "the data do not depend on {names}, because the vehicle cannot move {command}"
    ),
    "identifiability.no-sideways-command": (
        "the data do not depend on {names}, because the vehicle cannot be driven sideways"
    ),
    "identifiability.gyro-scale": (
        "{subject}: its gyro scale is not identifiable, so it is fixed at {value:.4g} ± "
        "{percent:.2g} %. Speeds have the same relative error. To measure it, turn the vehicle "
        "twice on its mark by hand, with a rest before and after. Type: {fix}"
    ),
    "identifiability.accelerometer-scale": (
        "{subject}: its accelerometer scale is not identifiable, so it is fixed at {value:.4g} ± "
        "{percent:.2g} %. Speeds have the same relative error. To measure it, put the vehicle on "
        "a known slope"
    ),
    "battery.shown": (
        "the battery had {high_v:.4g} to {low_v:.4g} V, and the motion follows its voltage: "
        "drivetrain.battery_effect is {value:.2f} ± {half_width:.2g} (95 %). So the fit uses the logged voltage"
    ),
    "battery.not-shown": (
        "the battery had {high_v:.4g} to {low_v:.4g} V. The motion does not show its effect: "
        "drivetrain.battery_effect would be {value:.2f} ± {half_width:.2g} (95 %). The fit does not use the voltage"
    ),
    "battery.not-used": (
        "the battery had {high_v:.4g} to {low_v:.4g} V. The fit does not use this voltage, because its effect is "
        "{reason}"
    ),
    "bias.at-rest": "{subject}: gyro_bias = {bias_rad_s:.4f} ± {std_rad_s:.2g} rad/s was measured at rest, in {runs}",
    "bias.no-rest": (
        "{subject}: gyro_bias was not measured, because no run contains a rest of {rest_s:g} s without a command. A "
        "bias has the same effect as an offset of the steering, so that offset has a wide error bar. Leave the "
        "vehicle at rest for 3 s"
    ),
    "bias.contradicts-file": (
        "{subject} differs from the file's {value:.4g} ± {prior_std:.2g}{unit} by more than noise explains. The new "
        "value is written, with its error ± {std:.2g}"
    ),
    "bias.file-better": (
        "{subject}: the error from the runs, ± {std:.2g}{unit}, is larger than the error in the file, ± "
        "{prior_std:.2g}. The file keeps its value {value:.4g}. To measure the bias, leave the vehicle at "
        "rest for 3 s"
    ),
    "delay.sum": (
        "drivetrain.delay_s is a sum, because a run does not separate its terms: the delays of the motors and of "
        "{subject}, and short lags that the model lacks. If the data sheet gives the filter, write low_pass_hz into "
        "[sensors.{subject}]"
    ),
    "bias.tilt-sum": (
        "a run identifies only the sum of the tilt of {subject} and the bias of its accelerometers. "
        "accel_bias is that sum minus the effect of tilt_rad in the file"
    ),
    "truth.horizon": (
        "the model was compared with the {subject} over {span_s:.2g} s, {distance_m:.2g} m of path. In longer "
        "drives the result may differ"
    ),
    "truth.horizon-of-pieces": (
        "the model was compared with the {subject} over {span_s:.2g} s, {distance_m:.2g} m of path, each time "
        "from a new start. In longer drives the result may differ"
    ),
    "truth.mount": "{subject}: add these values to those in [truth] of the map: {keys}",
    "noise.of-sensor": "{sensor}: {values}",
    "noise.without-floor": "noise of the sensors without the disturbance of the floor: {noise}",
    "cost.floor-still": (
        "use the simulation error. A floor that disturbs the vehicle does not explain more (likelihood "
        "ratio {ratio:.1f}, probability by chance {chance}). Besides, simulation is the harder test of a "
        "model"
    ),
    "cost.too-short": (
        "use the simulation error. The floor disturbs the vehicle by {floor} in 1 s (likelihood ratio "
        "{ratio:.1f}, probability by chance {chance}). The run is too short to reserve segments for a test"
    ),
    "cost.neither": (
        "neither fit is reliable: the model is incomplete. If you must choose, use the simulation-error "
        "fit. The two fits differ by {difference:.1f} standard errors ({subject}), and {open_loop}. The "
        "error of the model looks like a disturbance of {floor} in 1 s (likelihood ratio {ratio:.1f}, "
        "probability by chance {chance})"
    ),
    "cost.innovations": (
        "use the innovations. The floor disturbs the vehicle by {floor} in 1 s (likelihood ratio "
        "{ratio:.1f}, probability by chance {chance}). The two fits differ by {difference:.1f} standard errors "
        "at most, and {open_loop}"
    ),
    "cost.simulation": (
        "use the simulation error. The floor disturbs the vehicle by {floor} in 1 s (likelihood ratio "
        "{ratio:.1f}, probability by chance {chance}). The two fits differ by {difference:.1f} standard errors "
        "at most, but {open_loop}"
    ),
    "cost.diverged": "on held-out segments the innovations fit diverges in open loop",
    "cost.smaller": (
        "on held-out segments the open-loop error of the innovations fit is {percent:.2g} % smaller"
    ),
    "cost.larger": (
        "on held-out segments the open-loop error of the innovations fit is {percent:.2g} % larger"
    ),
    "cost.held-out-smaller": (
        "use the innovations. On the held-out runs the open-loop error of the innovations fit is {percent:.2g} % "
        "smaller"
    ),
    "cost.held-out-larger": (
        "use the simulation error. On the held-out runs the open-loop error of the innovations fit is {percent:.2g} % "
        "larger"
    ),
    "cost.try-innovations": "{cause}. Type: {fix}",
    "validation.carries-over": "the model remains valid over {basis}",
    "validation.checked": "checked over {basis}",
    "validation.basis": "{span_s} s in open loop {start}, with {pieces:.3g} independent segments of motion",
    "validation.from-standstill": "from standstill",
    "validation.from-velocity": "from a fitted velocity",
    "validation.some-from-velocity": "from a fitted velocity in {count} of {total} runs",
    "validation.shared-fault": "held-out runs of the same log cannot refute the warning of the fit about {subject}",
    "validation.no-variation": (
        "{subject} does not vary in the held-out runs. Hold out {min_s:.0f} s or more in which it "
        "rises and falls"
    ),
    "validation.too-few": (
        "{subject} has {pieces:.2g} independent segments of motion in the held-out runs. With fewer "
        "than {minimum}, a wrong model can pass by chance. Hold out {min_s:.0f} s or more in which it "
        "rises and falls"
    ),
    "validation.worse-than-mean": (
        "in {run} the model explains {variance_percent:.4g} % of {subject}: a constant equal to its mean would "
        "predict it better. The error is {error:.3g}{unit}. Check signs, units and mounting, or include "
        "runs with this motion in the fit"
    ),
    "validation.error": (
        "in {run} the error of {subject} is {error:.3g}{unit}, {ratio:.1f} times the noise. The model "
        "explains {variance_percent:.4g} % of this channel, and {fit_variance_percent:.4g} % in the runs of the fit"
    ),
    "validation.error-possible": (
        "{finding}. The runs are too short, or sampled too rarely, to exclude chance: hold out more data"
    ),
    "validation.error-in-part": (
        "in {run} the error of {subject} is {error:.3g}{unit} from {start_s:.0f} s to {end_s:.0f} s, but "
        "small elsewhere. Did something happen then? Cut that part off with {fix}, or include "
        "such a run in the fit"
    ),
}
