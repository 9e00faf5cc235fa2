"""English sentences about manual drives, repeated paths and missions, marks and first drives."""

TEMPLATES: dict[str, str] = {
    "pad.not-linux": "--pad: game pads are read from Linux's /dev/input. Here, drive with the keys.",
    "pad.several": "--pad: there are {count} game pads: {names}. Name one: --pad {first}",
    "pad.may-not-read": "--pad {path}: this user is not allowed to read it. Type: {fix}",
    "pad.not-evdev": (
        "--pad {path} is not a device of evdev ({error}): expected one such as "
        "/dev/input/event5. Without a path, --pad searches for the pad."
    ),
    "keys.no-terminal-control": (
        "This terminal cannot read single keys: give the drive as a list of commands."
    ),
    "keys.no-terminal": (
        "Driving with the keys needs a terminal; here the input is a file or a pipe. Over ssh, use ssh -t."
    ),
    "drive.duration": "{name} = {value}: expected a finite number of seconds {range}.",
    "drive.laps": (
        "laps = {value}: expected 1 or more. With laps=0 the route is repeated without end, so add the time at which "
        "the drive ends, such as duration_s=60.0."
    ),
    "drive.seed": "seed = {value}: expected a whole number, 0 or more.",
    "marks.too-few": "{name} has {marks} marks: at rest on the mark, press m before and after a lap.",
    "marks.no-gyro": "{name} or its vehicle file does not have a gyro, so this run cannot calibrate one.",
    "marks.place-std": "place_std_m = {value:g}: expected a finite number of metres above 0.",
    "marks.no-lap": (
        "{name} has {ticks} ticks between its first and its last mark. At rest on the mark, press m before and after a "
        "lap."
    ),
    "marks.no-covariance": (
        "{name}: the estimator {kind} does not report a finite pose and covariance for this lap. Identify the "
        "vehicle again, or choose another estimator in the vehicle file."
    ),
    "marks.lap-no-scale": (
        "{name}: the end of this lap does not determine the scale of {gyro} within {tolerance_percent:.0f} %. Drive "
        "a lap with turns, such as a circle or an eight."
    ),
    "marks.lap-open": (
        "{name}: this lap did not return to its start. With the scale of {gyro} that fits best, its estimated end is "
        "{gap_m:.2f} m and {turn_deg:+.1f}° from the start. Its χ² is {chi2:.0f}; 99.9 % of the laps that return have "
        "at most {maximum:.1f}. Either the vehicle stopped elsewhere, or a wheel slipped, or the model is wrong. Drive "
        "another lap, and end it on the mark with the same heading: {fix}"
    ),
    "marks.lap-other-scale": (
        "{name}: this lap gives the gyro of {gyro} the scale {value:.3f}; the vehicle file states {file:.3f}. The "
        "difference is {percent:+.1f} %, and at most {max_percent:.1f} % was expected from both standard deviations. "
        "Either the lap did not return to its start, or the scale in the file is wrong. Turn the vehicle twice between "
        "two marks, which gives the scale without the file: {fix}"
    ),
    "marks.no-turn": (
        "{name}: the turns between the marks cancel, as in a figure of eight, so they do not determine "
        "a scale. Drive a circle or a rectangle, in one direction."
    ),
    "marks.no-whole-turn": (
        "{subject}: between two marks the gyro measured {turn_deg:.0f}°. Expected a whole number of "
        "turns, within {tolerance_percent:.0f} %, and at most {maximum}. Press m only when the vehicle is on the "
        "same mark with the same heading."
    ),
    "marks.stood-too-short": (
        "{name}: the vehicle was at rest for {rest_s:.1f} s, too short to measure the bias of "
        "its gyro. Leave it at rest on the mark for 2 s, then drive."
    ),
    "first-drive.no-imu": (
        "{name} does not have a sensor imu, but a first drive needs a gyro to stop in time. Add "
        "[sensors.imu] to the vehicle file. Or type --trust-file, and stay near the switch."
    ),
    "first-drive.limit": (
        "{vehicle}: [command] limit = {limit}: expected the largest magnitude of each command, finite, and "
        "at least one above 0."
    ),
    "first-drive.no-estimates": "{name} does not contain estimates of a first drive.",
    "mission.kind": 'A mission of kind "{kind}": expected one of {valid}.',
    "mission.version": "This mission is of another version: update baqueano on both sides.",
    "mission.damaged": "This is not a mission ({kind}: {error}).",
    "mission.two-files": "Two files of blocks are called {name}: give one of them another name.",
    "mission.no-driver": "Teaching needs a route, or a person who drives.",
    "mission.file-name": "A block in the file {name}: expected a plain name that ends in .py.",
    "smooth.not-kalman": (
        "{estimator} cannot be smoothed: smoothing needs a Kalman filter, with a belief of mean (η, ν, …) and "
        "cov, and innovations. Replay without {arg[smooth]}, or with {arg[estimator]:augmented_ekf}"
    ),
    "smooth.smoothed": (
        "the estimates are smoothed: the filter {estimator} also used the measurements after each instant."
    ),
    "smooth.not-compiled": "{estimator} cannot be compiled, so it cannot be smoothed: {cause}",
    "drive.usual-noise": (
        "the vehicle file does not contain the noise of {sensors}, so the estimator uses a typical value. "
        "To measure it, type: {fix}"
    ),
    "drive.sensor-ignored": (
        "sensors of the position or the speed that the estimator does not use: {sensors}. To use them, write in the "
        "vehicle file: {fix}. Then fit again, for their noise"
    ),
    "drive.signal-shape": (
        "The signal has shape {value}: expected finite numbers (N, {commands}), one column for each of {names}."
    ),
    "drive.driver-type": (
        "The driver is of type {kind}. Expected a Route, such as baqueano.guides.shapes.circle(1.0, 0.25), a guide, a "
        "list of (seconds, command), or a function that returns a command."
    ),
    "drive.step-pair": "Step {number} of the drive is {value}: expected (seconds, command).",
    "drive.step-numbers": (
        "Step {number} of the drive is {value}: expected a time above 0 s and {commands} finite numbers."
    ),
    "drive.no-steps": "The list of steps is empty: give at least one (seconds, command).",
    "drive.diagnostic-failed": "diagnostic() of the {role} failed: {error}. It is not called again in this drive.",
    "mpc.no-solver": "osqp is not installed, and the controller mpc needs its solver. Type: {fix}",
    "mpc.old-plan": (
        "The solver of mpc did not find a command in time. The plan of the previous tick continues, for at "
        "most {maximum} ticks in a row."
    ),
    "mpc.unsolved": (
        "The solver of mpc did not find a command in {ticks} ticks in a row. Is the vehicle "
        "beyond a wall (wall_low, wall_high), or is its estimate not finite? Use another "
        "controller: {arg[controller]:lqr}"
    ),
    "route.no-estimates": "{name} does not have an estimated path, so it cannot become a route.",
    "route.no-motion": "{name}: the vehicle did not move, so the run cannot become a route.",
    "route.stopped": "{name}: the drive ended before the vehicle moved: {cause}.",
    "route.open": (
        "{name} ends {gap_m:.2f} m and {gap_deg:.0f}° from where it began; a closed route returns to "
        "within {tolerance_m} m and {tolerance_deg:.0f}°. Drive back to the mark, or teach it as an open route."
    ),
    "drive.not-started": (
        "{cause}. This was before the first tick: the vehicle did not move, and the run was not written."
    ),
    "pad.lacks": (
        '--pad {path}: "{name}" cannot be used as a game pad ({reason}). Without a path, --pad searches for '
        "the pad."
    ),
    "pad.no-stick": "no stick",
    "pad.no-front-buttons": "no front buttons",
    "pad.none": (
        "--pad: no game pad is plugged in: {folder}/event* does not exist. Plug one in, or drive with "
        "the keys."
    ),
    "pad.not-among": (
        "--pad: no game pad is plugged in; of {folder}/event*, {devices} were checked. Plug one "
        "in, or drive with the keys."
    ),
    "pad.closed": (
        "--pad: no game pad is plugged in. Of {folder}/event*, {devices} were checked, and this user is "
        "not allowed to read {locked_devices}. If one of these is the pad, type: {fix}"
    ),
    "wiring.turns-wrong-left": "the left wheel turns the vehicle in the wrong direction: check its wires",
    "wiring.turns-wrong-right": "the right wheel turns the vehicle in the wrong direction: check its wires",
    "wiring.same-response": "the two wheels respond as one: check the wires of both motors",
    "wiring.swapped": (
        "left and right motor are swapped. An IMU that is upside down gives the same readings, so calibrate the IMU "
        "first. Then swap the connectors of the motors"
    ),
    "wiring.backwards-left": "the left motor runs backwards: swap its two wires",
    "wiring.backwards-right": "the right motor runs backwards: swap its two wires",
    "first-drive.nothing-moved": (
        "nothing moved with {command:word}: is the motor connected? Is the battery charged?"
    ),
    "first-drive.ended-early": (
        "the sensors showed no motion with up to {command_percent:.0f} % of {command:word}, and then the "
        "drive ended. The vehicle left its spot, or the drive took too long. Put it back and start again"
    ),
    "mission.lacks": 'A mission of kind "{kind}" needs {name}.',
}
