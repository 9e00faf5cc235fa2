"""English sentences about runs on a disk: reading, writing, importing, exporting."""

TEMPLATES: dict[str, str] = {
    "runs.file-there": "{path} exists already, and it is never overwritten. Type: {fix}",
    "runs.no-message": "{path} is an MCAP file without messages, so it cannot be read.",
    "runs.empty": "{path} is empty (0 bytes): the run is lost. A copy elsewhere may be complete.",
    "runs.foreign-topic": (
        "{path}: topic {topic} was not written by baqueano ({error}). Import such a file with a map: {fix}"
    ),
    "runs.unpacks-too-much": (
        "{path} {error}. It is damaged, or was made to fill the memory. If you trust it, give it "
        "decompressed: {fix}"
    ),
    "runs.too-large": "{path} has {size}; the largest run that can be read has {largest}. Cut it: {fix}",
    "runs.folder": "{path} is a folder. Give one run in it: {fix}",
    "runs.absent": "{absent_path} does not exist. To list the runs: {fix}",
    "runs.not-read": "{path} cannot be read: {error}. Check its permissions.",
    "runs.topics": "{path} has {count} topics; a run has at most {maximum}. Import it with: {fix}",
    "runs.nothing-saved": (
        "{path}: nothing could be saved. In its {size} bytes /command/applied does not have a complete tick ({error}). "
        "A copy elsewhere may be complete."
    ),
    "runs.not-ours": (
        "{path} is an MCAP file, but not a run of baqueano: topic /command/applied is missing. It contains "
        "{topics}. Import it with: {fix}"
    ),
    "runs.run-there": (
        "{path} exists already, and a run never replaces a file. Give another name, or a folder: in a folder the run "
        "receives the next number."
    ),
    "runs.ending": "{path}: the name of a run ends in .mcap, such as {name}. Other formats are written by an export.",
    "runs.no-place": "{path}: a run cannot be written there ({error}). Choose another folder.",
    "runs.metadata": ("{path}: metadata {key!r} = {value} of a run must be text; write str({value})."),
    "runs.disk-full": (
        "{path}: the disk is full and did not store more of this run ({error}). The earlier part is "
        "complete. Free some space, then type: {fix}"
    ),
    "runs.disk-full-at-start": (
        "{path}: the disk is full and stored nothing of this run ({error}). Free some space, then drive again."
    ),
    "runs.times": (
        "Run {run}: {t_ns} ns is not between 1970 and 2038. The times of a run begin at 1970 or at its "
        "own start; shift them."
    ),
    "runs.not-written": (
        "{path}: the run could not be written ({error}). Choose another place, or free space if the disk is full."
    ),
    "runs.decimal": 'decimal = {value!r}: write decimal "." or ","',
    "runs.no-trajectory": "Run {run} does not have trajectory {value!r}; it has: {trajectories}.",
    "runs.file-exists": "{path} exists already. Give another name, or remove it.",
    "runs.folder-empty": "Run {value!r} does not exist: folder {folder} does not contain runs yet. To make one: {fix}",
    "runs.folder-without-runs": "Folder {value} does not contain a run (*.mcap). To list the runs of {folder}: {fix}",
    "runs.unknown": "No run in {folder} matches {value!r}. The newest there: {valid}. To list all: {fix}",
    "runs.ambiguous": "{value!r} matches more than one run of {folder}: {valid}. Type one of these names.",
    "runs.no-match": (
        "No run in {folder} matches {value!r}. Give numbers (3-28), every second number (3-28:2), a name "
        "with *, or a folder. To list the runs: {fix}"
    ),
    "runs.no-folder": "Folder {folder} does not exist. To make runs: {fix}",
    "runs.folder-not-made": "{folder}: a folder for runs cannot be made there ({error}).",
    "import.several-runs": (
        "{map} makes {count} runs from its files, but one is expected here. In Python: import_runs(…); on "
        "the command line: {line}"
    ),
    "import.unit-of-name": (
        '{key} unit = "{value}", but its column\'s name indicates {column!r}; write unit = "{unit_name}"'
    ),
    "import.no-row": "[{key}] does not have a complete row of numbers in {table}. Are its columns right?",
    "import.span": "{first_s:.3f} s to {last_s:.3f} s",
    "import.no-command": (
        "{map}: none of the ticks of [files.{ticks}] has a command of [files.{commands}]. The times of the "
        "ticks are {ticks_span}, and the times of the commands {commands_span}. Shift one of them: shift_s "
        "= …"
    ),
    "import.clocks-differ": (
        "The times of [{key}] in {table} are {span}, and the times of the ticks are {ticks_span}: their "
        "clocks differ. Write in [files.{file}]: shift_s = …"
    ),
    "import.file-absent": (
        "{map} [files.{file}] path = {absent_path!r} does not exist in {folders}. If the recordings are elsewhere, set "
        "BAQUEANO_DATA to their folder"
    ),
    "import.where": (
        "[files.{file}] where {column}: expected a value, min, max or not. Write where = {{ {column} = "
        '3 }}, or {{ {column} = {{ min = 0.1, not = ["a", 7] }} }}: min and max are numbers; the others '
        "are one value or a list"
    ),
    "import.split-not-ticks": (
        "{map} splits [files.{file}] but not the file of its ticks. Write in [files.{ticks}] split = the column that "
        "distinguishes the runs, or split_gap_s"
    ),
    "import.split-no-value": (
        "{map}: the files with split do not share a value: {value}. Give as split a column with the same values in "
        "each file. Or write split_gap_s = … instead, which matches parts in order"
    ),
    "import.stars": (
        "{map}: the paths {paths} contain *, so their files cannot be matched. Give the files by name: "
        "NAME=PATH"
    ),
    "import.no-file-like": "{path}: no file matches this name. Is the folder right?",
    "import.no-path": "{map} [files.{file}]: the key path is missing, so give the file. Type: {fix}",
    "import.no-rows": "{table} has names of columns but no rows. Is it the right file?",
    "import.where-empty": "{table}: where = {condition} excludes all rows. Are the column and the value right?",
    "import.no-time": "{table}: none of the rows has a time in {column!r}. Is it the right column?",
    "import.file-unknown": "{map} does not have [files.{value}]; it has {valid}.",
    "import.no-bag": "{path} is not a bag, but {map} [files.{file}] names topic {topic!r}.",
    "import.before-zero": (
        "{table}: its first time is {t_s:.3f} s, before the zero of the clock. Write at the top of {map}: start_ns = "
        "{start_ns}, or the start of the recording in ns since 1970"
    ),
    "import.beyond-2038": (
        '{table}: its last time is {t_s:.3g} s, beyond 2038. Is time_unit = "{unit_name}" right?'
    ),
    "import.step": (
        '{table}: with time_unit = "{unit_name}" the usual step of {column!r} is {step_s:.3g} s, which is '
        "impossible for a vehicle's recording. Write in [files.{file}] of {map}: {remedy}"
    ),
    "import.iso8601": (
        "{table}: column {column!r} has times like {value!r}; an iso8601 time is written as "
        "2024-01-22T11:39:01.250"
    ),
    "map.empty": (
        "{path} is empty: expected a map, a TOML file that assigns the columns of a recording. To write a draft of a "
        "map, give a recording that is not empty: {fix}"
    ),
    "map.folder": "{path} is a folder. Expected a map, a TOML file that assigns the columns of a recording.",
    "map.not-read": "{path} cannot be read: {error}. A map is a TOML file in UTF-8.",
    "map.not-file": "{path} is not a file: expected the map with which {run} was imported. Type: {fix}",
    "map.other-truth": (
        "[truth] of {map} differs from the table with which {run} was imported. Import the run again, and "
        "calibrate the new run. Type: {fix}"
    ),
    "map.no-tomlkit": "Writing a map needs tomlkit, which keeps its comments. Type: {fix}",
    "map.not-toml": "{path} is not valid TOML: {error}. Correct that line.",
    "route.closed-missing": (
        "{path}: it is unclear whether the route is closed. Write as its first line # closed = true, or # closed = "
        "false"
    ),
    "route.not-number": "{path} line {line}: a route needs a number in every column.",
    "route.too-short": "{path} needs at least two different poses, and has {count}.",
    "route.encoding": "{file} is not text in UTF-8. Save it as UTF-8.",
    "route.delimiter": (
        "{file} can be read with several delimiters between its columns: {delimiters}. Use only one of them, also in "
        "its first line."
    ),
    "route.no-header": (
        "{file}: the first line contains numbers, not names ({value} …). Write a line with the names of the columns "
        "above it: {names}"
    ),
    "route.comma": (
        "{file}: {value!r} can mean {integer_reading} or {decimal_reading}. Write its numbers with a decimal point, "
        "without separators of thousands."
    ),
    "route.comma-of-number": (
        "{file} line {line}, column {column!r}: {value!r} is not a number. Write it with a decimal point."
    ),
    "route.cell": (
        "{file} line {line}, column {column!r}: {value!r} is not a number. Correct the cell, or delete the line."
    ),
    "route.no-column": (
        "{file} does not have column {column!r}. It has: {valid}. A route needs the columns {names}. Rename them in "
        "its first line."
    ),
    "route.uneven": (
        "{file} line {line} has {value} cells, but the header has {expected} ({count} such lines). Correct the line. "
        "If its numbers have decimal commas, separate the columns by semicolons."
    ),
    "route.times": "{path} line {line}: expected t_s to start at 0 and increase, got {value:g}.",
    "route.way": (
        "{path} line {line}: {ds_m:g} m from the previous row at {v_m_s:g} m/s. Expected an "
        "s_m that does not decrease, and a wait_s of 0 or more. Where s_m increases, v_m_s "
        "must not be 0."
    ),
    "bag.no-rosbags": "{file}: ROS bags need the laptop extra: {fix}",
    "bag.not-read": (
        "{file} cannot be read as a bag: {error}. If this is a truncated ROS 1 bag, type: rosbag reindex FILE"
    ),
    "bag.field-not-number": (
        "{file} {topic}: expected a number in field {field!r}, found {value}. Choose one of its parts."
    ),
    "bag.chunk": (
        "{file} has a chunk of {size} that unpacks to more than {largest}. If you trust it, write it again "
        "without compression."
    ),
    "table.utf-16": (
        '{file} looks like UTF-16 without a byte order mark. Write in its [files.…] table: encoding = "{encoding}"'
    ),
    "table.empty": "{file} is empty (0 bytes). Is it the right file?",
    "table.zip": "{file} is a zip file, perhaps a spreadsheet. Decompress it, or save it as CSV.",
    "table.zero-bytes": (
        "{file} is not a text file: it contains null bytes. Only CSV and ROS bags are imported."
    ),
    "table.zero-bytes-in-line": (
        "{file} line {line} contains null bytes, as after a loss of power. Delete the line and everything "
        "after it."
    ),
    "table.long-line": (
        "{file} line {line} has more than {maximum} characters: a line of a recording was expected. Does each "
        "row end with a new line?"
    ),
    "table.gzip": "{file} is a damaged or cut gzip file ({error}). Copy it again.",
    "table.not-read": "{file} cannot be read: {error}. Is the path right?",
    "table.encoding": '{file}: encoding = "{encoding}" is unknown. Expected utf-8, utf-16, cp1252, …',
    "table.not-encoded": (
        "{file}: byte {byte} is not {encoding}. If the file was saved by Excel, write in its [files.…] "
        'table: encoding = "cp1252"'
    ),
    "table.delimiter": (
        "{file} can be read with several delimiters between its columns: {delimiters}. Write the right one "
        'in its [files.…] table, for example: delimiter = "{expected}"'
    ),
    "table.no-data": "{file} does not contain a line with data. Is it the right file?",
    "table.columns": "{file} has {count} columns; at most {maximum} are read. Is its delimiter right?",
    "table.no-header": (
        "{file}: the first line contains numbers, not names ({value} …). Write in its [files.…] table: header = false, "
        'and call the columns "1", "2", "3" …'
    ),
    "table.two-decimals": (
        "{file} has numbers with a decimal point and numbers with a comma ({value!r}). Save it with "
        "only one of the two, without thousands separators."
    ),
    "table.comma": (
        "{file}: {value!r} can mean {integer_reading} or {decimal_reading}. If this is a decimal comma, write in its "
        '[files.…] table: decimal = ","'
    ),
    "table.column-twice": "{file} has several columns named {column!r}; give each of them a different name.",
    "runs.cut-order": "run.cut({start_s:g}, {end_s:g}): expected a start before the end, both in seconds.",
    "runs.cut-at-once": "{path} was cut after {size} bytes, so it does not contain a run.",
    "runs.ends-early": "the file ends before the first second was written",
    "runs.is-ros-1": "{path} is a ROS 1 bag. Import it with: {fix}",
    "runs.is-sqlite": "{path} is a SQLite file, perhaps a ROS 2 bag. Import it with: {fix}",
    "runs.is-hdf5": "{path} is an HDF5 or MATLAB 7.3 file. Export it there as CSV, then: {fix}",
    "runs.is-matlab": "{path} is a MATLAB file. Export it there as CSV, then: {fix}",
    "runs.is-zip": "{path} is a zip file (or a spreadsheet). Decompress it, or save it as CSV.",
    "runs.is-gzip": "{path} is compressed with gzip. If it is a CSV: {fix}",
    "runs.is-ulog": "{path} is a PX4 log. Export it as CSV, then: {fix}",
    "runs.is-bytes": "{path} is not a run, which is an MCAP file: it begins with the bytes {value}.",
    "route.ending": (
        "{path} cannot be a route: expected a name such as lab, or a file that ends in .csv. A vehicle file is "
        "given with --vehicle."
    ),
    "runs.is-toml": (
        "{path} is a TOML file, not a run. A vehicle file is given with --vehicle {path}, and a run by its number."
    ),
    "runs.is-text": (
        "{path} is not a run, which is an MCAP file: it begins with the text {value}. If it is a CSV file: {fix}"
    ),
    "import.too-short": (
        "{table} gives {rows} rows for the ticks of a run; at least {minimum} are needed. Number of parts "
        "that are too short: {parts}."
    ),
    "import.parts-differ": (
        "{map}: files with split must have the same number of parts; found {counts} where {split} = "
        "{value}. They cannot be matched. In each file, give as split a column that distinguishes the "
        "runs, or exclude the other rows with where = {{…}}"
    ),
    "import.all-with-path": (
        "{map} has the files {files}, all with the key path. State which file is which: {first}=PATH"
    ),
    "import.draft-columns": (
        "{table} lacks the columns {columns} of {first}; a draft is for files with the same columns. To "
        "draft a map for {table}: {fix}"
    ),
    "import.file-shared": (
        "{map} has the files {files}, and {option} has a path for several runs. State which file is which: "
        "{first}=PATH"
    ),
    "import.steps-back": (
        "{table}: time steps back by {step_s:.3f} s at line {line} ({count} such steps). {rows} rows are "
        "not later than the rows before them. If they may be excluded, write in [files.{file}] of {map}: "
        'backwards = "drop"'
    ),
    "import.clock-back": (
        "{table}: the clock steps back by {step_s:.3f} s at line {line} ({count} such steps), and then continues. "
        "Write in [files.{file}] of {map}: split_gap_s = 5.0, to begin a new run there. If a column distinguishes the "
        'runs, write split = this column. With backwards = "drop", {rows} rows are lost'
    ),
    "import.repeats": (
        "{table}: {count} rows repeat the time of the row before, at line {line} with other values. "
        'Write in [files.{file}] of {map} which row to keep: repeats = "first" or repeats = "last"'
    ),
    "import.coarse-time": (
        "{table}: column {column!r} has {count} different times for {rows} rows, so it is too coarse. If the rows are "
        "evenly spaced, write in [files.{file}] of {map}: rate_hz = {rate_hz:.4g}, instead of time and time_unit"
    ),
    "import.time-unit": 'time_unit = "{unit_name}"',
    "import.time": "the correct time and time_unit",
    "map.absent": (
        'Map "{value}" does not exist. {suggestion}. These maps are part of baqueano. For your own map, give a '
        ".toml file."
    ),
    "map.recording": (
        "{path} is a recording, not a map: a map is a TOML file that assigns the columns. To write a draft "
        "of a map: {fix}"
    ),
    "map.recording-or-wrong": (
        "{path} is a recording, not a map, or has an error at line {line}, column {column}. A map is a "
        "TOML file that assigns the columns. To write a draft of a map: {fix}"
    ),
    "map.unknown-key": "{map} {place}: unknown key. {suggestion}.",
    "map.missing": "{map} {place} is missing; write {expected}.",
    "map.wrong": "{map} {place} = {value}; write {expected}.",
    "bag.topic-unsaid": '{file}: topic is missing; write topic = "…" in its [files.…] table, one of: {valid}.',
    "bag.no-topic": (
        '{file} does not have topic {value!r}; write topic = "…" in its [files.…] table, one of: {valid}.'
    ),
    "bag.fields": "there are {fields}",
    "bag.values": "there are {count} values",
    "bag.no-field": "{file} {topic}: field {field!r} does not exist: at {path!r} {fields}.",
    "table.too-large": (
        "{file} has {size} and needs {memory} of memory up to line {line}; at most {maximum} are allowed. "
        "If you trust it, decompress it first: {fix}"
    ),
    "table.too-long": (
        "{file} has {size} and needs {memory} of memory up to line {line}; at most {maximum} are allowed. "
        "Split it into parts first."
    ),
    "table.no-column": (
        "{file} does not have column {column!r}. It has: {valid}. Write one of these in the map, or give another file."
    ),
    "table.column-mistyped": (
        "{file} does not have column {column!r}. Did you mean {match}? That column contains {cells}. The "
        "file has: {valid}. Write one of these in the map, or give another file."
    ),
    "table.comma-of-number": (
        "{file} line {line}, column {column!r}: {value!r} is not a number. If this is a decimal comma, "
        'write in its [files.…] table: decimal = ","'
    ),
    "table.word": (
        "{file} line {line}, column {column!r}: {value!r} is not a number. Remove units and words from the "
        'cells, or exclude the row with where = {{ {key} = {{ not = "{value}" }} }}.'
    ),
    "table.not-number": (
        "{file} line {line}, column {column!r}: {value!r} is not a number. Correct the cell, or exclude "
        'the row with where = {{ {key} = {{ not = "{value}" }} }}.'
    ),
    "table.long-cell": (
        "{file} line {line} has a cell of more than {maximum} characters. Is a quote open there? Correct that line."
    ),
    "table.not-csv": (
        "{file} line {line} is not valid CSV: {error}. Is a quote open there? Correct that line."
    ),
    "table.not-json": (
        "{file} line {line} is not an object of JSON: {error}. A log of JSON lines has one object in each line."
    ),
    "table.uneven": (
        "{file} line {line} has {value} cells, but the header has {expected} ({count} such lines). Correct "
        "the file, or give its delimiter in the [files.…] table."
    ),
    "table.commas-between-commas": (
        "{file} line {line} has {value} cells, the header has {expected} ({count} such lines). Perhaps "
        "commas separate both decimals and columns: save the file with semicolons, or give its delimiter "
        "in the [files.…] table."
    ),
}
