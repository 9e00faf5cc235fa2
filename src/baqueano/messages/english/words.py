"""English words that are keys in the code and are shown in tables and figures: verdicts, levels, kinds, columns."""

from baqueano.messages.language import mark as N_

VERDICTS = (
    N_("USABLE"), N_("WARN"), N_("REFUSED"), N_("CANNOT TELL"), N_("STOPPED"), N_("DONE"), N_("CONSISTENT"),
    N_("INCONSISTENT"), N_("NOT REPORTED"), N_("GUESS"), N_("OK"), N_("LOCALIZED"), N_("LOST"), N_("FOUND"),
    N_("RECOVERED"), N_("UNREADABLE"), N_("DEFAULT"), N_("SET"), N_("UNBALANCED"), N_("BALANCED"),
    N_("consistent"), N_("too sure"), N_("too cautious"), N_("cannot tell"), N_("not reported"),
    N_("not definite"), N_("diverged"), N_("ok"), N_("warn"), N_("bad"), N_("unknown"),
)  # fmt: skip
LEVELS = N_("debug"), N_("info"), N_("warning"), N_("error"), N_("fatal")
RUNS = (
    N_("run"), N_("demo"), N_("drive"), N_("experiment"), N_("first drive"), N_("repeat"), N_("replay"), N_("simulate"),
    N_("teach"), N_("import"), N_("manual"), N_("forecast"),
)  # fmt: skip
SOURCES = N_("a guess"), N_("a kitchen scale"), N_("a protractor")  # of values in a vehicle file
CURVES = (
    N_("measured"), N_("model"), N_("truth"), N_("estimate"), N_("reference"), N_("requested"), N_("applied"),
    N_("sent"), N_("residual"), N_("pose"), N_("velocity"), N_("limit"), N_("at its limit"),
)  # fmt: skip
COLUMNS = (
    N_("actuator"), N_("arrived"), N_("at limit"), N_("before"), N_("bound"), N_("by"), N_("channel"), N_("code"),
    N_("combination"),
    N_("command"), N_("cost at × 0.8 [%]"), N_("at × 1.25 [%]"), N_("count"), N_("covariance"), N_("delay ms"),
    N_("duration s"), N_("error"), N_("estimate"), N_("explained"), N_("figure"), N_("first gap s"), N_("from"),
    N_("gain"), N_("gaps"), N_("high"), N_("in the file"), N_("independent samples"), N_("kind"),
    N_("largest"), N_("level"), N_("longest step s"), N_("low"), N_("name"), N_("nan rows"), N_("note"),
    N_("number"), N_("identifiable"), N_("on own runs"), N_("parameter"), N_("rate [Hz]"), N_("rate hz"), N_("refused"),
    N_("role"), N_("room"), N_("run"), N_("size"), N_("source"), N_("speed"), N_("start"), N_("text"),
    N_("time [s]"), N_("times"), N_("to"), N_("topic"), N_("truth"), N_("unit"), N_("value"), N_("verdict"), N_("what"),
    N_("poorly"), N_("yes"), N_("no"), N_("notes"), N_("duration"), N_("vehicle"),
)  # fmt: skip
SYSTEM_ERRORS = (  # texts of os.strerror, which are English in each language
    N_("No space left on device"), N_("File too large"), N_("Disk quota exceeded"), N_("Read-only file system"),
    N_("Permission denied"), N_("Operation not permitted"), N_("No such file or directory"), N_("Is a directory"),
    N_("Not a directory"), N_("File exists"), N_("Directory not empty"), N_("Too many open files"),
    N_("Input/output error"), N_("No such device"), N_("Device or resource busy"), N_("Connection refused"),
    N_("Address already in use"), N_("File name too long"),
)  # fmt: skip
TOML_ERRORS = (  # texts of tomllib, which are English in each language
    N_("invalid value"), N_("invalid statement"), N_("unterminated string"), N_("unclosed array"),
    N_("unclosed inline table"), N_("expected '=' after a key in a key/value pair"),
    N_("expected newline or end of document after a statement"), N_("invalid initial character for a key part"),
    N_("expected ']' at the end of a table declaration"), N_("invalid date or datetime"), N_("invalid hex value"),
)  # fmt: skip
GROUPS = N_("group dialout"), N_("group i2c"), N_("group gpio")
RESETS = (
    N_("power"), N_("external"), N_("brown-out"), N_("watchdog"), N_("hung"), N_("warm"), N_("cause unknown"),
)  # fmt: skip
TOPICS = N_("command applied"), N_("command requested"), N_("command sent")
