"""English sentences of what a fit, its noise and its experiments refuse to do."""

ASK = (
    "Leave it alone on its mark for 3 s, turn it by hand two whole turns on the floor, put it back on the mark, and "
    "leave it alone for 3 s again."
)
TEMPLATES: dict[str, str] = {
    "led.not-an-imu": (
        "{arg[use]:{use}}: {vehicle} has these IMUs: {known}; expected one of them to lead the fit. Name it, or "
        "describe it in the file under [sensors.imu]."
    ),
    "led.which-imu": (
        "{vehicle} has these IMUs: {known}; expected one to fit the vehicle by. Name it with {arg[use]}, or describe "
        "it in the file under [sensors.imu]."
    ),
    "allan.averages": "{samples} samples can be averaged over 1 to {most}, not over {found}.",
    "allan.numbers": "an Allan deviation needs a list of at least {least} finite numbers; this has {found}.",
    "allan.rate": "rate_hz = {rate_hz:g}: expected samples a second, above 0.",
    "at-rest.driven": "{run} is driven all the time, so it never stands: noise at rest needs a run without commands.",
    "at-rest.few-samples": (
        "{run} holds no sensor with {least} samples at rest. Record a minute or more with the motors off and "
        "nobody near."
    ),
    "at-rest.no-imu": "{run} has no sensor with three channels that is an IMU of {vehicle}: nothing to write.",
    "at-rest.no-tick": "{run} has no tick between those times.",
    "battery.no-voltage": (
        "the effect of the battery is asked for, and no run holds its voltage: expected a channel {channel} "
        "in V. Import it as [sensors.{channel}], or leave model.drivetrain.battery_effect out."
    ),
    "battery.other-voltage": (
        "{run}: the battery had {voltage_v:.3g} V, and battery_nominal_v of the vehicle file is "
        "{nominal_v:g} V: expected about the same. Write the battery's voltage into [model.drivetrain] "
        "battery_v and battery_nominal_v."
    ),
    "choose.no-command": "there is no command in the runs, so there is nothing to choose by.",
    "choose.no-term": ('candidates = "{found}": a {kind} has no such term. {near}, and paths as model.…'),
    "choose.options": "a choice of terms takes no {options}: choose first, and fit what was chosen with it afterwards.",
    "choose.pose": "terms are chosen by speeds and accelerations: leave a camera's pose out of {arg[use]}.",
    "choose.short": (
        "the runs to judge by last {total_s:.1f} s in all: expected at least {needed_s:.0f} s to hold "
        "something out. Drive longer, or leave --choose out."
    ),
    "clock.not-believed": (
        "{arg[clocks]:{sensor}}: expected one of the sensors that are believed, {known}. Believe another of "
        "the vehicle file, or the truth, with {arg[use]}."
    ),
    "cost.free-clock": (
        "the clock of {clocks} is free, and a filter cannot wait for what a later row shows. Find it first, "
        "and calibrate the run by it. Type: {fix}"
    ),
    "cost.no-velocity": (
        "{kind} has no velocity of its own that a floor could disturb: the error of its simulation is that "
        "of its prediction. Type: {fix}"
    ),
    "cost.unknown": "{arg[cost]:{found}}: expected one of {known}.",
    "design.limit": (
        "{vehicle}: [command] limit = [{limit}]: expected the largest size of each command, finite, one of "
        "them above 0."
    ),
    "design.short": "{duration_s:g} s leave less than 1 s to move: give a longer duration.",
    "fit.not-fitted": "{path} was not fitted. {near}.",
    "fit.not-free": "{path} was not fitted: expected one of {fitted}. Type: {fix}",
    "forecast.no-errors": "the fit knows no parameter of the model with its error, so no drive can be predicted.",
    "forecast.ran-away": "the fitted model leaves the finite numbers in open loop, so no drive can be predicted.",
    "forecast.refused": "the fit is refused, so nothing can be predicted from it. Its reasons say what to mend.",
    "led.no-dynamics": (
        "{vehicle} is a {kind}: its velocity is its command, and there is nothing for the gyro to lead. Use identify."
    ),
    "led.others": (
        "gyro_leads = True does not go with {others}: a fit led by the gyro has its own noise and pieces. Leave one "
        "of them out."
    ),
    "led.silent-gyro": (
        "{run}: the gyro is silent, and without encoders it leads the simulation. Is the third channel of "
        "the IMU in the recording?"
    ),
    "noise.fitted-to": "{run} was fitted to: comparing noise needs a run that nobody has seen.",
    "noise.no-truth": 'source = "truth": none of the runs holds the truth of a simulation. Use "innovations".',
    "noise.not-ekf": (
        '{vehicle} [estimator] kind: comparing R needs kind = "ekf"; the noise of other filters is that of '
        "their innovations."
    ),
    "noise.nothing-to-compare": "comparing noise needs at least one Q and R, and one run that they have not seen.",
    "noise.unknown-source": 'source = "{found}": expected "auto", "truth" or "innovations".',
    "over-time.few-fits": (
        "{good} of {count} runs could be fitted, and two are needed. Look at the others one by one. Type: {fix}"
    ),
    "over-time.few-runs": "following a vehicle needs two runs or more, this is {count}.",
    "parameter.all-fixed": "nothing is left to fit: every parameter is fixed. Name what is free with {arg[free]}.",
    "parameter.bounds": "the bounds of {path} are {low:g} and {high:g}: expected the lower one first.",
    "parameter.bounds-unused": "{path} has bounds and is not fitted, so they would do nothing. Add: {fix}",
    "parameter.no-track": (
        "friction of the wheels is free, and how far apart they stand is not known: expected track_m in "
        "[geometry] of the vehicle file."
    ),
    "parameter.none": "{path} cannot be fitted: it is no parameter of a block.",
    "parameter.unknown": (
        "{path} is no parameter of this vehicle ({kind}). {near}. Name it as in the vehicle file, for example "
        "{example}."
    ),
    "room.small": (
        "a room of {width_m:g} × {height_m:g} m for a body of radius {radius_m:g} m: expected more than "
        "{least_m:g} m on each side. Type: {fix}"
    ),
    "room.start": (
        "the start ({x_m:g}, {y_m:g}) m is not in the room: expected at most {along_m:.2f} m along and "
        "{across_m:.2f} m across from its middle."
    ),
    "room.unreadable": 'room "{size}": expected width and height in metres, with an x between. Type: {fix}',
    "runs.all-still": (
        "no command moved, so there is nothing to fit. Was the right run read? If it was turned by hand "
        "between rests on a mark, that tells the scale of its gyro. Type: {fix}"
    ),
    "runs.few-ticks": "{run} has {ticks} ticks: expected at least 2 to fit a model to.",
    "runs.fitted-to": "{run} is fitted to, so it cannot judge. Give another run: {fix}",
    "runs.no-command": "{run} holds no command: a fit needs what reached the motors.",
    "runs.no-sensor": "{run} has no sensor {sensor}: it has {known}. Name those that all runs have with {arg[use]}.",
    "runs.none": "identify needs at least one run.",
    "runs.other-size": (
        "{run}: a measurement of {sensor} has {entries} entries, and {kind} of the vehicle file {size}. Is "
        "it another sensor?"
    ),
    "runs.other-vehicle": (
        "{run} was driven with {commands} commands and {vehicle} takes {expected}: they are not the same "
        "kind of vehicle. Give the file of the one that was driven. Type: {fix}"
    ),
    "segment.length": "{arg[segment_s]} = {length_s:g}: expected the length of a segment, above 0 s.",
    "sigma.negative": "sigma = [{found}]: expected standard deviations greater than 0.",
    "sigma.size": "sigma: expected {size} numbers for {sensor}, the standard deviation of its noise.",
    "signal.all-rest": (
        "rest_s = {rest_s:g} before and after leaves {moving_s:g} of {duration_s:g} s to move: expected more than 0."
    ),
    "signal.band": (
        "low_hz = {low_hz:g}, high_hz = {high_hz:g}: expected 0 < low_hz < high_hz < {most_hz:g} Hz, half the rate."
    ),
    "signal.few-sines": (
        "{duration_s:g} s hold {sines} sines between {low_hz:g} and {high_hz:g} Hz, and {needed} are needed: "
        "give a longer duration_s or a wider band."
    ),
    "signal.limit": (
        "limit = [{limit}]: expected the largest size of each entry of the command, finite and 0 or more. A "
        "vehicle file without a limit needs one here."
    ),
    "signal.no-tick": (
        "duration_s = {duration_s:g}, rate_hz = {rate_hz:g}: expected at least one tick, duration_s · rate_hz ≥ 1."
    ),
    "signal.shape": "the signal has shape ({rows}): expected (N, {commands}), one row a tick.",
    "signal.short": "{what} = {span_s:g}: expected at least one tick, {least_s:g} s.",
    "signal.unknown": ('there is no signal "{found}". {near}. Designed needs a vehicle file and a room.'),
    "start.not-free": "{arg[start]} = {path}: it is not among the free parameters, so it has no start value.",
    "tape.after-the-end": (
        '{arg[measured]} "{line}": {run} lasts {duration_s:.4g} s, and {t_s:g} s is not in it: expected a '
        "time after the first tick."
    ),
    "tape.cut": (
        "a tape measures a whole run, and this one is cut into pieces. Leave out {arg[segment_s]}, and the "
        "pose of a camera, which tells more than a tape."
    ),
    "tape.negative": '{arg[measured]} "{line}": {length_m:g} m: a distance is 0 or more.',
    "tape.no-length": (
        '{arg[measured]} "{line}": "{part}" is no length and no angle: expected a number and one of {units}. '
        "Type: {fix}"
    ),
    "tape.unreadable": '{arg[measured]} "{line}": expected a time, a colon, and what was measured. Type: {fix}',
    "tape.of-no-run": '{arg[measured]} "{line}" does not name its run: expected one of {known} before the time.',
    "tape.of-another-run": '{arg[measured]} "{line}" is of a run {found}: expected one of {known} before the time.',
    "tolerance.keys": "{arg[tolerance]} = {given}: expected parts of 1 for {keys}, as in {{'gyro': 0.01}}.",
    "tolerance.no-part": "{arg[tolerance]} of {path}, {part:g}: expected a part of 1, as 0.01 for ± 1 %.",
    "tolerance.no-scale": "{arg[tolerance]:{path}}: expected a scale of an IMU of {vehicle}. It has: {known}.",
    "truth.no-heading": (
        "the truth of {run} has no heading, and calibration needs one. A fit of the model finds its place "
        "and its clock. Type: {fix}"
    ),
    "truth.no-mark": "{run} tells nothing of a mark or its clock, so no map changes. Leave out --map.",
    "truth.no-sensor": (
        "{run} has neither a gyro nor an odometer of {vehicle}, so there is nothing to calibrate. Give the "
        "vehicle file that names them: {fix}"
    ),
    "truth.none": (
        "{run} holds no pose from outside: calibration needs a camera, motion capture or a simulation's "
        "truth. Import it with [truth] in the map: {fix}. Without one, turns by hand in a run without "
        "commands calibrate a gyro."
    ),
    "truth.not-held": (
        "{run} holds no truth: only a simulation does, or a recording with a camera. Leave truth out of {arg[use]}."
    ),
    "truth.short-overlap": (
        "{run}: truth and sensors overlap for {overlap_s:.1f} s: expected at least {needed_s:.0f} s, "
        "{windows} times the window."
    ),
    "truth.silent": (
        "{run}: truth or sensor is silent so often that only {windows} windows of {window_s:g} s are whole: "
        "expected some in each of {batches} parts of the run."
    ),
    "turns.ambiguous": (
        "between its rests at {from_s:.0f} s and {to_s:.0f} s of {run} the gyro turned {turns:.2f} times: "
        "its scale may hide a turn more or less. Say how many whole turns it was. Type: {fix}"
    ),
    "turns.end-of-range": (
        "the gyro of {run} is at the end of its range, {limit_rad_s:.3g} rad/s, at {at_s:.1f} s. Turn it more slowly."
    ),
    "turns.few-rests": (f"{{run}} rests {{rests}} times for {{rest_s:g}} s or more: expected twice. {ASK}"),
    "turns.not-turned": (f"{{run}} was not turned between its rests. {ASK}"),
    "turns.not-whole": (
        "between its rests at {from_s:.0f} s and {to_s:.0f} s of {run} the gyro turned {turns:.2f} times, expected "
        "{expected:g}. "
        f"{ASK}"
    ),
    "use.not-in-all": (
        "{runs}: no reading of {sensor}. Expected at least one sensor that is read in all runs: leave out "
        "what lacks it."
    ),
    "use.read-in-some": (
        "{runs}: no reading of {sensor}. Expected at least one sensor that is read in all runs: leave out what lacks "
        "it, or fit to the others by it, with {arg[use]:{sensor}}."
    ),
    "turns.no-gyro": "{run} has no reading of a gyro of {vehicle}. Give the file that names it. Type: {fix}",
    "turns.silent": (
        "the gyro of {run} is silent for {gap_s:.2g} s at {at_s:.1f} s, and what it turned meanwhile is not "
        "known. Turn it again, or cut that part off. Type: {fix}"
    ),
    "unseen-runs.refused-fit": "the fit is refused, so there is nothing to judge: mend that first.",
    "use.no-channel": '{arg[use]} = "{sensor}[{entry}]": its channels are 0 to {last}.',
    "use.nothing-common": "the runs hold {read}, the vehicle file {known}: expected at least one in common.",
    "use.unknown": "{arg[use]:{sensor}}: the vehicle file has no such sensor; it has {known}.",
    "use.unreadable": '{arg[use]:{found}}: expected a sensor, or one channel of it as "imu[2]".',
}
