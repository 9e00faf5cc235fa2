"""English sentences of runs on a disk: reading, writing, importing, exporting."""

TEMPLATES: dict[str, str] = {
    "runs.file-there": "{path}: there is a file already, and nothing is written over it. Type: {fix}",
    "runs.no-message": "{path}: an MCAP file without any message. There is nothing to read in it.",
    "runs.empty": ("{path} is empty (0 bytes): nothing was saved of it. A copy elsewhere may be whole."),
    "runs.foreign-topic": (
        "{path}: topic {topic} was not written by baqueano ({error}). Bring such a file in with a map: {fix}"
    ),
    "runs.unpacks-to-much": (
        "{path} {error}. It was damaged, or made to fill the memory. If you trust it, give it unpacked: {fix}"
    ),
    "runs.too-large": "{path} has {size}; a run of at most {largest} is read. Cut it: {fix}",
    "runs.folder": "{path} is a folder. Give one run in it: {fix}",
    "runs.absent": "{missing}: there is no such file. What there is: {fix}",
    "runs.not-read": "{path} cannot be read: {error}. Check its permissions.",
    "runs.topics": "{path} has {count} topics; a run has at most {most}. Bring it in with: {fix}",
    "runs.nothing-saved": (
        "{path}: nothing could be saved, not one tick of /command/applied is whole in its {size} bytes "
        "({error}). A copy elsewhere may be whole."
    ),
    "runs.not-ours": (
        "{path} is an MCAP file, but not a run of baqueano: topic /command/applied is missing, it has "
        "{held}. Bring it in with: {fix}"
    ),
    "runs.run-there": (
        "{path}: there is a file already, and runs are never written over. Give another name."
    ),
    "runs.no-place": "{path}: no run can be written there ({error}). Give a folder that can.",
    "runs.metadata": ("{path}: metadata {key!r} = {value} of a run must be text; write str({value})."),
    "runs.disk-full": (
        "{path}: the disk took no more of this run ({error}). What was written before is whole; make room, "
        "then: {fix}"
    ),
    "runs.times": (
        "run {run}: {t_ns} ns is not a time between 1970 and 2038. Times of a run count from 1970 or from "
        "its own start; shift them."
    ),
    "runs.not-written": "{path}: the run could not be written ({error}).",
    "runs.decimal": 'decimal = {found!r}: write decimal "." or ","',
    "runs.no-trajectory": "run {run} has no trajectory {found!r}; it has: {has}.",
    "runs.file-in-the-way": "{path}: there is a file already. Give another name, or remove it.",
    "runs.unknown": (
        "No run in {folder} matches {found!r}. The newest there: {known}. All that there are: {fix}"
    ),
    "runs.ambiguous": "{found!r} is more than one run of {folder}: {known}. Type one of these names.",
    "runs.none-like": (
        "No run in {folder} matches {found!r}. Give numbers as 3-28, every second of them as 3-28:2, a "
        "name with *, or a folder. To see what there is: {fix}"
    ),
    "runs.no-folder": "There is no folder {folder}. Runs are made by: {fix}",
    "runs.folder-not-made": "{folder}: no folder for runs can be made there ({error}).",
    "import.several-runs": (
        "{map} makes {count} runs of its files, and one is expected here. In Python: import_runs(…); on "
        "the command line: {fix}"
    ),
    "import.unit-of-name": (
        '{key} unit = "{found}", but the name of its column says {column!r}; write unit = "{in_unit}"'
    ),
    "import.no-row": "[{key}] has not one row with all its numbers in {table}. Are its columns right?",
    "import.no-command": (
        "{map}: no tick of [files.{ticks}] has a command of [files.{commands}]: the times of the first are "
        "{ticks_span}, of the second {commands_span}. Shift one of them: shift_s = …"
    ),
    "import.clocks-differ": (
        "[{key}] in {table} lies at {span}, the ticks at {ticks_span}: not on one clock. Write in "
        "[files.{file}]: shift_s = …"
    ),
    "import.file-absent": (
        "{map} [files.{file}] path = {missing!r}: there is no such file in {folders}. Say where the "
        "recordings are: set BAQUEANO_DATA to their folder"
    ),
    "import.where": (
        "[files.{file}] where {column}: known are a value, min, max and not. Write where = {{ {column} = 3 "
        '}}, or {{ {column} = {{ min = 0.1, not = ["a", 7] }} }}: min and max are numbers, the others one '
        "or a list"
    ),
    "import.split-not-ticks": (
        "{map} splits [files.{file}] and not the file of its ticks. Write in [files.{ticks}]: split = the "
        "column that tells the runs apart, or split_gap_s"
    ),
    "import.split-no-value": (
        "{map}: files that are split have no value in common: {found}. Write as split a column that says "
        "the same in each of them, or split_gap_s = … instead, by which parts are matched in order"
    ),
    "import.stars": (
        "{map}: paths with * are {paths}; which belong together cannot be told. Give the files by name: "
        "NAME=PATH"
    ),
    "import.no-file-like": "{path}: no file is called like that. Is the folder right?",
    "import.no-path": "{map} [files.{file}] has no path, so it is given on the command line: {fix}",
    "import.no-rows": "{table} has names of columns but no rows. Is it the right file?",
    "import.where-empty": "{table}: no row is left by where = {where}. Are column and value right?",
    "import.no-time": "{table}: no row has a time in {column!r}. Is it the right column?",
    "import.file-unknown": "{map} has no [files.{found}]; it has {known}.",
    "import.no-bag": "{path} is no bag, but {map} [files.{file}] asks for topic {topic!r}.",
    "import.before-zero": (
        "{table}: its first time is {t_s:.3f} s, before the zero of the clock. Write at the top of "
        "{map}: start_ns = {start_ns}, or the ns since 1970 at which it began"
    ),
    "import.beyond-2038": (
        '{table}: its last time is {t_s:.3g} s, beyond 2038. Is time_unit = "{in_unit}" right?'
    ),
    "import.step": (
        '{table}: with time_unit = "{in_unit}" the usual step of {column!r} is {step_s:.3g} s, which no '
        "recording of a vehicle has. Write in [files.{file}] of {map}: {cure}"
    ),
    "import.iso8601": (
        "{table}: column {column!r} has times like {found!r}; iso8601 is 2024-01-22T11:39:01.250"
    ),
    "map.not-read": "{path} cannot be read: {error}. A map is a TOML file in UTF-8.",
    "map.not-file": "{path} is not a file: expected the map by which {run} was imported. Type: {fix}",
    "map.other-truth": (
        "[truth] of {map} is not the one by which {run} was imported: import the run again, and calibrate "
        "that. Type: {fix}"
    ),
    "map.no-tomlkit": "Writing a map needs tomlkit, which keeps its comments. Type: {fix}",
    "map.not-toml": "{path} is no TOML: {error}. Correct that line.",
    "route.closed-unsaid": (
        "{path} does not say whether the route ends where it begins: write as its first line # closed = "
        "true, or # closed = false"
    ),
    "route.not-number": "{path} line {line}: a route needs a number in every column.",
    "route.too-short": "{path} has {count} rows; a route needs at least two.",
    "route.times": "{path} line {line}: t_s must begin at 0 and increase, found {found:g}.",
    "bag.no-rosbags": "{file}: ROS bags need the laptop extra: {fix}",
    "bag.not-read": "{file} is no bag that can be read: {error}. A cut ROS 1 bag: rosbag reindex FILE",
    "bag.field-not-number": (
        "{file} {topic}: field {field!r} is no number but {found}; go on to one of its parts."
    ),
    "bag.chunk": (
        "{file} has a chunk of {size} that unpacks to more than {largest}. If you trust it, write it anew "
        "without compression."
    ),
    "table.utf-16": (
        "{file} looks like UTF-16 without a mark that says so. Write in its [files.…] table: encoding = "
        '"{encoding}"'
    ),
    "table.empty": "{file} is empty (0 bytes). Is it the right file?",
    "table.zip": "{file} is a zip file, perhaps a spreadsheet. Unpack it, or save it as CSV.",
    "table.zero-bytes": ("{file} is not a text file: it has zero bytes. Only CSV and ROS bags are imported."),
    "table.zero-bytes-in-line": (
        "{file} line {line} has zero bytes, as a loss of power leaves them: a line of text was expected. "
        "Delete the line and what follows it."
    ),
    "table.long-line": (
        "{file} line {line} has more than {most} characters: a line of a recording was expected. Does each "
        "row end with a new line?"
    ),
    "table.gzip": "{file} is a damaged or cut gzip file ({error}). Copy it again.",
    "table.not-read": "{file} cannot be read: {error}. Is the path right?",
    "table.encoding": '{file}: encoding = "{encoding}" is not known. Known are utf-8, utf-16, cp1252, …',
    "table.not-encoded": (
        "{file}: byte {byte} is not {encoding}. If the file was saved by Excel, write in its [files.…] "
        'table: encoding = "cp1252"'
    ),
    "table.delimiter": (
        "{file} can be read with {delimiters} between its columns. Write in its [files.…] table which it "
        'is, for example: delimiter = "{wanted}"'
    ),
    "table.no-data": "{file} has no line with data in it. Is it the right file?",
    "table.columns": "{file} has {count} columns; at most {most} are read. Is its delimiter right?",
    "table.no-header": (
        "{file}: the first line has no names, only numbers ({found} …). Write in its [files.…] table: "
        'header = false, and call the columns "1", "2", "3" …'
    ),
    "table.two-decimals": (
        "{file} has numbers with a decimal point and numbers with a comma ({found!r}). Save it with one "
        "kind, without separators of thousands."
    ),
    "table.comma": (
        "{file}: {found!r} may be {without} or {with_point}. If the comma is a decimal one, write in its "
        '[files.…] table: decimal = ","'
    ),
    "table.column-twice": "{file} has several columns named {column!r}; give each its own name.",
    "runs.cut-at-once": "{path} was cut after {size} bytes: nothing was saved of it.",
    "runs.ends-early": "the file ends before the first second was written",
    "runs.is-ros-1": "{path} is a ROS 1 bag. Bring it in with: {fix}",
    "runs.is-sqlite": "{path} is a SQLite file, perhaps a ROS 2 bag. Bring it in with: {fix}",
    "runs.is-hdf5": "{path} is an HDF5 or MATLAB 7.3 file. Export it there as CSV, then: {fix}",
    "runs.is-matlab": "{path} is a MATLAB file. Export it there as CSV, then: {fix}",
    "runs.is-zip": "{path} is a zip file (or a spreadsheet). Unpack it, or save it as CSV.",
    "runs.is-gzip": "{path} is packed with gzip. If it is a CSV: {fix}",
    "runs.is-ulog": "{path} is a PX4 log. Export it as CSV, then: {fix}",
    "runs.is-bytes": "{path} is not a run: it begins with {found}, a run begins with {expected}.",
    "runs.is-text": (
        "{path} is not a run: it begins with {found}, a run begins with {expected}. If it is a CSV: {fix}"
    ),
    "import.too-short": (
        "{table} leaves {rows} rows for the ticks of a run, at least {least} are needed. Parts as short as this: "
        "{parts}."
    ),
    "import.parts-differ": (
        "{map}: files that are split have as many parts as one another; found {found} where {split} = {value}. Which "
        "belong together cannot be told. Write in each as split a column that tells the runs apart, or leave the rows "
        "of the others out with where = {{…}}"
    ),
    "import.all-with-path": (
        "{map} has the files {files}, all with a path. Say which is which: {first}=PATH"
    ),
    "import.file-shared": (
        "{map} has the files {files}, and {shared} with a path for several runs. Say which is which: {first}=PATH"
    ),
    "import.steps-back": (
        "{table}: time steps back by {back_s:.3f} s at line {line} ({count} such steps). If {lost} rows that are not "
        'later than before may be left out, write in [files.{file}] of {map}: backwards = "drop"'
    ),
    "import.steps-back-often": (
        "{table}: time steps back by {back_s:.3f} s at line {line} ({count} such steps). If several runs are in it, "
        "write in [files.{file}] of {map} split = the column that tells them apart, or split_gap_s = 5.0. If {lost} "
        'rows that are not later than before may be left out, write there: backwards = "drop"'
    ),
    "import.repeats": (
        "{table}: {count} rows repeat the time of the row before, at line {line} with other values. Write in "
        '[files.{file}] of {map} which row counts: repeats = "first" or repeats = "last"'
    ),
    "import.time-unit": 'time_unit = "{in_unit}"',
    "import.time": "the right time and time_unit",
    "map.absent": 'There is no map "{found}". {near}. These come with baqueano; else give the path of a .toml file.',
    "map.recording": (
        "{path} is a recording, not a map: a map is a TOML file that says which column is what. baqueano runs import "
        "--help shows one; write it, then type: {fix}"
    ),
    "map.recording-or-wrong": (
        "{path} is a recording, not a map, or wrong at line {line}, column {column}: a map is a TOML file that says "
        "which column is what. baqueano runs import --help shows one; write it, then type: {fix}"
    ),
    "map.unknown-key": "{map} {place}: unknown key. {near}.",
    "map.missing": "{map} {place} is missing; write {expected}.",
    "map.wrong": "{map} {place} = {found}; write {expected}.",
    "bag.topic-unsaid": '{file}: topic is missing; write topic = "…" in its [files.…] table, one of: {known}.',
    "bag.no-topic": (
        '{file} has no topic {found!r}; write topic = "…" in its [files.…] table, one of: {known}.'
    ),
    "bag.fields": "there are {fields}",
    "bag.values": "it holds {count} values",
    "bag.no-field": "{file} {topic}: no field {field!r}: at {at!r} {has}.",
    "table.too-large": (
        "{file} has {size} and takes {taken} of memory up to line {line}; at most {most} are taken for it. If you "
        "trust it, unpack it first: {fix}"
    ),
    "table.too-long": (
        "{file} has {size} and takes {taken} of memory up to line {line}; at most {most} are taken for it. Cut it "
        "into pieces first."
    ),
    "table.no-column": (
        "{file} has no column {column!r}. It has: {known}. Write one of these in the map, or give another file."
    ),
    "table.column-mistyped": (
        "{file} has no column {column!r}. Did you mean {meant}? In it is {cells}. It has: {known}. Write one of these "
        "in the map, or give another file."
    ),
    "table.comma-of-number": (
        "{file} line {line}, column {column!r}: {found!r} is not a number. If the comma is a decimal one, write in its "
        '[files.…] table: decimal = ","'
    ),
    "table.word": (
        "{file} line {line}, column {column!r}: {found!r} is not a number. Take units and words out of the cells, or "
        'leave the row out with where = {{ {key} = {{ not = "{found}" }} }}.'
    ),
    "table.not-number": (
        "{file} line {line}, column {column!r}: {found!r} is not a number. Correct the cell, or leave the row out with "
        'where = {{ {key} = {{ not = "{found}" }} }}.'
    ),
    "table.long-cell": (
        "{file} line {line} has a cell of more than {most} characters. Is a quote open there? Correct that line."
    ),
    "table.not-csv": "{file} line {line} is no CSV: {error}. Is a quote open there? Correct that line.",
    "table.uneven": (
        "{file} line {line} has {found} cells, the header has {expected} ({count} such lines). Correct the file, or "
        "give its delimiter in the [files.…] table."
    ),
    "table.commas-between-commas": (
        "{file} line {line} has {found} cells, the header has {expected} ({count} such lines). Perhaps decimal commas "
        "stand between commas: save it with semicolons, or give its delimiter in the [files.…] table."
    ),
}
