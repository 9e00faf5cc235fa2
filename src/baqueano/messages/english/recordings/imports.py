"""Findings about a recording that is imported, and the lines to write in its map."""

TEMPLATES = {
    "doubt.alone": "{what:word}: {cause}",
    "doubt.with-line": "{what:word}: {cause}; {line}",
    "doubt.and-line": "{cause}; {line}",
    "doubt.then": "{first}. {then}",
    "doubt.and": "{first}, and {then}",
    "doubt.list": "{first}, {then}",
    "doubt.accepted": "{cause} (accepted by the map)",
    "doubt.write": "write {line}",
    "doubt.perhaps": "perhaps {line:word}",
    "doubt.perhaps-smaller": 'perhaps unit = "mg", or "raw" with a scale',
    "doubt.perhaps-gyro": "perhaps {line} for the gyro",
    "doubt.if-in": 'if the column is in {in_unit} write unit = "{in_unit}"',
    "doubt.check-scale": "check its scale",
    "doubt.check-both-units": "check both units",
    "doubt.check-unit-and-scale": "check its unit and scale",
    "doubt.check-with-speed": "check its unit and scale, and those of the speed, {source}",
    "doubt.write-scale": "write scale = {scale} for it",
    "doubt.write-unit": 'write unit = "{unit_of_it}" for {key}',
    "doubt.write-shift": "write shift_s = {shift_s} in [files.{file}]",
    "doubt.write-pulses": "write {line}, for pulses of 1000 to 2000 µs with 1500 in the middle",
    "doubt.write-largest": (
        "write {line}, where {most} is the largest one: a set-point in a physical unit does not have a full scale"
    ),
    "doubt.write-full": "write {line}, where a full command is {full}",
    "doubt.write-percent-or-full": 'write unit = "%", or {line}, where a full command is {full}',
    "doubt.write-new-when": (
        'for the new ones alone write new_when = "COLUMN" (one that changes with each) in [files.…]'
    ),
    "doubt.write-time-unit": 'if it is in {in_unit} write time_unit = "{in_unit}" in [files.{file}]',
    "doubt.write-mirrored": "x and y are swapped, or one of y and yaw needs scale = -1.0",
    "doubt.write-offset": "write offset = {off} for the yaw, or {back} if it drove backward",
    "doubt.write-gyro": "write scale = {scale} for {gyro}",
    "doubt.swap-wheels": "swap left and right of {wheels}",
    "doubt.swap-or-gyro": (
        "swap left and right of {wheels}, or if the gyro is negative where the vehicle turns left write "
        "scale = {scale} for {gyro}"
    ),
    "doubt.swap-or-upside-down": (
        "swap left and right of {wheels}, or if the IMU is upside down write scale = {scale} for {gyro} and "
        "scale = {also} for {key}"
    ),
    "doubt.swap-axes": "swap the columns of a_x and a_y",
    "doubt.swap-commands": "swap the columns of [command] u",
    "doubt.check-track": "check the scale of both: counts_per_turn, radius_m, unit of {wheels}, unit of {by}",
    "doubt.constant": "[{key}] number {number}: {value:g} in all {rows} rows; is it wired?",
    "doubt.constant-command": "command {name} is {value:g} all the time",
    "doubt.held": (
        "[{key}]: {share:.0%} of the rows repeat the one before: a new value comes about every {every:.1f} rows"
    ),
    "doubt.truth-fast": "[truth] eta: positions change by {speed_m_s:.3g} m/s",
    "doubt.truth-turns": "[truth] eta[2]: the heading changes by {rate_rad_s:.3g} rad/s",
    "doubt.mirrored": (
        "[truth] eta: course and heading turn opposite ways (agreement {same:.2f}, mirrored {mirrored:.2f})"
    ),
    "doubt.beside": "[truth] eta[2]: the vehicle moves {off_deg:.0f}° (or {back_deg:.0f}°) beside its heading",
    "doubt.too-much": (
        '{key} with unit = "{unit_read}" reaches {value:.3g} {shown}: this is too much for a small vehicle'
    ),
    "doubt.tyres": (
        '{key} with unit = "{unit_read}" stays at {most:.3g} m/s² for {window_s:g} s: tyres cannot hold that'
    ),
    "doubt.gyro-at-rest": (
        '{key} with unit = "{unit_read}" is {off:.2g} ± {sd:.2g} rad/s before the first command, and small gyros are '
        "quieter"
    ),
    "doubt.fast-turns": '{key} with unit = "{unit_read}" reaches {most:.3g} rad/s, {turns:.1f} turns a second',
    "doubt.quiet": (
        '{key} with unit = "{unit_read}" trembles by {sd:.1g} m/s² at rest and reaches {most:.2g}: few accelerometers '
        "are so quiet"
    ),
    "doubt.curve": '{first} and {last} with unit = "{unit_read}" belong to curves at {speed_m_s:.3g} m/s',
    "doubt.command-range": '{key} ({name}) reaches {most:.5g} with unit = "{unit_read}"; a full command is 1',
    "doubt.against-truth": "{key} is {slope:.3g} times what [truth] says (correlation {correlation:.2f})",
    "doubt.against-motion": "{key} is {slope:.3g} times what speed and turning give (correlation {correlation:.2f})",
    "doubt.twice": '"{unit_read}" is too small by {ratio:.4g}; is it SI?',
    "doubt.no-sign": "{key} is never negative: the sensor does not know the direction",
    "doubt.clock-later": "[truth] fits {key} best {by_ms:.0f} ms later (correlation {now:.3f}, then {then:.3f})",
    "doubt.clock-earlier": "[truth] fits {key} best {by_ms:.0f} ms earlier (correlation {now:.3f}, then {then:.3f})",
    "doubt.turns-against": "{by} turns against {wheels} (correlation {correlation:.2f})",
    "doubt.and-sideways": "{cause}, and {key} against it ({correlation:.2f})",
    "doubt.turns-otherwise": "{wheels} does not turn as {by} says (correlation {correlation:.2f})",
    "doubt.track": (
        "{wheels} and {by} turn as wheels that are {apart_m:.3g} m apart do (correlation {correlation:.2f})"
    ),
    "doubt.axes-swapped": "{x} follows v·ω and {y} v̇ (correlations {first:.2f}, {second:.2f})",
    "doubt.other-steers": "command {other} turns the vehicle (correlation {correlation:.2f}), {steering} does not",
    "doubt.turns-right": "positive {steering} turns right (correlation {correlation:.2f}): its gain will be negative",
    "doubt.steps-back": (
        "{table}: time steps back by {back_s:.3f} s at line {line} ({count} such steps): {lost} rows up to there were "
        "left out"
    ),
    "doubt.repeats": (
        "{table}: {count} rows repeat the time of the row before, the first at line {line}; one of each was kept"
    ),
    "doubt.gap": "{table}: {gap_s:.3f} s without a row after line {line} (usual step {usual_s:.3f} s)",
    "doubt.more-gaps": "{table}: and {more} more gaps",
    "doubt.tick-lasts": '{table}: with time_unit = "{unit_read}" a tick lasts {tick_s:.3g} s, {rate_hz:.3g} a second',
    "doubt.short-parts": "{count} parts with fewer than {least} ticks were left out: {names}",
    "doubt.no-command-yet": "{count} ticks before the first command were left out",
    "doubt.no-command": "no command: the vehicle stands",
    "doubt.missing": "[{key}]: {lost} of {rows} rows lack a number (NaN, empty) and were left out",
    "doubt.no-time": "{table}: {count} rows without a time were left out",
    "doubt.cut-line": "{table}: line {line} is cut and was left out",
    "doubt.not-in-all": "{map}: {values} of [files.{file}] is not in [files.{lacking}] and was left out",
}  # fmt: skip
