"""English sentences about data that were fitted to, and about what a fit leaves over."""

CURE = "Log each sample once, stamped when it is measured."
MAP = "With this correction the residual falls ({less}) and the commands agree with the vehicle file. Write in the map:"
SWAP = "swap the first two entries of z"

TEMPLATES: dict[str, str] = {
    "data.not-finite": "{subject}: {lost} entries that are not finite were left out",
    "data.dead-channel": (
        "{subject} is {value:g} in all {samples} samples and was left out. Is it connected, and the right column?"
    ),
    "data.zeros": (
        "{subject}: {lost} samples ({percent:.1f} %) are exactly 0 and were left out. Were frames lost?"
    ),
    "data.repeats": (
        "{subject}: {lost} samples ({percent:.1f} %) repeat the one before (at most {longest} in a row) and were left "
        "out. The sensor repeats its last value: log new samples only"
    ),
    "data.clipped": (
        "{subject}: {lost} samples ({percent:.1f} %) near the end of the range, {ends}, were left out; {at_end} are at "
        "the limit. Choose a larger range, or drive more softly"
    ),
    "data.gaps": "the model alone bridged {gaps} gaps in time, the longest of {longest_s:.3g} s",
    "data.command-unknown": "the command of {ticks} ticks is missing: the one before was used",
    "data.end-of-range": "{subject}: {lost} entries at the end of the range were left out",
    "time.unit": (
        "the usual step is {step_s:.3g} s, and the vehicle file drives at {rate_hz:g} Hz, {expected_s:.3g} s: {guess}?"
    ),
    "time.milliseconds-as-seconds": "were milliseconds read as seconds",
    "time.seconds-as-milliseconds": "were seconds read as milliseconds",
    "time.which-unit": "which unit has the time",
    "time.bursts": (
        "the stamps of {subject} come in bursts. They were spread evenly, with shifts of up to {moved_ms:.0f} ms, so "
        f"the data may be late or early by that time. {CURE}"
    ),
    "time.stamps-far": (
        "{subject}: the stamps of {lost} samples lie over {late_s:g} s from their arrival and were left out. Did its "
        "clock jump?"
    ),
    "time.stamps-back": f"{{subject}}: {{lost}} stamps repeat or go back; their samples were left out. {CURE}",
    "time.jump": (
        "time jumps {jumps} times, by up to {most_s:.3g} s. The run was cut there into {pieces} segments of at least "
        "{least_s:g} s, each with its own start"
    ),
    "time.jump-throughout": (
        "time jumps {jumps} times, by up to {most_s:.3g} s. No segment between two jumps lasts {least_s:g} s, so the "
        "run was not cut. Check its time column"
    ),
    "command.beyond-zero": (
        "{subject} reaches {most:.3g}, but its limit in the vehicle file is 0. Are columns swapped?"
    ),
    "command.unit": (
        "{subject} reaches {most:.4g}, and the vehicle file allows {limit:g} ({of_file}). Is it in {guess}? Convert it "
        "to the unit of the file, or write the true limit"
    ),
    "gyro.too-fast": (
        "{subject} reaches {most_rad_s:.0f} rad/s, and small gyros measure up to {fastest_rad_s:g}. Is it in °/s?"
    ),
    "gyro.unit": (
        "{subject} is {times:.3g} times the turning that {by}, and 1 rad/s is 57.3 deg/s. It is in {given} and was "
        'read as {read}. Write in the map, for its third number: unit = "{given}"'
    ),
    "gyro.as-wheels": "{subject} measures",
    "gyro.as-curve": "{subject} at the speed of {speed} shows",
    "gyro.as-commands": "the commands make by the vehicle file",
    "gyro.or-accelerometer": (
        "{gyro}. Or {subject} is {times:.3g} times what speed and turning make: check its unit, and whether it points "
        "to the left"
    ),
    "accelerometer.unit": "{subject} reaches {most_m_s2:.0f} m/s². Are these counts of a converter?",
    "gravity.at-rest": (
        "{subject} has an offset of {off_m_s2:+.2f} m/s² at rest. This is gravity, because the "
        "IMU does not lie flat: swap its axes, or write tilt_rad"
    ),
    "gravity.all-the-time": (
        "{subject} has an offset of {off_m_s2:+.2f} m/s² all the time. This is gravity, because "
        "the IMU does not lie flat: swap its axes, or write tilt_rad"
    ),
    "axes.inverted": (
        "{subject} has the opposite sign of the model's prediction (correlation "
        "{correlation:.2f}). Is its sign, or that of a command, inverted?"
    ),
    "axes.swapped": (
        "{subject} and {other} follow each other's predictions, not their own (correlations {first:.2f}, "
        "{second:.2f}): swap their columns"
    ),
    "mount.swapped": f"{{subject}}: its first two columns are swapped. {MAP} {SWAP}",
    "mount.first-inverted": f"{{subject}}: its first column is inverted. {MAP} scale = -1.0 for the first entry of z",
    "mount.second-inverted": (
        f"{{subject}}: its second column is inverted. {MAP} scale = -1.0 for the second entry of z"
    ),
    "mount.third-inverted": f"{{subject}}: its third column is inverted. {MAP} scale = -1.0 for the third entry of z",
    "mount.half-turn": f"{{subject}}: it is turned by half a turn. {MAP} scale = -1.0 for the first two entries of z",
    "mount.quarter-turn-second": (
        f"{{subject}}: it is turned by a quarter. {MAP} {SWAP}, and scale = -1.0 for the second then"
    ),
    "mount.quarter-turn-first": (
        f"{{subject}}: it is turned by a quarter. {MAP} {SWAP}, and scale = -1.0 for the first then"
    ),
    "file.quiet": (
        "the noise of {subject}, {sigma:.3g}, is {times:.2g} times that of the file. Is it in another unit{guess}, or "
        "smoothed?"
    ),
    "file.inverted": "{subject} is {now:.3g}, and {was:.3g} in the file. A command, a sensor or the file is inverted",
    "file.far-gain": (
        "{subject} is {times:.3g} times the value in the file{guess}. Check the units of commands and sensors"
    ),
    "file.gain": (
        "{subject} is {times:.3g} times the value in the file{guess}. Check the units of commands and sensors; if the "
        "file was a guess, save this fit and repeat it"
    ),
    "file.swapped": (
        "the command {subject} should give {expected} motion and gives {found} motion. Are columns of commands or axes "
        "of a sensor swapped?"
    ),
    "file.lever-arm": (
        "the command {subject} turns the vehicle, and seems to push {axis} as well. The cause may be a wrong position "
        "of the IMU in the file, or a centre of mass. Type: {fix}"
    ),
    "axis.forward": "forward",
    "axis.sideways": "sideways",
    "axis.turning": "turning",
    "guess.degrees": " (perhaps °/s, not rad/s)",
    "guess.g": " (perhaps g, not m/s²)",
    "guess.pwm": " (perhaps PWM counts, not a share of the full command)",
    "guess.percent": " (perhaps per cent)",
    "guess.milli": " (perhaps thousandths of the unit)",
    "residual.missing": (
        "the residuals look like {what} ({term}, {z:.0f} standard errors), which biases {subject} by {errors:.0f} "
        "standard errors. Add it to the model, or drive without it"
    ),
    "residual.missing-free": (
        "the residuals look like {what} ({term}, {z:.0f} standard errors), which biases {subject} by {errors:.0f} "
        "standard errors. Add it to the model. Type: {fix}"
    ),
    "residual.parts-differ": (
        "{subject} differs by {off:+.3g} {part}, compared with {over_all:.3g} overall ({z:.0f} "
        "standard errors). Was it the same vehicle, floor and battery? Fit the parts separately"
    ),
    "part.first": "in the first {percent:.0f} % of the time",
    "part.run": "in run {number}",
    "part.forward": "driving forward",
    "part.left": "turning left",
    "part.fast": "at more than usual speed",
    "part.in-turns": "in more than usual turns",
    "part.gaining-speed": "while it gains speed",
    "part.turning-faster": "while it turns ever faster",
    "residual.autocorrelated": (
        "the residuals of {subject} are autocorrelated: {percent:.2g} % of the motion that the model explains there, "
        "and {times:.1f} times its noise. The model is incomplete"
    ),
    "residual.late": (
        "{readings} readings of {subject} are beyond {beyond:g} standard deviations, while it changes fast ({z:.0f} "
        "standard errors). There is a delay, or the model is too simple then"
    ),
    "residual.lacking": (
        "the residuals of {subject} are autocorrelated and large: the model is incomplete there"
    ),
    "residual.loud": "the residuals of {subject}, {sigma:.3g}, are {times:.0f} times the noise in the file",
    "residual.one-far": (
        "{subject}: measured {measured:.4g}{unit}, predicted {model:.4g}{unit}: a difference of "
        "{apart:.0f} standard deviations"
    ),
    "residual.not-white": "the residuals of {subject} are autocorrelated, so its error bars were widened",
    "residual.alternates": (
        "the residuals of {subject} alternate in sign, which is typical of a filtered or "
        "differentiated signal. The error bars are not affected"
    ),
    "outliers.both-sides": (
        "{percent:.1f} % of {subject} are beyond {beyond:.0f} standard deviations. A Huber cost tolerates them while "
        "they are on both sides"
    ),
    "outliers.many": "{percent:.0f} % of {subject} are beyond {beyond:.0f} standard deviations",
    "outliers.one-side": (
        "{percent:.1f} % of {subject} are beyond {beyond:.0f} standard deviations, {above} above and {below} below: "
        "outliers on one side bias the fit"
    ),
    "term.dead-zone": "a dead zone of the motors, or dry friction",
    "term.saturation": "motors that lose force at full command, or wheels that slip",
    "term.asymmetry": "motors that are not equal forward and backward",
    "term.fading": "a battery that fades",
    "term.backlash": "backlash, or a pause after a command changes its sign",
    "term.dry-friction": "dry (Coulomb) friction",
    "term.drag": "drag that does not grow as in the model",
    "term.steep-drag": "drag that does not grow as in the model",
    "term.one-sided-drag": "friction that is not equal forward and backward",
    "term.caster": "a caster that flips when the motion turns round",
    "term.cornering": "drag of cornering, or tyres that slip",
    "term.turning": "a centre of mass or an IMU away from the axle",
    "term.slip": "drag of cornering, or tyres that slip",
    "term.sideways-slip": "tyres that slip sideways",
    "term.sideways-push": "a sideways push of turning",
    "term.delay": "a delay or lag between command and sensors",
    "term.delay-of-sensor": "a clock of {subject} that is off, or its delay",
    "term.low-pass": "a low-pass in {subject} that is missing in the file",
    "term.imu-ahead": "{subject} ahead of or behind its place in the file",
    "term.imu-beside": "{subject} beside its place in the file",
    "term.imu-turned": "{subject} turned on its mount",
    "term.measurement-model": "a measurement_model of {subject} other than in the file",
}
