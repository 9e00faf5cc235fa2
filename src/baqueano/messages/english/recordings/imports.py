"""English sentences about a recording that is imported, and about the rows to write in its map."""

TEMPLATES = {
    "recording.cause": "{finding:word}: {cause}",
    "recording.finding-and-line": "{finding:word}: {cause}; {line}",
    "recording.cause-and-line": "{cause}; {line}",
    "recording.two-sentences": "{first}. {second}",
    "recording.pair": "{first}, and {second}",
    "recording.list": "{first}, {second}",
    "recording.accepted": "{cause} (accepted by the map)",
    "recording.write": "write {line}",
    "recording.possible-line": "perhaps {line:word}",
    "recording.perhaps-smaller": 'perhaps unit = "mg", or "raw" with a scale',
    "recording.possible-gyro-line": "perhaps {line} for the gyro",
    "recording.unit-entry": 'if the column is in {unit_name} write unit = "{unit_name}"',
    "recording.check-scale": "check its scale",
    "recording.check-both-units": "check both units",
    "recording.check-unit-and-scale": "check its unit and scale",
    "recording.check-with-speed": "check its unit and scale, and those of the speed, {source}",
    "recording.write-scale": "write scale = {scale} for this channel",
    "recording.write-unit": 'write unit = "{column_unit}" for {key}',
    "recording.write-shift": "write shift_s = {shift_s} in [truth]",
    "recording.write-shift-without-slip": "if the wheels do not slip, write shift_s = {shift_s} in [truth]",
    "recording.write-pulses": "write {line}, for pulses of 1000 to 2000 µs with 1500 in the middle",
    "recording.write-largest": (
        "write {line}, where {maximum} is the largest value: a set-point in a physical unit does not have a "
        "full scale"
    ),
    "recording.write-full": "write {line}, if a full command is {full_command}",
    "recording.write-percent-or-full": 'write unit = "%", or {line}, if a full command is {full_command}',
    "recording.write-new-when": (
        'to use only the new values, write new_when = "COLUMN" (a column that changes with each new value) '
        "in [files.…]"
    ),
    "recording.write-time-unit": 'if it is in {unit_name} write time_unit = "{unit_name}" in [files.{file}]',
    "recording.write-mirrored": "x and y are swapped, or one of y and yaw needs scale = -1.0",
    "recording.write-offset": "write offset = {offset} for the yaw, or {backward_offset} if the vehicle drove backward",
    "recording.write-gyro": "write scale = {scale} for {gyro}",
    "recording.write-compass": (
        "write scale = {scale} for {compass} if the compass counts clockwise, or scale = {second_scale} for {gyro} "
        "if the gyro does"
    ),
    "recording.write-steering": "to make it positive, write scale = {scale} and offset = {offset} for {key}",
    "recording.log-direction": (
        "log the speed with its sign, or give backward the column of the direction; else fit runs that only drive "
        "forward"
    ),
    "recording.swap-wheels": "swap left and right of {wheels}",
    "recording.swap-or-gyro": (
        "swap left and right of {wheels}; or, if the gyro is negative when the vehicle turns left, write "
        "scale = {scale} for {gyro}"
    ),
    "recording.swap-or-upside-down": (
        "swap left and right of {wheels}; or, if the IMU is upside down, write scale = {scale} for {gyro} "
        "and scale = {second_scale} for {key}"
    ),
    "recording.swap-axes": "swap the columns of a_x and a_y",
    "recording.swap-commands": "swap the columns of [command] u",
    "recording.check-track": (
        "check the scale of both: counts_per_turn, radius_m, unit of {wheels}, unit of {reference}"
    ),
    "recording.constant": "[{key}] entry {number}: {value:g} in all {rows} rows; is it connected?",
    "recording.constant-command": "command {name} is {value:g} all the time",
    "recording.repeated-rows": (
        "[{key}]: {share:.0%} of the rows repeat the previous row: a new value arrives about every "
        "{period_rows:.1f} rows"
    ),
    "recording.truth-fast": "[truth] eta: positions change by {speed_m_s:.3g} m/s",
    "recording.truth-turns": "[truth] eta[2]: the heading changes by {rate_rad_s:.3g} rad/s",
    "recording.mirrored": (
        "[truth] eta: course and heading turn in opposite directions (agreement {agreement:.2f}, mirrored "
        "{mirrored_agreement:.2f})"
    ),
    "recording.camera-turned": "[truth] eta[2]: the direction of motion differs from the heading by "
                    "{offset_deg:.0f}° (or {opposite_deg:.0f}°)",
    "recording.too-much": (
        '{key} with unit = "{unit_name}" reaches {value:.3g} {quantity}: this is too much for a small vehicle'
    ),
    "recording.tyres": (
        '{key} with unit = "{unit_name}" stays at {maximum:.3g} m/s² for {window_s:g} s: tyres cannot produce '
        "that"
    ),
    "recording.gyro-at-rest": (
        "{key} with unit = \"{unit_name}\" is {mean_rad_s:.2g} ± {std:.2g} rad/s before the first command; "
        "small gyros have less noise"
    ),
    "recording.fast-turns": (
        '{key} with unit = "{unit_name}" reaches {maximum:.3g} rad/s, {turns:.1f} turns per second'
    ),
    "recording.quiet": (
        '{key} with unit = "{unit_name}" varies by only {std:.1g} m/s² at rest, less than any usual accelerometer'
    ),
    "recording.counts-per-g": (
        '{key} with unit = "{unit_name}" has steps of 1/{counts}, as an accelerometer with {counts} counts per g'
    ),
    "recording.curve": '{first} and {last} with unit = "{unit_name}" imply curves at {speed_m_s:.3g} m/s',
    "recording.command-range": '{key} ({name}) reaches {maximum:.5g} with unit = "{unit_name}"; a full command is 1',
    "recording.against-truth": (
        "{key} is {slope:.3g} times the value in [truth] (correlation {correlation:.2f})"
    ),
    "recording.against-motion": (
        "{key} is {slope:.3g} times the value that speed and yaw rate imply (correlation {correlation:.2f})"
    ),
    "recording.unit-ratio": (
        'the unit "{unit_name}" is too small by a factor of {ratio:.4g}. Is the column in SI units?'
    ),
    "recording.no-sign": "{key} is never negative: the sensor does not measure the direction",
    "recording.no-sign-excluded": (
        "{key} is never negative: the sensor does not measure the direction. {count} of {rows} readings were "
        "excluded, from each command backward until the vehicle moves forward again"
    ),
    "recording.log-sign": "log the speed with its sign, or give backward the column of the direction",
    "recording.clock-later": (
        "[truth] agrees best with {key} if it is shifted {shift_ms:.0f} ms later (correlation {correlation:.3f} "
        "now, {shifted_correlation:.3f} then)"
    ),
    "recording.clock-earlier": (
        "[truth] agrees best with {key} if it is shifted {shift_ms:.0f} ms earlier (correlation {correlation:.3f} "
        "now, {shifted_correlation:.3f} then)"
    ),
    "recording.yaw-rates-opposite": (
        "{wheels} and {reference} give yaw rates of opposite sign (correlation {correlation:.2f})"
    ),
    "recording.cause-and-contradiction": "{cause}, and {key} contradicts it ({correlation:.2f})",
    "recording.yaw-rates-disagree": "{wheels} and {reference} disagree on the yaw rate (correlation {correlation:.2f})",
    "recording.track": (
        "{wheels} and {reference} agree if the wheels are {track_m:.3g} m apart (correlation {correlation:.2f})"
    ),
    "recording.axes-swapped": (
        "{first_key} agrees with v·ω and {second_key} with v̇ (correlations {first:.2f}, {second:.2f})"
    ),
    "recording.other-steering": (
        "command {command} turns the vehicle (correlation {correlation:.2f}), but {steering} does not"
    ),
    "recording.turns-right": (
        "a positive {steering} turns the vehicle to the right (correlation {correlation:.2f}): its gain "
        "will be negative"
    ),
    "recording.steps-back": (
        "{table}: time steps back by {step_s:.3f} s at line {line} ({count} such steps): {rows} rows up to "
        "there were excluded"
    ),
    "recording.counter-overflow": (
        "{table}: a counter of microseconds with 32 bits overflows at line {line} ({count} such steps): "
        "{shift_s:.3f} s were added to the later times"
    ),
    "recording.counter-wraps": "{key}: the counter {column} begins again after {counts} counts",
    "recording.repeats": (
        "{table}: {count} rows repeat the time of the previous row, the first at line {line}; one row of "
        "each time was kept"
    ),
    "recording.joined": (
        "{table}: {count} rows with {times} times contain different columns of the same time, the first at line "
        "{line}. The rows of each time were joined, because no column has two different values at one time"
    ),
    "recording.gap": "{table}: {gap_s:.3f} s without a row after line {line} (usual step {usual_s:.3f} s)",
    "recording.more-gaps": "{table}: {count} other gaps, none of them longer",
    "recording.tick-lasts": (
        '{table}: with time_unit = "{unit_name}" a tick lasts {tick_s:.3g} s, {rate_hz:.3g} per second'
    ),
    "recording.short-parts": "{count} parts with fewer than {minimum} ticks were excluded: {names}",
    "recording.no-command-yet": "{count} ticks before the first command were excluded",
    "recording.no-command": "no command: the vehicle is assumed to be at rest",
    "recording.missing": "[{key}]: {excluded_rows} of {rows} rows lack a number (NaN, empty) and were excluded",
    "recording.full-scale": (
        "{key}: {excluded_rows} of {rows} rows ({share:.1%}) are near full scale, {ends} in the unit of the column, "
        "and became gaps; {full_scale_count} are at full scale"
    ),
    "recording.larger-range": "choose a larger range of this sensor, or drive more gently",
    "recording.not-level": (
        "{column} is {mean:.3g} on average. According to gravity, {gyro} measures turns to the left, but {key} differs"
    ),
    "recording.write-axes": (
        "write the entries of z as {axes}, with scale = -1.0 for each minus; keep the map only if {column} contains "
        "gravity itself"
    ),
    "recording.no-time": "{table}: {count} rows without a time were excluded",
    "recording.cut-line": "{table}: line {line} is incomplete and was excluded",
    "recording.not-in-all": "{map}: {values} of [files.{file}] is not in [files.{second_file}] and was excluded",
}  # fmt: skip
