"""English error messages about fits, their noise, and experiments."""

TURN_STEPS = (
    "Leave the vehicle on its mark for 3 s. Turn it by hand on the floor, two whole turns, and put it back on the "
    "mark. "
    "Leave it there for 3 s again."
)
TEMPLATES: dict[str, str] = {
    "imu-only.not-an-imu": (
        "{arg[use]:{use}}: {vehicle} has these IMUs: {valid}; expected one of them for a gyro-aided fit. Name it, or "
        "describe it in the file under [sensors.imu]."
    ),
    "imu-only.which-imu": (
        "{vehicle} has these IMUs: {valid}; expected one of them for the fit. Name it with {arg[use]}, or "
        "describe it in the file under [sensors.imu]."
    ),
    "allan.averages": (
        "With {samples} samples, an average can contain 1 to {maximum} of them: {value} is out of range."
    ),
    "allan.numbers": (
        "An Allan deviation needs a list of at least {minimum} finite numbers; this list has {value}."
    ),
    "allan.rate": "rate_hz = {rate_hz:g}: expected the number of samples per second, above 0.",
    "at-rest.driven": (
        "{run} has commands all the time. To measure the noise at rest, record a run without commands."
    ),
    "at-rest.few-samples": (
        "{run} does not contain a sensor with {minimum} samples at rest. Record a minute or more with the "
        "motors off and nobody near the vehicle."
    ),
    "at-rest.no-imu": (
        "{run} does not have the IMU of {vehicle}: expected a sensor with three channels. "
        "Nothing can be written."
    ),
    "at-rest.no-tick": "{run} does not contain a tick between those times.",
    "battery.no-voltage": (
        "The effect of the battery needs its voltage: expected a channel {channel} in V in a run. Import "
        "it as [sensors.{channel}], or keep model.drivetrain.battery_effect fixed."
    ),
    "battery.other-voltage": (
        "{run}: the battery had {voltage_v:.3g} V, and battery_nominal_v of the vehicle file is "
        "{nominal_v:g} V: expected about the same. Write the battery's voltage into [model.drivetrain] "
        "battery_v and battery_nominal_v."
    ),
    "choose.no-command": "The runs do not have a command, so terms cannot be chosen.",
    "choose.no-term": (
        'candidates = "{value}": a {kind} does not have this term. {suggestion}, and paths such as model.…'
    ),
    "choose.options": (
        "A choice of terms does not accept {options}. Choose first, then fit the chosen terms with these options."
    ),
    "choose.pose": (
        "Terms are chosen with speeds and accelerations: remove the pose of the camera from {arg[use]}."
    ),
    "choose.short": (
        "The held-out runs last {total_s:.1f} s together: expected at least {min_s:.0f} s. Drive "
        "longer, or fit without a choice of terms."
    ),
    "clock.all-free": (
        "A run does not separate {path} from the clocks of all its sensors, {clocks}. Leave one of these clocks "
        "fixed, or the delay. Type: {fix}"
    ),
    "clock.unreliable": (
        "{arg[clocks]:{sensor}}: expected one of the sensors in use, {valid}. To use another "
        "sensor of the vehicle file, or the truth: {arg[use]}."
    ),
    "cost.free-clock": (
        "The clock offset of {clocks} is a free parameter, but a filter cannot use future rows. First "
        "estimate the offset, and calibrate the run with it. Type: {fix}"
    ),
    "cost.no-velocity": (
        "{kind} does not have a velocity state that a floor could disturb, so simulation error and prediction error "
        "are the same. Type: {fix}"
    ),
    "cost.unknown": "{arg[cost]:{value}}: expected one of {valid}.",
    "design.limit": (
        "{vehicle}: [command] limit = [{limit}]: expected the largest magnitude of each command, finite, "
        "and at least one above 0."
    ),
    "design.short": "{duration_s:g} s leave less than 1 s for the motion: choose a longer duration.",
    "fit.not-fitted": "{path} was not fitted. {suggestion}.",
    "fit.not-free": "{path} was not fitted: expected one of {valid}. Type: {fix}",
    "forecast.no-errors": (
        "The fit did not give the error of any parameter of the model, so a drive cannot be predicted."
    ),
    "forecast.diverged": "The fitted model diverges in open loop, so a drive cannot be predicted.",
    "forecast.refused": (
        "The fit is refused, so a drive cannot be predicted. First correct the causes of the refusal."
    ),
    "imu-only.no-dynamics": (
        "{vehicle} is a {kind}: its velocity is its command, so a gyro cannot improve it. Use identify."
    ),
    "imu-only.others": (
        "gyro_leads = True cannot be combined with {others}: a gyro-aided fit has its own noise and "
        "segments. Remove one of them."
    ),
    "imu-only.silent-gyro": (
        "{run}: the gyro does not give data, and without encoders the fit needs it. Is the third "
        "channel of the IMU in the recording?"
    ),
    "noise.fitted-to": "{run} was used in the fit. Give another run to compare the noise.",
    "noise.no-truth": (
        'source = "truth": the runs do not contain the truth of a simulation. Use "innovations".'
    ),
    "noise.not-ekf": (
        '{vehicle} [estimator] kind: comparing R needs kind = "ekf". The noise of other filters comes from their '
        "innovations."
    ),
    "noise.nothing-to-compare": (
        "Comparing noise needs at least one Q and R, and one run that was not used for them."
    ),
    "noise.unknown-source": 'source = "{value}": expected "auto", "truth" or "innovations".',
    "over-time.few-fits": (
        "{accepted_count} of {count} runs could be fitted, but two are needed. Fit the others one by one. Type: {fix}"
    ),
    "over-time.few-runs": "Two or more runs are needed to follow the parameters over time; found {count}.",
    "parameter.all-fixed": (
        "Every parameter is fixed, so nothing can be fitted. Name the free ones with {arg[free]}."
    ),
    "parameter.bounds": "The bounds of {path} are {low:g} and {high:g}: expected the lower one first.",
    "parameter.bounds-unused": "{path} has bounds, but it is not fitted, so they have no effect. Add: {fix}",
    "parameter.no-track": (
        "The friction of the wheels is free, so the distance between the wheels is needed: expected "
        "track_m in [geometry] of the vehicle file."
    ),
    "parameter.none": "{path} cannot be fitted: it is not a parameter of a block.",
    "parameter.unknown": (
        "{path} is not a parameter of this vehicle ({kind}). {suggestion}. Name it as in the vehicle file, for example "
        "{example}."
    ),
    "room.kind": "room = {value}: expected a text with width and height in metres. Type: {fix}",
    "room.small": (
        "A room of {width_m:g} × {height_m:g} m is too small for a body of radius {radius_m:g} m: expected "
        "more than {min_m:g} m on each side. Type: {fix}"
    ),
    "room.start": (
        "The start ({x_m:g}, {y_m:g}) m is outside the room: expected at most {max_x_m:.2f} m in "
        "x and {max_y_m:.2f} m in y from its middle."
    ),
    "room.unreadable": (
        'room "{size}": expected width and height in metres with a decimal point, such as 2.5x3. Type: {fix}'
    ),
    "runs.all-still": (
        "No command changed, so there is nothing to fit. Is it the right run? If the vehicle was turned by "
        "hand between rests on a mark, the run gives the scale of its gyro. Type: {fix}"
    ),
    "runs.few-ticks": "{run} has {ticks} ticks: expected at least 2, to fit a model.",
    "runs.fitted-to": "{run} was used in the fit, so it cannot test the fit. Give another run: {fix}",
    "runs.no-command": "{run} does not contain a command: a fit needs the command at the motors.",
    "runs.no-sensor": (
        "{run} does not have sensor {sensor}: it has {valid}. Name those that all runs have with {arg[use]}."
    ),
    "runs.none": "identify needs at least one run. Type: {fix}",
    "runs.other-size": (
        "{run}: a measurement of {sensor} has {entries} entries, but {kind} of the vehicle file has "
        "{size}. Is it another sensor?"
    ),
    "runs.other-vehicle": (
        "{run} was driven with {commands} commands, but {vehicle} accepts {expected}: they are not the "
        "same kind of vehicle. Give the file of the vehicle that was driven. Type: {fix}"
    ),
    "segment.length": "{arg[segment_s]} = {length_s:g}: expected the length of a segment, above 0 s.",
    "segment.short": (
        "{arg[segment_s]} = {length_s:g}: a segment needs at least {rows} rows of the run, to estimate its start. "
        "Write at least {shortest_s:.2g}, or several seconds for a usual vehicle."
    ),
    "sigma.negative": "sigma = [{value}]: expected standard deviations greater than 0.",
    "sigma.size": "sigma: expected {size} values for {sensor}, the standard deviations of its noise.",
    "signal.all-rest": (
        "duration_s = {duration_s:g} and rest_s = {rest_s:g}: {moving_s:g} s remain for the motion. Expected more than "
        "0, so give a longer duration or a shorter rest."
    ),
    "signal.band": (
        "low_hz = {low_hz:g}, high_hz = {high_hz:g}: expected 0 < low_hz < high_hz < {max_hz:g} Hz, half the rate."
    ),
    "signal.few-sines": (
        "{duration_s:g} s contain {sines} sines between {low_hz:g} and {high_hz:g} Hz, but {minimum} are "
        "needed. Choose a longer duration_s or a wider band."
    ),
    "signal.limit": (
        "limit = [{limit}]: expected the largest magnitude of each entry of the command, finite and 0 or "
        "more. If the vehicle file does not have a limit, give one here."
    ),
    "signal.no-tick": (
        "duration_s = {duration_s:g}, rate_hz = {rate_hz:g}: expected at least one tick, duration_s · rate_hz ≥ 1."
    ),
    "signal.shape": "The signal has shape ({rows}): expected (N, {commands}), one row per tick.",
    "signal.short": "{name} = {span_s:g}: expected at least one tick, {min_s:g} s.",
    "signal.unknown": 'Signal "{value}" is unknown. {suggestion}. The signal designed needs a vehicle file and a room.',
    "start.not-free": (
        "{arg[start]} = {path}: this is not a free parameter, so it does not have a start value."
    ),
    "tape.after-the-end": (
        '{arg[measured]} "{line}": {run} lasts {duration_s:.4g} s, so {t_s:g} s is not in it: expected a '
        "time after the first tick."
    ),
    "tape.cut": (
        "A tape measures a whole run, but this run is split into segments. Remove {arg[segment_s]}, or use "
        "the pose of a camera, which gives more information than a tape."
    ),
    "tape.negative": '{arg[measured]} "{line}": {length_m:g} m: a distance is 0 or more.',
    "tape.no-length": (
        '{arg[measured]} "{line}": "{part}" is not a length or an angle: expected a number and one of {units}. Type: '
        "{fix}"
    ),
    "tape.unreadable": '{arg[measured]} "{line}": expected a time, a colon, and the measurement. Type: {fix}',
    "tape.run-missing": '{arg[measured]} "{line}" does not name its run: expected one of {valid} before the time.',
    "tape.of-another-run": (
        '{arg[measured]} "{line}" names run {value}: expected one of {valid} before the time.'
    ),
    "tolerance.no-part": (
        "{arg[tolerance]} of {path}, {part:g}: expected a fraction of 1, such as 0.01 for ± 1 %."
    ),
    "tolerance.no-scale": "{arg[tolerance]:{path}}: expected a scale of an IMU of {vehicle}. It has: {valid}.",
    "truth.no-heading": (
        "The truth of {run} does not contain a heading, and calibration needs one. A fit of the model can "
        "estimate the position of its mark and its clock. Type: {fix}"
    ),
    "truth.no-mark": (
        "{run} does not determine a mark or its clock, so the map stays unchanged. Remove --map."
    ),
    "truth.no-sensor": (
        "{run} contains neither the gyro nor the odometer of {vehicle}, so it cannot be calibrated. Give the vehicle "
        "file that names them: {fix}"
    ),
    "truth.none": (
        "{run} does not contain a pose from outside: calibration needs a camera, motion capture or a "
        "simulation's truth. Import it with [truth] in the map: {fix}. Without such a pose, a gyro can be "
        "calibrated by turns by hand, in a run without commands."
    ),
    "truth.absent": (
        "{run} does not contain the truth: only a simulation contains it, or a recording with a camera. "
        "Remove truth from {arg[use]}."
    ),
    "truth.short-overlap": (
        "{run}: the truth and the sensors overlap for {overlap_s:.1f} s: expected at least "
        "{min_s:.0f} s, {windows} times the window."
    ),
    "truth.silent": (
        "{run}: the truth or the sensor has so many gaps that only {windows} windows of {window_s:g} s "
        "are complete. Expected some in each of {batches} parts of the run."
    ),
    "turns.ambiguous": (
        "Between the rests of {run} at {start_s:.0f} s and {end_s:.0f} s the gyro measured {turns:.2f} "
        "turns. The error of its scale can hide one turn more or less: give the number of whole turns. "
        "Type: {fix}"
    ),
    "turns.end-of-range": (
        "The gyro of {run} is at full scale, {limit_rad_s:.3g} rad/s, at {t_s:.1f} s. Turn the vehicle "
        "more slowly."
    ),
    "turns.few-rests": (
        f"{{run}} contains {{rests}} rests of {{rest_s:g}} s or more: expected two. {TURN_STEPS}"
    ),
    "turns.not-turned": (f"In {{run}} the vehicle was not turned between its rests. {TURN_STEPS}"),
    "turns.not-whole": (
        "Between the rests of {run} at {start_s:.0f} s and {end_s:.0f} s the gyro measured {turns:.2f} turns; expected "
        "{expected:g}. "
        f"{TURN_STEPS}"
    ),
    "use.not-in-all": (
        "{runs}: readings of {sensor} are missing. Expected at least one sensor with readings in all runs: "
        "exclude the runs without it."
    ),
    "use.read-in-some": (
        "{runs}: readings of {sensor} are missing. Expected at least one sensor with readings in all runs. "
        "Exclude the runs without it, or fit the others with it: {arg[use]:{sensor}}."
    ),
    "turns.no-gyro": (
        "{run} does not contain a reading of a gyro of {vehicle}. Give the file that names it. Type: {fix}"
    ),
    "turns.silent": (
        "The gyro of {run} is silent for {gap_s:.2g} s at {t_s:.1f} s, so the turn in that time is "
        "unknown. Repeat the turns, or cut that part off. Type: {fix}"
    ),
    "validation.refused-fit": (
        "The fit is refused, so it cannot be tested: first correct the causes of the refusal."
    ),
    "use.no-channel": '{arg[use]} = "{sensor}[{entry}]": its channels are 0 to {last}.',
    "use.nothing-common": (
        "The runs contain {sensors}, and the vehicle file {valid}: expected at least one in common."
    ),
    "use.not-in-file": (
        "The run has sensor {sensor}, which {vehicle} does not describe, so the fit does not use it. To use it, add to "
        'the vehicle file: [sensors.{sensor}], and below it kind = "{kind}".'
    ),
    "use.unknown": "{arg[use]:{sensor}}: the vehicle file does not have this sensor; it has {valid}.",
    "use.unreadable": '{arg[use]:{value}}: expected a sensor, or one of its channels, such as "imu[2]".',
}
