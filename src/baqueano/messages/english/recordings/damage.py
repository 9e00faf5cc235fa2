"""English sentences about damage to a recording, and about the required content of its map."""

TEMPLATES: dict[str, str] = {
    "damage.message-bytes": "messages of {bytes} bytes were expected",
    "damage.message-numbers": "{count} values were expected in '{field}'",
    "damage.text-beyond": "a text that is longer than its message",
    "damage.log-message": "a message that is not a log message ({error})",
    "damage.times": "times that do not fit into 64 bits",
    "damage.channel-size": "a channel without the number of values per message",
    "damage.memory": "contents that need more than {size} of memory",
    "damage.field": "a field of {size} bytes in a record with {remaining_bytes} bytes left",
    "damage.not-utf8": "a text that is not UTF-8",
    "damage.map-entries": "a map of more than {maximum} entries",
    "damage.end": "a wrong mark of the end of the data",
    "damage.no-checksum": "a message without a checksum",
    "damage.chunk-ends": "a chunk that ends inside a record",
    "damage.record-beyond": "a record that is longer than its chunk",
    "damage.no-times": "a message without times",
    "damage.second-end": "a second end-of-file record",
    "damage.summary-checksum": "a wrong checksum of the summary",
    "damage.attachment-checksum": "a wrong checksum of the attachment '{name}'",
    "damage.too-large": "unpacks from {size} to {memory} of memory or more; at most {maximum} are accepted",
    "damage.chunk-longer": "a chunk longer than its contents",
    "damage.chunk-unpacks": "a chunk of {unpacked_mib:.0f} MiB after decompression (64 MiB at most)",
    "damage.chunk-size": "a chunk of {bytes} bytes, whose header indicates {header_bytes}",
    "damage.chunk-checksum": "a wrong checksum of a chunk",
    "damage.chunk-not-unpacked": "a chunk that cannot be decompressed ({error})",
    "damage.chunk-other-size": "the stored size of a compressed chunk does not match its data",
    "damage.chunk-packed": "a chunk with the unknown compression '{packing}'",
    "damage.names": "the names of {topics} topics are lost",
    "damage.unexpected": "an unexpected record of kind {kind}",
    "damage.record-size": "a record with an impossible size, {size} bytes",
    "damage.zeros": "null bytes",
    "damage.unknown-kind": "a record of unknown kind {kind}",
    "damage.short-record": "a record of kind {kind} with only {size} bytes",
    "damage.data-checksum": "the checksum of all data is wrong",
    "run.disk-slow": "the disk was too slow: {records} estimates, references or poses are not in this run",
    "run.not-packed": "the shape of {topic} is wrong, so it is not in this run: {error}",
    "damage.place": "bytes {first} to {last}: {cause}",
    "run.pair": "{first}; {second}",
    "run.repeated-ticks": "{count} repeated ticks were excluded",
    "run.other-size": (
        "{topic} has {value} values, but /command/applied has {expected}: the topic was excluded"
    ),
    "run.unread-events": "events that could not be read: {count} ({cause})",
    "run.vehicle-file-lost": "the vehicle file of the run is lost",
    "run.metadata-lost": "the metadata (seed, versions) are lost: their checksum is wrong",
    "run.not-closed": (
        "{file} was not closed: {ticks} ticks, {duration_s:.2f} s, were saved. The program had not yet "
        "written the rest, at most one second, which is lost"
    ),
    "run.damaged": (
        "{file} is damaged ({places}): the part that could not be verified was excluded; {ticks} ticks are "
        "complete"
    ),
    "run.damaged-often": (
        "{file} is damaged ({places}; and {count} more places): the part that could not be verified was "
        "excluded; {ticks} ticks are complete"
    ),
    "replay.holes": "{count} ticks without measurements were inserted into gaps of the recording",
    "replay.without-sensor": "the run does not contain sensor {sensor}, so the replay does not have its data",
    "run.time-range": "{time_ns} ns is not a time between 1970 and 2038",
    "import.does-not-fit": (
        "{map} does not agree with its recording: {findings}. If the map is right, write at its "
        "top: accept = [{codes}]"
    ),
    "expect.format": "format = 1",
    "expect.in-force": (
        'in_force = "from" if the command of a row is valid from its time on; in_force = "until" if it was '
        "valid until then. The difference is one tick of delay"
    ),
    "expect.u-or-wheels": (
        "either u = [ … ], an entry per command, or wheels = [left, right]. These become u_x = (l + "
        "r)/2, u_y = 0, u_psi = (r - l)/2"
    ),
    "expect.delimiter": 'one character, such as delimiter = ";" or "\\t"',
    "expect.rate": "the number of rows per second, above 0",
    "expect.time-unit": 'time_unit = "s", one of {valid}, iso8601',
    "expect.time-rest": 'beside time: time_rest = {{ column = "nanosec", unit = "ns" }}',
    "expect.sensor-name": "a name of letters, digits and _ that is not a keyword of Python, as in [sensors.imu]",
    "expect.sample": 'sample = "measured", "hold" or "linear"',
    "expect.entry": 'an entry like {{ column = "NAME", unit = "m/s" }}',
    "expect.one-source": 'either column = "NAME", or quaternion = ["x", "y", "z", "w"], or constant = …',
    "expect.no-unit": "no unit: the heading of a quaternion is in rad",
    "expect.wraps": (
        "the counts until the counter wraps, above 0, together with derivative = true; for a 16-bit "
        "counter 65536"
    ),
    "expect.scale": 'scale = …, the value of one count in SI units, because unit = "raw"',
    "expect.radius": "radius_m only with the angle or angular rate of a wheel",
    "expect.counts": (
        "counts_per_turn = …, the counts of an encoder in one turn of the wheel. For other "
        'counts, unit = "raw" with a scale'
    ),
    "expect.no-counts": 'counts_per_turn only with unit = "counts"',
    "expect.file": 'file = "{first}", one of {valid}',
    "expect.type": "{kind}, as in the maps of baqueano",
    "expect.finite": "a number that is finite",
    "expect.lever-arm": "lever_arm_m = [forward, left], in m",
    "expect.no-mount": (
        "neither lever_arm_m nor heading_rad, because the heading is unknown. A fit can estimate "
        "the position of the mark: {arg[use]:truth} {arg[free]:+sensors.truth.lever_arm_m}"
    ),
    "run.times": "{name} of a run is a list of integer nanoseconds; found {dtype} of shape {value}.",
    "run.times-not-increasing": (
        "{name} of a run must increase: entry {entry} is {t_ns} ns, the next one {next_ns} ns. Remove repeated and "
        "backward times first."
    ),
    "run.times-decreasing": (
        "{name} of a run must not decrease: entry {entry} is {t_ns} ns, the next one {next_ns} ns. Remove backward "
        "times first."
    ),
    "run.shape": "{name} of a run has shape {value}, expected {expected}: one row per time.",
    "run.arrivals": "{channel} has {times} measurement times and {arrivals} arrival times.",
    "expect.three-names": "three names, such as u_x, u_y, u_psi",
    "expect.names": "{count} names, one per entry of u",
    "expect.one-of": "{key} = one of {valid}",
    "expect.time-of-bag": 'time = "bag" (when it was recorded) or time = "header.stamp"',
    "expect.time": 'time = "COLUMN", or rate_hz = … for a file without a column of time',
    "expect.entries": "{count} entries ({measures})",
    "expect.some-entries": "some entries",
    "expect.unit-of": 'unit = "…" ({valid})',
    "expect.unit": 'unit = "…", with "1" for no unit',
    "expect.listed-unit": "a unit, perhaps {suggestion}",
    "expect.listed-unit-of": "a unit of {measures:word}, perhaps {suggestion}: {valid}",
    "expect.files": "a table [files.NAME] per file",
    "expect.table": "a table [{key}]",
    "expect.ticks": 'a table [ticks] with file = "NAME": its times are the ticks of the run',
    "expect.measures": "a unit of {measures:word}: {valid}, or raw with a scale",
    "expect.measures-or-rolls": (
        "a unit of {measures:word}: {valid}, or raw with a scale, or add radius_m = …, the radius of the wheel"
    ),
    "expect.measures-or-rate": "a unit of {measures:word}: {valid}, or raw with a scale, or add derivative = true",
    "expect.measures-or-rate-of-rolling": (
        "a unit of {measures:word}: {valid}, or raw with a scale, or add derivative = true and radius_m = …, "
        "the radius of the wheel"
    ),
}
