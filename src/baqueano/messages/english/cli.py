"""English sentences of the command line."""

TEMPLATES: dict[str, str] = {
    "cli.text": "{words}",
    "cli.number": "{option} {value} is not valid: expected a number {expected}.",
    "cli.whole-number": "{option} {value} is not valid: expected a whole number {expected}.",
    "cli.usage": "{words}. All options: {fix}",
    "cli.vehicle-argument": "{value} is a vehicle file, which is given with --vehicle. Type: {fix}",
    "cli.no-such-option": "{words}. All options: {fix}",
    "cli.option-before-verb": "{option} belongs after the command. Type: {fix}",
    "cli.interrupted": "Stopped from the keyboard.",
    "cli.memory": (
        "There is not enough memory for this ({error}). Use a smaller number, and run the command "
        "several times."
    ),
    "cli.not-compiled": "{error}. Or use Python instead: {fix}",
    "cli.output": "the output",
    "cli.system": "{place}: {error}. Is the disk full, or read-only? Make room or choose another place, then: {fix}",
    "cli.block-raised": "{place} raised {error}. Correct that line.",
    "cli.block-raised-and-ended": (
        "{place} raised {error}. A block must not end the program: correct that line."
    ),
    "cli.unexpected-error": (
        "Unexpected error: {error} ({file}, line {line}). Run the same command with --debug and send us the output."
    ),
    "cli.unknown-verb": "'{path} {value}' does not exist. {suggestion}.",
    "cli.no-such-verb": "'{path} {value}' does not exist. {suggestion}. To see what each command does: {fix}",
    "cli.unknown-setting": "The environment variable {variable} is {value}: expected one of {valid}. Type: {fix}",
    "report.table-ending": "{value}: expected a name that ends in .csv or .tex. Type: {fix}",
    "next.put-right": "Type: {fix}",
    "next.near-file": "Did you mean {match}? Type: {fix}",
    "next.allow-blocks": "If you trust it, type: {fix}",
    "next.options": "All options: {fix}",
    "next.decimal-comma": "Numbers are written with a decimal point here. Type: {fix}",
    "next.runs": "To see the runs: {fix}",
    "next.map": "To see a map: {fix}",
    "next.no-file": "{folder} does not contain a *{suffix} file. Give the path of such a file instead.",
    "next.files": "In {folder} there are {files}. Give the path of one of these files instead.",
    "next.files-and-more": (
        "In {folder} there are {files} and {count} more. Give the path of one of these files instead."
    ),
    "cli.block-breaks": "{block} fails {count} of the checks of a block; each is listed above.",
    "cli.block-role": "{arg[role]:{value}} does not exist. {suggestion}.",
    "cli.free-mixed": (
        "{arg[free]} without + ({names}) replaces the default set of parameters, so the fit estimates only the named "
        "ones. To add them to the default set instead, write + before each name."
    ),
    "cli.no-match": "No file in {folder} matches {value}.",
    "cli.block-without-class": "Write a block as file.py:Class. {classes}.",
    "cli.block-unknown": (
        'Block "{value}" does not exist. {suggestion}. Write one of your own as file.py:Class. To list '
        "the blocks: {fix}"
    ),
    "cli.signal-unknown": "--signal {value} does not exist. {suggestion}.",
    "cli.robot-mistyped": "--robot {value} is not a vehicle's name (pilot@rover.local). {suggestion}.",
    "cli.driver-unknown": "{value} is not a shape or a stored route. {suggestion}.",
    "cli.not-followed": "The vehicle did not follow the {shape} at {speed_m_s:g} m/s: {cause}. Drive slower: {fix}",
    "cli.case-unknown": "--case {value} does not exist. {suggestion}.",
    "cli.detectors-failed": "The detectors failed: {reasons}",
    "cli.route-refused": "Route {route} may not be driven, for the reasons above. Type: {fix}",
    "cli.cut-order": "The start --from {start_s:g} is not before the end --to {end_s:g}. Type: {fix}",
    "cli.cut-after-end": (
        "{run} lasts {duration_s:.2f} s, so it does not contain ticks from {start_s:g} s to the end."
    ),
    "cli.cut-empty": (
        "{run} lasts {duration_s:.2f} s, so it does not contain ticks from {start_s:g} s to {end_s:g} s."
    ),
    "cli.stopped": "The vehicle was stopped: {cause}. The recording up to the stop is in {path}. To see it: {fix}",
    "cli.route-stored": "route: {path}\nnext: {check}\nthen: {repeat}",
    "cli.route-stored-refused": "route: {path}, which the vehicle cannot drive in its present form",
    "cli.two-tolerances": "--rms and --max are two tolerances: give only one.",
    "cli.start-without-room": "--start is a place in a room: give the room too, for example --room 2x3.",
    "cli.pose-unreadable": (
        '--from "{value}": expected x, y and a heading in metres and degrees, relative to the start of the '
        "route, such as -0.5,0.2,30."
    ),
    "cli.start-unreadable": (
        '--start "{value}": expected x, y and a heading in metres and degrees, relative to the middle of the '
        "room, such as 0.5,-0.2,90."
    ),
    "cli.points-absent": "{path} does not exist. Give a CSV file with the columns x_m and y_m, or the name of a run.",
    "cli.run-names-invalid": (
        "{host} has {count} runs with names that cannot be used: {value}. Expected a plain name "
        "such as lap.mcap. They were not copied. Rename them there: {fix}"
    ),
    "cli.data-advice": "To see the data: {fix}",
    "cli.data-in-report": "The report shows the data",
    "cli.fit-refused": "The fit is refused, and the vehicle file stays as it is: {reasons}. {data}",
    "cli.calibration-refused": (
        "The calibration is refused, and the vehicle file and the map stay as they are: {reasons}"
    ),
    "cli.tuning-refused": "The gains are refused, and the vehicle file stays as it is: {reasons}",
    "cli.fit-mirrored": "The vehicle file stays as it is, because it contradicts the fit: {reasons}. {data}",
    "cli.fit-refused-held-out": (
        "The fit is refused on the held-out runs, and the vehicle file stays as it is: {reasons}. {data}"
    ),
    "cli.block-needs-arguments": (
        "{kind} could not be made without arguments ({error}). Give every field a default, or name it as "
        "kind in a vehicle file and pass that with --vehicle."
    ),
    "cli.rounds-without-designed": (
        "--rounds {rounds} with --signal {signal}: only a designed experiment uses the fit of "
        "the last drive. Type: {fix}"
    ),
    "cli.update-without-rounds": "--update needs --rounds: without a fit there is nothing to write. Type: {fix}",
    "cli.round-refused": "The fit of round {round} is refused: {reasons}. The run is {path}.",
    "cli.emulated-manual": (
        "The emulated vehicle does not run in real time, so it cannot be driven manually. Type: {fix}"
    ),
    "cli.hand-options": (
        "--pad, --no-hold, --closed and --update are only for a manual drive, but here the driver is {driver}. "
        "Type: {fix}"
    ),
    "cli.fit-interrupted": "Stopped from the keyboard: the table shows the fit at that moment; nothing was changed.",
    "cli.options-conflict": (
        "--over-time fits each run by itself, so it cannot be combined with {second_option}. Remove one of the "
        "two options."
    ),
    "cli.options-together": "{option} has no effect together with {second_option}. Remove one of the two.",
    "cli.option-needs": "{option} has an effect only together with {second_option}. Add that, or remove {option}.",
    "cli.tolerance-unused": (
        "--tolerance {value} is for a car that is fitted only with its IMU. Remove the option, or use "
        "only the IMU. Type: {fix}"
    ),
    "cli.tolerance-car": (
        "--tolerance {value} is for a car that is fitted only with its IMU. Remove the option."
    ),
    "cli.tolerance-conflict": (
        "--tolerance {value} cannot be combined with {second_option}: it is for a car that is fitted only with "
        "its IMU. Remove one of the two options. Type: {fix}"
    ),
    "cli.choose-conflict": (
        "--choose cannot be combined with {others}. First choose the terms; then fit them with "
        "these options. Type: {fix}"
    ),
    "cli.choose-without-encoders": (
        "--choose compares simulation errors, but a car with only an IMU needs a gyro-aided fit. Remove "
        "--choose. To free more parameters, type: {fix}"
    ),
    "cli.bound": "--bound {value}: expected KEY=LOW,HIGH. Type: {fix}",
    "cli.tolerance": "--tolerance {value}: expected KEY=FRACTION. Type: {fix}",
    "cli.cut-without-effect": "These options keep the whole run. Type: {fix}",
    "cli.several-runs": "-o {path}: this command writes several runs. Give a folder for them. Type: {fix}",
    "cli.study-interrupted": "Stopped from the keyboard: the table covers {count} of {total:,}.",
    "cli.recordings-interrupted": (
        "Stopped from the keyboard: the table shows the recordings evaluated so far; no report was written."
    ),
    "cli.folder-not-empty": "{folder} exists and is not empty. Choose another name: {fix}",
    "cli.file-exists": "{path} exists already, and this command does not replace it. Type: {fix}",
    "cli.map-second": "The map comes first, and the recordings follow. Type: {fix}",
    "cli.route-not-text": (
        "{path} is not a route: it contains bytes that are not text. Expected a text file (CSV) with the columns t_s, "
        "x_m, y_m, psi_rad and velocities. To drive one: {fix}"
    ),
    "cli.own-block": "--{role} {kind}: {cause}. To see all blocks: {fix}",
    "cli.own-file": "--{role} {kind}: {cause}. To check your block: {fix}",
    "cli.own-name": "--{role} {kind}: {cause}.",
    "cli.drive-interrupted": "Stopped from the keyboard. The run is complete: {path}, {duration_s:.1f} s.",
    "cli.network-conflict": "--wifi and --own-network: a Pi has one radio. Choose one of the two options.",
    "cli.hex-at-host": (
        "--hex names a file of this computer, but {host} uses the firmware of its own package. Remove "
        "--hex or {host}."
    ),
    "cli.vehicle": "vehicle: {name}",
    "cli.vehicle-of-garage": "vehicle: {name} (from the garage; --vehicle names another)",
    "cli.new": "{folder}: vehicle.toml, {blocks}",
    "cli.fitting": "fitting; runs: {runs}",
    "cli.fitting-span": "fitting; runs: {runs}, {span_s:.0f} s",
    "cli.translating": "translating the model",
    "cli.round-fitted": "round {round}: {verdict:word} {reasons}",
    "cli.driving-ahead": "driving in simulation; laps: {laps}",
    "cli.judging": "testing on held-out runs: {runs}",
    "cli.reading": "reading {name}",
    "cli.reading-files": "reading {count} files",
    "cli.study-paper": "fitting 60 s; seeds: {seeds}",
    "cli.until-ctrl-c": "The vehicle drives until you press Ctrl-C.",
    "cli.elapsed-time": "{label} {t_s:.0f} s, Ctrl-C ends it",
    "cli.ending": "ending with the results so far; Ctrl-C again to quit without them",
    "cli.estimator-place": (
        "estimator for {vehicle} ({sensors}): {estimator} with use = [{use}]: it corrects the pose with {place}"
    ),
    "cli.estimator-speed": (
        "estimator for {vehicle} ({sensors}): dead_reckoning until the vehicle is identified, then {estimator} with "
        "use = [{use}]"
    ),
    "cli.estimator-gyro": (
        "estimator for {vehicle} ({sensors}): {estimator}. Compare it with dead_reckoning; with "
        "both, the position drifts"
    ),
    "cli.estimator-nothing": (
        "estimator for {vehicle} (no sensors): dead_reckoning, because only the model gives the estimate"
    ),
    "cli.marks-too-few": "marks: press m on the mark before and after a lap. The lap then gives the scale of the gyro.",
    "cli.marks": "marks: {cause}",
    "cli.block-correct": "{block} passes every check of a block.",
    "cli.run": "run: {path}",
    "cli.next-command": "next: {fix}",
    "cli.room-replaced": (
        "room {size} m: {percent:.0f} % of the signal was replaced. The corridor of the body (3 "
        "standard deviations) stays {margin_cm:.1f} cm from the walls"
    ),
    "cli.first-drive": (
        "{name} was never fitted. First the vehicle turns and rolls a little on one spot. Each pulse is a "
        "little stronger than the previous one, until the sensors show motion (--trust-file skips this)"
    ),
    "cli.fitted": "{verdict:word}: {reasons}",
    "cli.first-drive-slow": (
        "The first drive was too slow to show {names}. So the plan uses a guess, and the next drive is faster"
    ),
    "cli.experiment": "experiment",
    "cli.planning-in-room": "planning a drive within a room of {size} m",
    "cli.driving-first": "first drive",
    "cli.fitting-first": "fitting the first drive",
    "cli.designing": "designing the experiment",
    "cli.round": "round {number}",
    "cli.game-pad": "game pad: {name}",
    "cli.terminal-hidden": (
        "{program} answers instead of your terminal, even after you close it. Therefore the command of "
        "each key lasts only a short time."
    ),
    "cli.stop-latched": "The stop is latched. Look at the vehicle, then type: {fix}",
    "cli.report": "report: {page}",
    "cli.figures": "figures: {count} in {folder}",
    "cli.repeat": "repeat",
    "cli.vehicle-of-run": "vehicle: the file stored in the run (--vehicle names another)",
    "cli.vehicle-of-run-differs": (
        "vehicle: the file stored in the run. vehicle.toml differs from it; to use it: --vehicle vehicle.toml"
    ),
    "cli.replay": "replay",
    "cli.compare": "comparison",
    "cli.read-run": "reading the run",
    "cli.start-in-middle": (
        "The vehicle begins again in the middle of the room, with its heading along the width of the room"
    ),
    "cli.put-in-middle": (
        "Put the vehicle back in the middle of the room, with its heading along the width of the room."
    ),
    "cli.taught": "next: {repeat}\nfor gains that suit this path, first: {tune}",
    "cli.route-slower": (
        "the route takes {duration_s:.1f} s at these speeds, and took {former_duration_s:.1f} s: "
        "the controller keeps {percent:.0f} % of the command. To keep less, type: {fix}"
    ),
    "cli.route-replaced": "{path} existed and was replaced by the new route",
    "cli.teach": "teach",
    "cli.no-estimate": "{run} does not contain an estimate; to make one: {fix}",
    "cli.measuring-noise": "measuring the noise",
    "cli.table": "table: {path}",
    "cli.drawing": "drawing the figures",
    "cli.predicting": "predicting a drive",
    "cli.trying-noise": "testing the noise on held-out runs",
    "cli.recovered": "{path}: {duration_s:.2f} s saved",
    "cli.cut": "{path}: {duration_s:.2f} s",
    "cli.imported": "{count} runs: {first} to {last}, {duration_s:.0f} s",
    "cli.drafted": "{path} contains a draft of the map. Replace each ? by a unit, then type: {fix}",
    "cli.drafted-complete": "{path} contains a draft of the map. Check it, then type: {fix}",
    "cli.next-without-command": (
        "The run contains no command, so a model cannot be fitted to it. If the vehicle drove, write [command] in "
        "the map. If it was at rest, its noise can be measured: {fix}. If it was turned by hand on a mark, its gyro "
        "can be calibrated: {calibrate}"
    ),
    "cli.mount-written": "The result was written into {path}; next: {fix}, which uses it",
    "cli.averaging": "computing the Allan deviation for all averaging times",
    "cli.comparing": "comparing with the camera",
    "cli.simulating": "simulating {seconds:g} s",
    "cli.simulating-many": "simulating {vehicles} vehicles",
    "cli.two-models": "comparing the kinematic model with the dynamic one",
    "cli.study-identification": "simulating and fitting 60 s with each of {seeds:,} seeds",
    "cli.study-faults": "fitting {count:,} runs with and without faults",
    "cli.study-driving": "identifying and driving {seeds} robots; each takes about 15 s of processor time",
    "cli.study-controllers": "tuning the controllers, then identifying and driving {seeds} robots",
    "cli.study-laps": (
        "identifying {seeds} robots and driving {laps} laps with each; a robot takes a quarter of an hour "
        "of processor time"
    ),
    "cli.study-first-drives": "driving {seeds} unknown vehicles; each takes about 10 s of processor time",
    "cli.study-corridor": "identifying and driving {vehicles} vehicles",
    "cli.tuning": "tuning: the closed loop is compiled, then searched from several starts",
    "cli.tuned": "These gains are for a {route} at {speed_m_s:g} m/s. For your own path: {fix}",
    "cli.page-waits": 'Take control on the page and press "Manual"; Ctrl-C ends it',
    "cli.page-drive-ended": "This drive is over. Its run is in the folder {folder}",
    "cli.page-ended": "The page process has ended.",
    "cli.page-manual": 'This page is for manual driving. Press "Manual" on it.',
    "cli.page-set": ("The gains of a robot are set on its own page. Type: {fix}"),
    "cli.page-time": "A real vehicle runs in real time: its time cannot be paused, slowed down or sped up.",
    "cli.page-replayed": "The page shows both runs until its last tab is closed; Ctrl-C ends it",
    "cli.motion": "The page shows the other drives; Ctrl-C ends it",
    "cli.demo": (
        "The runs, the route and the vehicle file are in the same folder as the report.\n"
        "next: {program} new mylab"
    ),
    "cli.figures-absent": "{option} {value} is only used with --figures FOLDER.",
    "cli.next-new": "next: {cd}\nthen: {fix}",
    "cli.guesses": (
        "The values of its model are guesses, until a fit to runs of your vehicle has estimated them"
    ),
    "cli.simulated-truth": (
        "simulated vehicle: {truth} (named in {vehicle} under [simulation]); the fit has to find its "
        "parameters"
    ),
    "cli.measure-first": (
        "{vehicle}: its model is a guess, so the vehicle will not drive at the requested speed. The expected errors "
        "do not contain the error of a guess. First identify the model: {experiment}, then {identify}"
    ),
    "cli.written": "written into {path}",
    "cli.set": "  set on the command line: {setting}",
    "cli.warning": "warning: {cause}",
    "cli.all-rows": "all rows of the table: {fix}",
    "cli.update-advice": "To keep this in the vehicle file, add --update.",
    "cli.run-note": "{run}: {cause}",
    "cli.card-written": "Eject the card, start the Pi, wait three minutes. Then: {fix}",
    "cli.no-network": (
        "Wi-Fi is not configured: connect a network cable, or repeat the command with --wifi SSID or "
        "--own-network"
    ),
    "cli.no-vehicle-file": (
        "This folder does not contain vehicle.toml. If the robot has such a file, it stays as it is "
        "(--vehicle names another)"
    ),
    "cli.is-a-vehicle": (
        "{host} is now set up as a vehicle. Restart it once, so that I2C works: {ssh} sudo reboot. "
        "Then: {fix}"
    ),
    "cli.own-network": "its Wi-Fi network: {ssid}, password {password}; its address there is 10.42.0.1",
}
