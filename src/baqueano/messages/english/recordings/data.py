"""English sentences about the data of a fit, and about its residuals."""

LOG_ONCE = "Log each sample once, with the time of its measurement."
MAP = "With this correction the residual falls ({change}) and the commands agree with the vehicle file."
SET_SIGN = "Write in the map: scale = -1.0 for the"

TEMPLATES: dict[str, str] = {
    "residual.from-to": "{first_value:.2g} → {last_value:.2g}",
    "data.not-finite": "{subject}: {count} entries that are not finite were excluded",
    "data.dead-channel": (
        "{subject} is {value:g} in all {samples} samples and was excluded. Is it connected? Is it the "
        "right column?"
    ),
    "data.zeros": (
        "{subject}: {count} samples ({percent:.1f} %) are exactly 0 and were excluded. Were frames lost?"
    ),
    "data.repeats": (
        "{subject}: {count} samples ({percent:.1f} %) repeat the previous one (at most {longest} in a "
        "row) and were excluded. The sensor repeats its last value: log only new samples"
    ),
    "data.clipped": (
        "{subject}: {count} samples ({percent:.1f} %) near full scale, {ends}, were excluded; {full_scale_count} "
        "are at full scale. Choose a larger range, or drive more gently"
    ),
    "data.gaps": (
        "gaps in time that the model bridged without measurements: {gaps}; the longest lasts {longest_s:.3g} s"
    ),
    "data.command-unknown": "the command of {ticks} ticks is missing: the previous command was used",
    "time.unit": (
        "the usual step is {step_s:.3g} s, but the vehicle file uses {rate_hz:g} Hz, {expected_s:.3g} s: "
        "{guess}?"
    ),
    "time.milliseconds-as-seconds": "were milliseconds read as seconds",
    "time.seconds-as-milliseconds": "were seconds read as milliseconds",
    "time.which-unit": "in which unit is the time",
    "time.bursts": (
        "the timestamps of {subject} come in bursts. They were spaced evenly, with shifts of up to {shift_ms:.0f} ms, "
        f"so the data can be late or early by that time. {LOG_ONCE}"
    ),
    "time.stamps-far": (
        "{subject}: the timestamps of {count} samples differ by more than {limit_s:g} s from their arrival, "
        "so they were excluded. Did the clock of the sensor jump?"
    ),
    "time.stamps-back": f"{{subject}}: {{count}} timestamps repeat or go back; their samples were excluded. {LOG_ONCE}",
    "time.jump": (
        "the timestamps jump at {jumps} places, by up to {max_s:.3g} s. The run was cut there into {pieces} segments "
        "of at least {min_s:g} s, each with its own start"
    ),
    "time.jump-throughout": (
        "the timestamps jump at {jumps} places, by up to {max_s:.3g} s. No segment between two jumps lasts {min_s:g} "
        "s, so the run was not cut. Check its time column"
    ),
    "command.limit-zero": (
        "{subject} reaches {maximum:.3g}, but its limit in the vehicle file is 0. Are columns swapped?"
    ),
    "command.unit": (
        "{subject} reaches {maximum:.4g}, but the vehicle file allows {limit:g} ({file_unit}). Is it in "
        "{guess}? Convert it to the unit of the file, or write the true limit"
    ),
    "gyro.too-fast": (
        "{subject} reaches {max_rad_s:.0f} rad/s, and small gyros measure up to {fastest_rad_s:g}. Is it in °/s?"
    ),
    "gyro.unit": (
        "{subject} is {ratio:.3g} times the yaw rate that {source}, and 1 rad/s is 57.3 deg/s. It is in "
        '{true_unit} and was read as {assumed_unit}. Write in the map, for the third entry of z: unit = "{true_unit}"'
    ),
    "gyro.as-wheels": "{subject} measures",
    "gyro.as-curve": "follows from {subject} at the speed of {speed}",
    "gyro.as-commands": "the commands produce according to the vehicle file",
    "gyro.or-accelerometer": (
        "{gyro}. Or {subject} is {ratio:.3g} times the value that speed and yaw rate imply. Check its "
        "unit, and whether its axis points to the left"
    ),
    "accelerometer.unit": "{subject} reaches {max_m_s2:.0f} m/s². Are these counts of an A/D converter?",
    "gravity.at-rest": (
        "{subject} has an offset of {error_m_s2:+.2f} m/s² at rest. This is gravity, because the IMU is not "
        "level: swap its axes, or write tilt_rad"
    ),
    "gravity.all-the-time": (
        "{subject} has an offset of {error_m_s2:+.2f} m/s² all the time. This is gravity, because the IMU is "
        "not level: swap its axes, or write tilt_rad"
    ),
    "axes.inverted": (
        "{subject} has the opposite sign of the model's prediction (correlation "
        "{correlation:.2f}). Is its sign, or that of a command, inverted?"
    ),
    "axes.swapped": (
        "{subject} and {channel} follow each other's predictions, not their own (correlations {first:.2f}, "
        "{second:.2f}): swap their columns"
    ),
    "mount.swapped": (
        f"The first two columns of {{subject}} are swapped. {MAP} Swap the first two entries of z in the map"
    ),
    "mount.first-inverted": f"The first column of {{subject}} is inverted. {MAP} {SET_SIGN} first entry of z",
    "mount.second-inverted": (
        f"The second column of {{subject}} is inverted. {MAP} {SET_SIGN} second entry of z"
    ),
    "mount.third-inverted": f"The third column of {{subject}} is inverted. {MAP} {SET_SIGN} third entry of z",
    "mount.half-turn": f"The mounting of {{subject}} is turned by half a turn. {MAP} {SET_SIGN} first two entries of z",
    "mount.quarter-turn-second": (
        f"The mounting of {{subject}} is turned by a quarter turn. {MAP} In the map, swap the first two entries "
        "of z, then write scale = -1.0 for the second one"
    ),
    "mount.quarter-turn-first": (
        f"The mounting of {{subject}} is turned by a quarter turn. {MAP} In the map, swap the first two entries "
        "of z, then write scale = -1.0 for the first one"
    ),
    "file.quiet": (
        "the noise of {subject}, {sigma:.3g}, is {ratio:.2g} times the noise in the file. Is it in another "
        "unit{guess}, or smoothed?"
    ),
    "file.inverted": (
        "{subject} is {value:.3g}, and {file_value:.3g} in the file. A command, a sensor or the file is inverted: "
        "write scale = -1.0 in the map for the command or the sensor, or the sign of this fit in the file"
    ),
    "file.mirrored": (
        "{subject} is {value:.3g}, and {file_value:.3g} in the file, so the motion or the file is mirrored. If z of "
        "{imu} points down, write in the map scale = -1.0 for the second and third entry of z. If left and right "
        "are swapped, swap the columns of the commands. If the vehicle turns so, write the sign of this fit in the "
        "file"
    ),
    "file.track": (
        "{subject} and the gyro agree if the wheels are {track_m:.3g} m apart, but the file has {file_m:.3g} m. "
        "Correct track_m, or estimate it. Type: {fix}"
    ),
    "file.slides": (
        "with {subject} = {value:.3g}, a guess, the wheels slide in turns, so the course differs from the heading by "
        "{degrees:.1f}° rms. This turns the path of each estimate. If the tyres hardly slide, write {stiff:.3g}"
    ),
    "file.far-gain": (
        "{subject} is {ratio:.3g} times the value in the file{guess}. Check the units of commands and sensors"
    ),
    "file.gain": (
        "{subject} is {ratio:.3g} times the value in the file{guess}. Check the units of commands and sensors; if the "
        "file was a guess, save this fit and repeat it"
    ),
    "file.swapped": (
        "the command {subject} should give {expected} motion and gives {value} motion. Are columns of commands or axes "
        "of a sensor swapped?"
    ),
    "file.lever-arm": (
        "the command {subject} turns the vehicle, and seems to push {axis} as well. The cause can be a "
        "wrong position of the IMU in the file, or an offset of the centre of mass. Type: {fix}"
    ),
    "axis.forward": "forward",
    "axis.sideways": "sideways",
    "axis.turning": "turning",
    "guess.degrees": " (perhaps °/s, not rad/s)",
    "guess.g": " (perhaps g, not m/s²)",
    "guess.pwm": " (perhaps PWM counts, not a fraction of the full command)",
    "guess.percent": " (perhaps per cent)",
    "guess.milli": " (perhaps thousandths of the unit)",
    "residual.missing": (
        "the residuals look like {effect}{region} ({z:.0f} standard errors), which biases {subject} by "
        "{errors:.0f} standard errors. Add this effect to the model, or make a drive without it"
    ),
    "residual.missing-free": (
        "the residuals look like {effect}{region} ({z:.0f} standard errors), which biases {subject} by "
        "{errors:.0f} standard errors. Add this effect to the model. Type: {fix}"
    ),
    "residual.parts-differ": (
        "{subject} differs by {difference:+.3g} {part}, compared with {overall_value:.3g} overall ({z:.0f} standard "
        "errors). Were the vehicle, the floor and the battery the same? Fit the parts separately"
    ),
    "part.first": "in the first {percent:.0f} % of the time",
    "part.run": "in run {number}",
    "part.forward": "driving forward",
    "part.left": "turning left",
    "part.fast": "at higher speed than usual",
    "part.in-turns": "in faster turns than usual",
    "part.gaining-speed": "while it accelerates",
    "part.turning-faster": "while its yaw rate increases",
    "residual.autocorrelated": (
        "the residuals of {subject} are autocorrelated. They reach {percent:g} % of the motion that the "
        "model explains there, and {ratio:.1f} times its noise. The model is incomplete"
    ),
    "residual.late-readings": (
        "{readings} readings of {subject} are beyond {limit:g} standard deviations when the signal "
        "changes fast ({z:.0f} standard errors). There is a delay, or the model is too simple for fast "
        "changes. To estimate a delay, type: {fix}"
    ),
    "residual.fast": (
        "{readings} readings of {subject} are beyond {limit:g} standard deviations when the signal "
        "changes fast ({z:.0f} standard errors). The delay is estimated, so the timestamps are uneven, or the model "
        "is too simple for fast changes"
    ),
    "residual.incomplete-model": (
        "the residuals of {subject} are autocorrelated and large: the model is incomplete there"
    ),
    "residual.large": "the residuals of {subject}, {sigma:.3g}, are {ratio:.0f} times the noise in the file",
    "residual.outlier": (
        "{subject}: measured {measurement:.4g}{unit}, predicted {model:.4g}{unit}; they differ by {z:.0f} "
        "standard deviations"
    ),
    "residual.not-white": "the residuals of {subject} are autocorrelated, so its error bars were widened",
    "residual.alternates": (
        "the residuals of {subject} alternate in sign, which is typical of a filtered or "
        "differentiated signal. The error bars are not affected"
    ),
    "outliers.both-sides": (
        "{percent:.1f} % of the samples of {subject} are beyond {limit:.0f} standard deviations. A Huber "
        "cost tolerates them while they are on both sides"
    ),
    "outliers.many": (
        "{percent:.0f} % of the samples of {subject} are beyond {limit:.0f} standard deviations"
    ),
    "outliers.one-side": (
        "{percent:.1f} % of the samples of {subject} are beyond {limit:.0f} standard deviations, {positives} "
        "above and {negatives} below. Outliers on one side bias the fit"
    ),
    "term.dead-zone": "a dead zone of the motors, or dry friction",
    "term.saturation": "motors that lose force at full command, or wheels that slip",
    "term.asymmetry": "motors that are not equal forward and backward",
    "term.fading": "a battery that loses its charge",
    "term.sag": "a battery whose voltage falls under load",
    "term.slow-sag": "a battery that recovers slowly from a load, or motors that become warm",
    "term.motor-lag": "a lag of the motors",
    "term.servo-delay": "a servo with a lag or another delay than the motors, or with a limited rate",
    "term.back-emf": "a back-EMF behind the lag of the motors",
    "term.backlash": "backlash, or a pause after a command changes its sign",
    "term.dry-friction": "dry (Coulomb) friction",
    "term.friction-speed": "another speed at which dry friction changes its sign",
    "term.drag": "drag that does not grow as in the model",
    "term.steep-drag": "drag that does not grow as in the model",
    "term.one-sided-drag": "friction that is not equal forward and backward",
    "term.along-x": " in forward motion",
    "term.along-y": " in sideways motion",
    "term.along-psi": " in turning",
    "term.caster": "a caster that flips when the direction of motion reverses",
    "term.unequal-drag": "unequal drag on the left and on the right, or wheels of unequal size",
    "term.cornering": "drag of cornering, or tyres that slip",
    "term.turning": "a centre of mass or an IMU away from the axle",
    "term.turning-about": (
        "a wrong ratio of centre of mass to moment of inertia, or an IMU away from the axle"
    ),
    "term.slip": "drag of cornering, or tyres that slip",
    "term.sideways-slip": "tyres that slip sideways",
    "term.sideways-push": "a sideways force when turning",
    "term.delay": "a delay or lag between command and sensors",
    "term.delay-of-sensor": "a clock offset of {subject}, or its delay",
    "term.low-pass": (
        "a low-pass filter in {subject}, or a further lag of motor or steering, that is missing in the file"
    ),
    "term.slope": "a slope of the floor",
    "term.imu-ahead": "a position of {subject} in front of or behind the one in the file",
    "term.imu-beside": "a position of {subject} to the side of the one in the file",
    "term.imu-turned": "a rotation of {subject} on its mount",
    "term.measurement-model": "a measurement_model of {subject} other than in the file",
}
