"""English sentences about vehicle files and the blocks that they name."""

TEMPLATES: dict[str, str] = {
    "vehicle.commands-differ": (
        "The run was driven with {value} commands, but the fit uses {expected}: expected a run of the same "
        "kind of vehicle. Type: {fix}"
    ),
    "vehicle.no-route": "{guide} repeats a route, but a route is missing: teach one, or name its file.",
    "vehicle.no-tomlkit": "Writing a vehicle file back needs tomlkit, which keeps its comments. Type: {fix}",
    "vehicle.of-garage": '"{name}" is from the garage: name a file for it, save("{name}.toml").',
    "vehicle.changed-since": (
        "{file} was changed by another program after it was read, so it stays as it is. Read it again before you "
        "write it."
    ),
    "vehicle.no-entry": "{key} has the shape {shape}: entry {entry} does not exist.",
    "vehicle.setting": "--set {setting}: expected key=value, for example --set model.mass_kg=0.7.",
    "vehicle.not-written": (
        "{path}: cannot be written: {error}. Choose another place, or free space if the disk is full."
    ),
    "vehicle.set": "--set {setting}: {cause}.",
    "toml.too-large": "{file} has {size:,} bytes: a vehicle file has at most {largest:,}. Is it another file?",
    "toml.utf-16": "{file} is written in UTF-16: expected UTF-8. Save it again: Notepad, Save as, Encoding: UTF-8.",
    "toml.zero-bytes": (
        "{file} contains null bytes: it is not text in UTF-8, or a loss of power cut it. Save it with the "
        "encoding UTF-8, or restore a copy."
    ),
    "toml.empty": "{file} is empty: did a loss of power cut it? To create one: {fix}",
    "toml.too-deep": "{file} nests its values too deeply: at most {maximum} levels.",
    "toml.not-read": "{path}: cannot be read: {error}.",
    "toml.not-utf-8": (
        "{file} line {line} contains the byte 0x{byte:02x}, which is not UTF-8 (an accent from an old "
        "editor?). Save the file with the encoding UTF-8."
    ),
    "toml.number": "{file} contains a number that cannot be read: {error}.",
    "toml.long-key": "{file} line {line}: this key has more than {maximum} parts.",
    "block.no-role": (
        "{place} {block}.step(state, {names}) does not match any type of block. The names of its arguments "
        "must be those of one type. Estimator: step(state, tick). Guide: step(state, estimate). "
        "Controller: step(state, reference, estimate). Supervisor: step(state, command, tick, estimate)."
    ),
    "block.step-without-self": (
        "{place}: {block}.step({names}) lacks self, which Python passes as the first argument of a method. Write "
        "step(self, {names})."
    ),
    "block.no-step": "{place}: {block} does not have step(). Every block has init() and step(state, …).",
    "block.not-class": '{file}: "{value}" is {kind}, expected a class with init() and step(state, …).',
    "block.not-module": "{path}: Python cannot read this file as a module.",
    "block.not-python": "{file} line {line} is not valid Python: {error}: {text}",
    "vehicle.folder": "{path} is a folder. Expected a vehicle file, such as one of its files: {files}.",
    "vehicle.folder-empty": "{path} is a folder that does not contain a vehicle file. To create one: {fix}",
    "vehicle.unknown": (
        'Vehicle "{value}" is not in the garage. {suggestion}. A file of your own ends in .toml. To create one: '
        "{fix}"
    ),
    "vehicle.absent": ("{absent_path} does not exist. {suggestion}. To create one: {fix}"),
    "vehicle.truth-elsewhere": (
        "{file} [simulation] truth = {value} points outside the folder of the file. Expected a file in "
        "that folder, or one of the garage: {garage}."
    ),
    "vehicle.no-change": (
        "{file}: attribute {value} cannot be changed. For a copy of the vehicle file with another value, type: {fix}"
    ),
    "vehicle.attribute-is-key": "{file}: attribute {value} does not exist. To read {key} of the file, type: {fix}",
    "vehicle.unknown-key": "{file} does not have key {value}. {suggestion}.",
    "block.lacks-arguments": (
        "{block} needs {keys}. Give an object with its values, such as {fix}, or write them into [{role}] of {file}."
    ),
    "vehicle.lacks": "{file} [{role}] needs {keys}. Write the values into the file.",
    "vehicle.lacks-estimates": (
        "{file} [{role}] needs {keys}. Write the values into the file, or compute them: {fix}"
    ),
    "vehicle.lacks-gains-of": (
        "{file} [{role}] needs {keys} for {kind}, but its gains belong to {own_kind}. Compute them into a file of "
        "their own: {fix}. A sweep accepts {gains_file} instead of {kind}, and a drive accepts it as its vehicle "
        "file."
    ),
    "vehicle.place": "{file}, {key}",
    "vehicle.line": "{file} line {line}, {key}",
    "vehicle.problems": "{first}.\n{rest}.",
    "vehicle.no-format": (
        "{place}: this key is missing. The first line of a vehicle file is format = {expected}. "
        "Is it another kind of file?"
    ),
    "vehicle.newer-format": "{place} = {value}: this baqueano reads format {expected}. Update it: {fix}",
    "vehicle.other-format": "{place} = {value}: this baqueano reads format {expected}. Write format = {expected}.",
    "vehicle.no-top-key": "{place} is missing: write {example} above the first table.",
    "vehicle.no-table": "{place} is missing: this table is required.",
    "vehicle.no-command-names": (
        '{place} is missing: write names = ["u_x", "u_y", "u_psi"], one for each entry of u.'
    ),
    "vehicle.command-names": "{place} has {value} names, but model {model} has a command of {expected} entries.",
    "vehicle.command-name-twice": "{place} = {value}: two entries have the same name.",
    "vehicle.command-limits": (
        "{place} has {value} numbers, but the command has {expected} entries: write one number per entry."
    ),
    "vehicle.not-table": "{place} = {value}: expected a table. Write [{table}] on a line of its own.",
    "vehicle.derived-key": "{place} is computed from the other keys. Delete the line.",
    "vehicle.key-unknown": "{place} is not a key of this table. {suggestion}.",
    "vehicle.table-unknown": "{place} is not a key or table of a vehicle file. {suggestion}.",
    "vehicle.unit-missing": "Write the unit in the key: {key} = {value} if it is in {unit_name}",
    "vehicle.unit-other": "This key is in {unit_name}: {value} {given_unit} is {key} = {converted_value}",
    "vehicle.number-in-quotes": (
        "{place} = {value}: expected one number [{unit_name}], {meaning:word}. Remove the quotes."
    ),
    "vehicle.not-number": "{place} = {value}: expected one number [{unit_name}], {meaning:word}.",
    "vehicle.not-numbers": "{place} = {value}: expected {size} [{unit_name}], {meaning:word}.",
    "vehicle.size": "{place} has {value}: expected {size} [{unit_name}], {meaning:word}.",
    "vehicle.size-with-commas": (
        "{place} has {value}: expected {size} [{unit_name}], {meaning:word}. Are these decimal commas? Write "
        "points."
    ),
    "vehicle.one-number": "one number",
    "vehicle.any-numbers": "a list of numbers",
    "vehicle.numbers": "{count} numbers",
    "vehicle.rows": "{rows} rows of {columns} numbers",
    "vehicle.not-finite": "{place} = {value}: expected finite numbers [{unit_name}], {meaning:word}.",
    "vehicle.out-of-range": "{place} = {value}: expected {expected} [{unit_name}], {meaning:word}.",
    "vehicle.at-least": "at least {low:g}",
    "vehicle.at-most": "at most {high:g}",
    "vehicle.between": "{low:g} to {high:g}",
    "vehicle.not-covariance": "{place} is not a covariance: {error}",
    "vehicle.not-text": '{place} = {value}: expected text in quotes, "…".',
    "vehicle.no-choice": "{place} = {value:g}: expected one of {valid}.",
    "vehicle.imu-axes": (
        "{place} = {value}: expected the chip's axes that point forward, left and up. Each letter appears once, and "
        'the axes are right-handed: ["x", "y", "z"], or ["x", "-y", "-z"] for a chip upside down.'
    ),
    "vehicle.not-flag": "{place} = {value}: expected true or false.",
    "vehicle.not-whole": "{place} = {value}: expected a whole number.",
    "vehicle.not-one-finite": "{place} = {value}: expected one finite number.",
    "vehicle.not-names": '{place} = {value}: expected a list of names, ["…", "…"].',
    "vehicle.not-list": "{place} = {value}: expected a list of finite numbers.",
    "vehicle.model-lacks": "{place} is incomplete: {model} needs {keys}.",
    "vehicle.model-lacks-inertia": (
        "{place} is incomplete: {model} needs {keys}. Or give radius_m in [geometry]; then ½ m R² is used."
    ),
    "vehicle.sensor-name": (
        "{place} is not a sensor's name: expected letters, digits and _ only, a letter first, and no keyword of "
        "Python such as 'and'."
    ),
    "vehicle.sensors-not-table": "{place} is not a table: write [sensors.imu] and its keys below it.",
    "vehicle.table-lacks": "{place} needs {keys}.",
    "vehicle.acceleration": (
        "{place}: {vehicle}.nu_dot() returns {value} at rest: expected an array (3,) of finite numbers, forward, "
        "sideways and turning. Write np.array([a, 0.0, 0.0])"
    ),
    "vehicle.refused": "{block} does not accept {place}: {error}",
    "vehicle.sensor-breaks": "{place} cannot measure. {cause}. Correct that line, then type: {fix}",
    "vehicle.not-built": "{place} cannot be built: {block} raised {error}.",
    "vehicle.lacks-members": (
        "{place}: {block} lacks {names}, which a vehicle needs. Inherit from baqueano.vehicles.AccelerationModel, and "
        "write nu_dot."
    ),
    "vehicle.block-not-table": "{place} is not a table: write [{table}] on a line of its own, and its keys below it.",
    "vehicle.no-kind": '{place} needs kind = "…": one of {valid}, or "file.py:Class".',
    "vehicle.kind-mistyped": (
        '{place} needs kind = "…": one of {valid}, or "file.py:Class". Is {value} meant to be kind?'
    ),
    "vehicle.kind-not-text": "{place} = {value}: expected text in quotes, one of {valid}.",
    "vehicle.kind": '{place} = "{kind}": {cause}.',
    "vehicle.provenance-not-table": "{place} is not a table: it must contain run, date, std and verdict.",
    "vehicle.not-date": "{place} = {value}: expected a date without quotes, as 2026-11-21.",
    "vehicle.not-std": "{place} = {value}: expected standard deviations, 0 or more; nan if unknown.",
    "vehicle.cov-not-table": "{place} is not a table: it must contain run, date, names, std and correlation.",
    "vehicle.cov-names": (
        "{place} contains a parameter that is not in the file. Delete the table: the next fit writes it."
    ),
    "vehicle.cov-size": (
        "{place} has {expected} names. Expected the same number of std, 0 or more, and a correlation of "
        "rows of 1, 2, … {expected} numbers from -1 to 1. Delete the table: the next fit writes it."
    ),
    "vehicle.correlation": "{place} has the eigenvalue {eigenvalue:.3g}, which is impossible for a correlation.",
    "vehicle.envelope-not-table": "{place} is not a table: it must contain run, names, low and high.",
    "vehicle.envelope-names": (
        "{place} must name first the commands {commands}, and then channels such as imu[2]. Delete the "
        "table: the next fit writes it."
    ),
    "vehicle.envelope-ranges": (
        "{place} does not contain one low and one high, finite and in this order, for each of its names. "
        "Delete the table: the next fit writes it."
    ),
    "vehicle.in-unit": "Is it in {unit_name}? {value:.3g} {unit_name} is {value_m:.3g} m",
    "vehicle.in-metres": "Is it in m?",
    "vehicle.centre-of-mass": (
        "{place} = {value:g} m is outside the platform, which ends at {radius_m:g} m. {unit_name}."
    ),
    "vehicle.two-shapes": (
        "{place} and length_m, width_m: a platform is round or rectangular. Keep one of the two shapes."
    ),
    "vehicle.track": (
        "{place} = {value:g} m: this is wider than the platform, which measures {across_m:g} m across. "
        "{unit_name}. Otherwise correct the size of the platform in [geometry]."
    ),
    "vehicle.wheel": (
        "{place} = {value:g} m: the wheel is larger than the platform, {across_m:g} m. {unit_name}."
    ),
    "vehicle.too-heavy": (
        "{place} = {value:g}: on a platform that ends {radius_m:g} m from its middle this is {density_kg_m2:.3g} kg "
        "per m² of floor. That is more than half a metre of solid steel. Is the mass in kg, and are the measures of "
        "[geometry] in m?"
    ),
    "vehicle.too-light": (
        "{place} = {value:g}: on a platform that ends {radius_m:g} m from its middle this is {density_kg_m2:.3g} kg "
        "per m² of floor. That is less than a sheet of cardboard. Is the mass in kg, and are the measures of "
        "[geometry] in m?"
    ),
    "vehicle.disc": "radius_m = {radius_m:g}. A uniform disc has {uniform_kg_m2:.3g}",
    "vehicle.plate": "the platform ends at {radius_m:.3g} m. A uniform plate has {uniform_kg_m2:.3g}",
    "vehicle.inertia-unchecked": (
        "{place} = {value:g}: with {mass_kg:g} kg this is a radius of gyration of {gyration_m:.3g} m, "
        "longer than the vehicle. It is accepted: with commands and an IMU it only scales the torques. To "
        "check it, give radius_m in [geometry]."
    ),
    "vehicle.inertia-too-large": (
        "{place} = {value:g}: with {mass_kg:g} kg this is a radius of gyration of {gyration_m:.3g} m, but {measure}. "
        "Was it computed in g or cm, or as m/r²?"
    ),
    "vehicle.inertia-of-point": (
        "{place} = {value:g}: with {mass_kg:g} kg this is a radius of gyration of {gyration_m:.3g} m, so "
        "all mass is in a point, but {measure}. Was it computed in g or cm?"
    ),
    "vehicle.dead-zone": (
        "{place} = {value}: a channel reaches at most {end} [{unit_name}], so a motor would never turn. Is "
        "it in percent?"
    ),
    "vehicle.too-stiff": (
        "{place} = {value}: this value stops the vehicle within {decay_ms:.3g} ms, but a step of "
        "the integrator at {rate_hz:g} Hz lasts {step_ms:.3g} ms. A motion that decays more than {maximum:g} times "
        "faster than a step cannot be integrated. Increase one of {keys}. Or is the value in another unit?"
    ),
    "vehicle.entry-too-stiff": (
        "{place} = {value}: entry {entry} stops the vehicle within {decay_ms:.3g} ms, but a step of "
        "the integrator at {rate_hz:g} Hz lasts {step_ms:.3g} ms. A motion that decays more than {maximum:g} times "
        "faster than a step cannot be integrated. Increase one of {keys}. Or is the value in another unit?"
    ),
    "vehicle.too-fast": (
        "{place}: the largest command would produce more than {maximum:g} {unit_name}. Are the gains and the "
        "friction in N and m?"
    ),
    "vehicle.lever-arm": (
        "{place} = {value}: {distance_m:.3g} m from the middle of a platform that ends at {radius_m:.3g} m. "
        "{unit_name}."
    ),
    "block.role-unknown": 'Block type "{value}" does not exist. {suggestion}.',
    "block.without-class": 'A block of your own is written "file.py:Class". {classes}.',
    "block.classes": "{file} contains {classes}",
    "block.no-classes": "{file} does not define a class",
    "block.unknown": (
        '{role:word} "{value}" does not exist. {suggestion}. Write one of your own as "file.py:Class".'
    ),
    "block.in-other-role": (
        '{role:word} "{value}" does not exist: {value} is a block of the type {actual_role:word}. {suggestion}.'
    ),
    "block.file-absent": "File {absent_path} does not exist, but it should define a block. {suggestion}.",
    "block.outside-folder": (
        "{kind} is Python code outside the folder of its vehicle file: {path}. Code runs with "
        "all your permissions, so read it first."
    ),
    "block.in-run": (
        "{kind} is named in a run; its code is in {path}. Code runs with all your permissions, so read it "
        "first."
    ),
    "block.in-run-elsewhere": (
        "{kind} is named inside a run, and its path points outside this folder. Such code is never "
        "executed. Name a vehicle file of your own: --vehicle FILE."
    ),
    "block.class-unknown": '{file} does not have a class "{value}". {suggestion}.',
    "block.cell-class-unknown": (
        "Class {value} does not exist in this program: it was defined in a notebook cell or in a script. Execute its "
        "definition first, or write it in a file and name it as file.py:{value}."
    ),
    "block.raised-while-read": "{place} raised {error} while it was imported.",
    "block.raised-while-read-and-ends": (
        "{place} raised {error} while it was imported, which ends the program. Remove that line."
    ),
    "block.raised-while-read-too-long": (
        "{place} was still running when the file was imported: {error}. If this is an endless loop, correct its "
        "condition; if it is a long computation, move it out of the file of the block."
    ),
    "toml.decimal-comma": (
        "{file} line {line}: {value} has a decimal comma. Write a decimal point: {decimal_reading}"
    ),
    "toml.decimal-commas": (
        "{file} line {line}: {value} is not valid TOML: {error}. Are these decimal commas? Write points."
    ),
    "toml.twice": "{file} line {line}: {value} is in the file twice. Keep one of the two.",
    "toml.no-quotes": (
        '{file} line {line}: {value} is not valid TOML. Text is written in quotes, key = "value"; true and '
        "false are in lower case."
    ),
    "toml.syntax": "{file} line {line}: {value} is not valid TOML: {error:word}.",
}
