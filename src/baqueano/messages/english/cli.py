"""English sentences of the command line."""

TEMPLATES: dict[str, str] = {
    "cli.words": "{words}",
    "cli.number": "{option} {found} is refused: expected a number {expected}.",
    "cli.usage": "{words}. All options: {fix}",
    "cli.interrupted": "stopped from the keyboard.",
    "cli.memory": "there is not enough memory for this ({error}). Ask for less, in parts.",
    "cli.not-compiled": "{error}. Or let Python compute: {fix}",
    "cli.output": "what was to be written",
    "cli.system": "{place}: {error}. Make room or give another place, then: {fix}",
    "cli.block-raised": "{place} raised {error}. When it is mended, again: {fix}",
    "cli.block-raised-and-ended": (
        "{place} raised {error}. A block may not end the program. When it is mended, again: {fix}"
    ),
    "cli.unforeseen": (
        "an error that should not happen: {error} ({file}, line {line}). Run the same command with --debug and send us "
        "what it prints."
    ),
    "cli.unknown-verb": "There is no '{path} {found}'. {near}.",
    "cli.no-such-verb": "There is no '{path} {found}'. {near}. To see what each does: {fix}",
    "cli.unknown-backend": "The environment has BAQUEANO_BACKEND={found}: expected one of {known}. Type: {fix}",
    "report.table-ending": "{found}: expected a name that ends in .csv or .tex. Type: {fix}",
    "next.put-right": "Type: {fix}",
    "next.near-file": "Did you mean {meant}? Type: {fix}",
    "next.options": "All options: {fix}",
    "next.again": "When it is mended, again: {fix}",
    "next.no-file": "In {folder} there is no file *{suffix}. Give the path of one in its place.",
    "next.files": "In {folder} there are {files}. Give the path of one in its place.",
    "next.files-and-more": "In {folder} there are {files} and {more} more. Give the path of one in its place.",
    "cli.block-breaks": "{block} breaks of the promises of a block {count}; each is named above.",
    "cli.block-room": "--room {found} is unknown. {near}.",
    "cli.block-without-class": "A block is file.py:Class. {holds}.",
    "cli.block-unknown": 'There is no block "{found}". {near}. One of yours is file.py:Class. To see ours: {fix}',
    "cli.signal-unknown": "--signal {found} is unknown. {near}.",
    "cli.robot-mistyped": "--robot {found} is no name of a vehicle (pilot@rover.local). {near}.",
    "cli.driver-unknown": "{found} is neither a shape nor a stored route. {near}.",
    "cli.not-followed": "the vehicle did not follow the {shape} at {speed_m_s:g} m/s: {cause}. Slower: {fix}",
    "cli.case-unknown": "--case {found} is unknown. {near}.",
    "cli.detectors-failed": "the detectors failed: {reasons}",
    "cli.cut-after-end": "{run} has no tick from {from_s:g} s to the end: it lasts {duration_s:.2f} s.",
    "cli.cut-empty": "{run} has no tick from {from_s:g} s to {to_s:g} s: it lasts {duration_s:.2f} s.",
    "cli.stopped": (
        "the vehicle was stopped: {cause}. What was recorded until then is in {path}. To see it: {fix}"
    ),
    "cli.routes": "The routes there are: {stored}",
    "cli.no-routes": "No route is stored there yet",
    "cli.runs-named-oddly": (
        "{host} has {count} runs with names that cannot be used: {found}. Expected a plain name as lap.mcap. They "
        "were left where they are. Give them another name there: {fix}"
    ),
    "cli.data-unseen": "To see the data: {fix}",
    "cli.data-in-report": "The report shows the data",
    "cli.fit-refused": "the fit is refused, and the vehicle file stays as it is: {reasons}. {data}",
    "cli.fit-refused-held-out": (
        "the fit is refused on the held-out runs, and the vehicle file stays as it is: {reasons}. {data}"
    ),
    "cli.block-not-made": (
        "{kind} could not be made without arguments ({error}). Give every field a default, or name it as "
        "kind in a vehicle file and pass that with --vehicle."
    ),
    "cli.rounds-without-designed": (
        "--rounds {rounds} with --signal {signal}: only a designed experiment learns from the drive "
        "before. Type: {fix}"
    ),
    "cli.update-without-rounds": "--update: without --rounds nothing is fitted that could be written. Type: {fix}",
    "cli.round-refused": "the fit of round {round} is refused: {reasons}. The run is {path}.",
    "cli.emulated-by-hand": "the emulated vehicle has a time of its own, too fast for fingers. Type: {fix}",
    "cli.hand-options": (
        "--pad and --no-hold are for somebody who drives, and here {driver} does. Type: {fix}"
    ),
    "cli.fit-interrupted": (
        "stopped from the keyboard: the table is what was found by then; nothing was changed."
    ),
    "cli.options-conflict": (
        "--over-time does not go with {other}: it follows all runs, each fitted by itself. Leave one of "
        "the two away."
    ),
    "cli.tolerance-unused": (
        "--tolerance {given}: it widens the errors of a car that is fitted by its IMU alone, and this one is "
        "not. Leave it out, or use the IMU alone. Type: {fix}"
    ),
    "cli.tolerance-beside": (
        "--tolerance {given} does not go with {other}: it widens the errors of a car that is fitted by its IMU alone. "
        "Leave one of them out. Type: {fix}"
    ),
    "cli.choose-conflict": (
        "--choose does not go with {others}: choose first, and fit what was chosen with it afterwards. "
        "Type: {fix}"
    ),
    "cli.choose-without-encoders": (
        "--choose takes each term by simulation errors, and a car that is fitted by its IMU alone has a "
        "better fit, led by its gyro, that chooses none. Leave out --choose; to free more beside its own: "
        "{fix}"
    ),
    "cli.bound": "--bound {found}: expected KEY=LOW,HIGH. Type: {fix}",
    "cli.tolerance": "--tolerance {found}: expected KEY=PART. Type: {fix}",
    "cli.cut-nothing": "nothing is to be cut away. Type: {fix}",
    "cli.several-runs": "-o {out}: several runs are made. Give a folder for them. Type: {fix}",
    "cli.study-interrupted": "stopped from the keyboard: the table is of {done} of {asked:,}.",
    "cli.recordings-interrupted": (
        "stopped from the keyboard: the table is of what was judged by then; no report was written."
    ),
    "cli.folder-not-empty": "{folder} exists and is not empty. Choose another name: {fix}",
    "cli.robot-unknown": (
        "--robot {robot}: there is no way to reach such a robot yet; expected 'simulated', or "
        "'simulated:FILE' for the simulation of another vehicle file. Type: {fix}"
    ),
    "cli.file-exists": "{out}: there is a file already, and runs are never written over. Type: {fix}",
    "cli.route-absent": "There is no route {found}: {missing} is no file. {there}. To drive it once: {fix}",
    "cli.route-not-text": (
        "{path} is no route: expected a text file (CSV) with the columns t_s, x_m, y_m, psi_rad and "
        "velocities, found bytes that are no text. To drive one: {fix}"
    ),
    "cli.own-block": "--{room} {kind}: {cause}. To see what is wrong: {fix}",
    "cli.drive-interrupted": "stopped from the keyboard. The run is whole: {path}, {duration_s:.1f} s.",
    "cli.one-radio": "--wifi and --own-network: a Pi has one radio. Choose one of them.",
    "cli.hex-from-afar": (
        "--hex is a file of this computer, and {host} writes its own package's. Leave one of them out."
    ),
    "cli.vehicle": "vehicle: {name}",
    "cli.vehicle-of-garage": "vehicle: {name} (of the garage; --vehicle names another)",
    "cli.new": "{folder}: vehicle.toml, {blocks}",
    "cli.fitting": "fitting; runs: {runs}",
    "cli.fitting-span": "fitting; runs: {runs}, {span_s:.0f} s",
    "cli.translating": "translating the model",
    "cli.round-fitted": "round {round}: {verdict} {reasons}",
    "cli.driving-ahead": "driving in simulation; laps: {laps}",
    "cli.judging": "judging; unseen runs: {runs}",
    "cli.reading": "reading {name}",
    "cli.reading-files": "reading {count} files",
    "cli.study-paper": "fitting 60 s; seeds: {seeds}",
    "cli.clocked": "{label} {t_s:.0f} s, Ctrl-C ends it",
    "cli.ending": "ending with what is found; Ctrl-C again to leave it",
    "cli.estimator-place": (
        "estimator for {vehicle} ({sensors}): {usual} with use = [{use}]: it corrects the pose by {place}"
    ),
    "cli.estimator-speed": (
        "estimator for {vehicle} ({sensors}): dead_reckoning until the vehicle is identified, then {usual} with "
        "use = [{use}]"
    ),
    "cli.estimator-gyro": (
        "estimator for {vehicle} ({sensors}): {usual}, and dead_reckoning to see whether it is worth it; the position "
        "drifts with both"
    ),
    "cli.estimator-nothing": (
        "estimator for {vehicle} (no sensors): dead_reckoning: without a sensor every estimate is the model's"
    ),
    "cli.marks-too-few": "marks: press m on the mark before and after a lap, and the lap tells the scale of the gyro.",
    "cli.marks": "marks: {cause}",
    "cli.block-sound": "{block} keeps every promise of a block.",
    "cli.run": "run: {path}",
    "cli.next-identify": "next: {fix}",
    "cli.room-kept": (
        "room {size} m: {replaced_percent:.0f} % of the signal replaced, the corridor of the body (3 "
        "standard deviations) stays {margin_cm:.1f} cm from the walls"
    ),
    "cli.first-drive": (
        "{name} was never fitted: first it turns and rolls a little on one spot, each push somewhat harder "
        "than the one before, until it is seen to move (--known leaves that out)"
    ),
    "cli.fitted": "{verdict}: {reasons}",
    "cli.experiment": "experiment",
    "cli.keeping-in-room": "keeping it in {size} m",
    "cli.driving-first": "first drive",
    "cli.fitting-first": "fitting what it showed",
    "cli.designing": "designing the experiment",
    "cli.round": "round {number}",
    "cli.game-pad": "game pad: {name}",
    "cli.terminal-of-another": (
        "{another} answers in place of your terminal and outlives it: keys count for their time alone."
    ),
    "cli.stop-latched": "The stop is latched. Look at the vehicle, then type: {fix}",
    "cli.report": "report: {page}",
    "cli.repeat": "repeat",
    "cli.vehicle-of-run": "vehicle: the file that was in force in the run (--vehicle names another)",
    "cli.replay": "replay",
    "cli.middle-again": "the vehicle begins in the middle of the room again, heading along its width",
    "cli.put-back": "Put the vehicle back into the middle of the room, heading along its width.",
    "cli.taught": "next: {repeat}, after {tune} for gains that suit this path",
    "cli.route-replaced": "{path} was there, and is replaced by what was just taught",
    "cli.teach": "teach",
    "cli.no-estimate": "{run} holds no estimate; to make one: {fix}",
    "cli.measuring-noise": "measuring the noise",
    "cli.table": "table: {path}",
    "cli.drawing": "drawing the figures",
    "cli.predicting": "predicting a drive",
    "cli.trying-noise": "trying the noise on unseen runs",
    "cli.recovered": "{path}: {duration_s:.2f} s saved",
    "cli.cut": "{path}: {duration_s:.2f} s",
    "cli.imported": "{count} runs: {first} to {last}, {duration_s:.0f} s",
    "cli.next-fit": "next: {fix}   (baqueano new NAME makes one to begin with)",
    "cli.mount-written": "written into {path}; next: {fix}, which takes it into account",
    "cli.averaging": "averaging over all times",
    "cli.comparing": "comparing with the camera",
    "cli.simulating": "simulating {seconds:g} s",
    "cli.simulating-many": "simulating {vehicles} vehicles",
    "cli.two-models": "the kinematic model beside the dynamic one",
    "cli.study-identification": "simulating and fitting 60 s at each of {seeds:,} seeds",
    "cli.study-faults": "fitting {count:,} sound and damaged runs",
    "cli.study-driving": "identifying and driving {seeds} robots, some 15 s of processor each",
    "cli.study-marks": "identifying {seeds} robots, driving {laps} laps, some minutes of processor each",
    "cli.study-first-drives": "driving {seeds} unknown vehicles, some 10 s of processor each",
    "cli.study-corridor": "identifying and driving {vehicles} vehicles",
    "cli.tuning": "tuning: the closed loop is compiled, then searched from several starts",
    "cli.tuned": "these gains suit a {route} at {speed_m_s:g} m/s. For a path of yours: {fix}",
    "cli.demo": ("\nreport: {page}   runs, route and vehicle file beside it\nnext:   {program} new mylab"),
    "cli.next-new": "next: cd {name}, then baqueano experiment",
    "cli.guesses": ("the numbers of its model are guesses, until a fit has measured them on your vehicle"),
    "cli.measure-first": (
        "{vehicle}: its model is a guess, and the vehicle will miss its speed; measure it first: "
        "{experiment}, then {identify}"
    ),
    "cli.written": "written into {path}",
    "cli.set": "  set on the command line: {setting}",
    "cli.warning": "warning: {cause}",
    "cli.not-kept": "To keep this in the vehicle file, add --update.",
    "cli.run-note": "{run}: {cause}",
    "cli.card-written": "Eject the card, start the Pi, wait three minutes. Then: {fix}",
    "cli.no-network": (
        "no Wi-Fi: plug a network cable in. Or type it again with --wifi SSID or --own-network"
    ),
    "cli.no-vehicle-file": (
        "there is no vehicle.toml here: one that is on the robot stays as it is (--vehicle names another)"
    ),
    "cli.is-a-vehicle": "{host} is a vehicle. Once, for its I2C: ssh {host} sudo reboot. Then: {fix}",
    "cli.own-network": "its network: {ssid}, password {password}; there it is 10.42.0.1",
}
