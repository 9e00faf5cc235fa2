"""Define diagnostics: messages as data, with code, severity, subject, figures, and a command to type.

Programs decide only by codes and figures. The sentence for the reader is made at one place (messages/), from the
template of the code. Diagnostics are sent to the laptop and written into runs and --json.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from numbers import Integral, Real
from typing import Any


class Severity(StrEnum):
    """The severity of a message. UNKNOWN means that this machine cannot check the subject."""

    OK = "ok"
    INFO = "info"
    WARNING = "warning"
    ERROR = "error"
    UNKNOWN = "unknown"


class Verdict(StrEnum):
    """The evaluation of a result, and of the values that the result wrote into a vehicle file."""

    USABLE = "USABLE"
    WARN = "WARN"
    REFUSED = "REFUSED"
    CANNOT_TELL = "CANNOT TELL"
    STOPPED = "STOPPED"
    DONE = "DONE"  # of a result without an evaluation
    CONSISTENT = "CONSISTENT"
    INCONSISTENT = "INCONSISTENT"
    NOT_REPORTED = "NOT REPORTED"
    GUESS = "GUESS"  # of values that were not measured

    @classmethod
    def of(cls, reasons: "Iterable[Diagnostic]") -> "Verdict":
        """Return the verdict of the most severe of `reasons`; USABLE if all reasons are only information.

        >>> Verdict.of([note("gyro.unit", Severity.ERROR)])
        <Verdict.REFUSED: 'REFUSED'>
        """
        severities = {reason.severity for reason in reasons}
        verdicts = {
            Severity.ERROR: cls.REFUSED,
            Severity.WARNING: cls.WARN,
            Severity.UNKNOWN: cls.CANNOT_TELL,
        }
        return next((verdict for severity, verdict in verdicts.items() if severity in severities), cls.USABLE)


class StopReason(StrEnum):
    """Reasons for which the motors are stopped, or are not allowed to start. The first word is the subject."""

    COMMAND_NOT_FINITE = "supervisor.command-not-finite"
    ESTIMATE_NOT_FINITE = "supervisor.estimate-not-finite"
    SPEED = "supervisor.speed"
    YAW_RATE = "supervisor.yaw-rate"
    POSITION_UNCERTAIN = "supervisor.position-uncertain"
    SENSOR_SILENT = "supervisor.sensor-silent"
    OWN_REASON = "supervisor.own-reason"  # of a supervisor of the user
    BLOCK_RAISED = "block.raised"
    BLOCK_RAISED_IN_INIT = "block.raised-in-init"
    BLOCK_RETURNED = "block.returned"
    INTERRUPTED = "driver.interrupted"
    DRIVER = "driver.stopped"
    PAD_UNPLUGGED = "driver.pad-unplugged"
    TERMINAL_CLOSED = "driver.terminal-closed"
    TERMINAL_SILENT = "driver.terminal-silent"
    PROGRAM_ENDED = "driver.program-ended"
    HOLDER_SILENT = "operator.silent"
    STOPPED_BY = "operator.stopped"  # with the words of the person who stopped it
    STOPPED_ON_PAGE = "operator.stopped-on-page"
    STOPPED_FROM_LAPTOP = "operator.stopped-from-laptop"
    STOPPED_BY_COMMAND = "operator.stopped-by-command"
    UNO_LATCHED = "uno.stop-latched"
    UNO_BATTERY = "uno.battery-low"
    UNO_RESET = "uno.reset"
    UNO_DEAD_MAN = "uno.dead-man"
    UNO_DISARMED = "uno.disarmed"
    UNO_DEAF = "uno.arming-not-confirmed"
    UNO_SILENT = "uno.silent"
    UNO_UNHEARD = "uno.nothing-received"
    UNO_ABSENT = "uno.does-not-answer"
    LINE_NOISY = "uno.line-noisy"
    STANDSTILL = "computer.stood-still"
    TEMPERATURE = "computer.temperature"
    DISK_FULL = "computer.disk-full"
    TILT = "vehicle.tilt"
    STUCK = "vehicle.stuck"
    TIME_LIMIT = "guide.time-limit"
    ROOM = "vehicle.may-leave-room"
    ESTIMATE_DOUBTFUL = "estimate.doubtful"
    BATTERY = "vehicle.battery-low"
    IMU_ABSENT = "imu.absent"
    IMU_SILENT = "imu.silent"
    IMU_BUS_BLOCKED = "imu.bus-held"
    IMU_BUS_STILL_BLOCKED = "imu.bus-still-held"
    SERVICE_ENDED = "service.ended-by-process"
    MISSION_UNFINISHED = "service.mission-unfinished"
    MISSION_UNFINISHED_AT = "service.mission-unfinished-at"  # with the line of the block's file
    NOT_CHECKED = "service.not-checked"
    CHECKED_AGAIN = "service.checked-again"
    RECORDED = "recorded.stop"  # of an older run without codes, with the sentence of the run


MAX_CAUSES = 16  # maximum number of levels of diagnostics within a diagnostic


@dataclass(frozen=True, slots=True)
class Diagnostic:
    """A message as data. Names of `figures` end with their unit; a value can be another diagnostic, the cause.

    `fix` is a command to type, or empty.
    """

    code: str
    severity: Severity = Severity.ERROR
    subject: str = ""
    figures: Mapping[str, Any] = field(default_factory=dict)
    fix: str = ""

    def __hash__(self) -> int:
        return hash((self.code, self.severity, self.subject, self.fix, frozenset(self.figures.items())))

    def to_json(self) -> dict[str, object]:
        """Return the diagnostic as a dict for JSON; a value that is not finite becomes null."""
        figures = {name: _to_json(value) for name, value in self.figures.items()}
        return {
            "code": str(self.code), "severity": str(self.severity), "subject": self.subject, "figures": figures,
            "fix": self.fix,
        }  # fmt: skip

    @classmethod
    def from_json(cls, values: Any, causes: int = MAX_CAUSES) -> "Diagnostic":
        """Return the diagnostic from a dict of `to_json`: the inverse. Raise ValueError for any other value.

        Diagnostics within each other have at most `causes` levels: thousands would exhaust the stack of their reader.
        """
        if causes < 0:
            raise ValueError("too many causes within each other")
        try:
            texts = values["code"], values["subject"], values["fix"]
            figures = {
                k: cls.from_json(v, causes - 1) if isinstance(v, dict) else v
                for k, v in values["figures"].items()
            }
            are_figures_plain = all(
                isinstance(v, str | int | float | Diagnostic | None) for v in figures.values()
            )
            if not (are_figures_plain and all(isinstance(text, str) for text in (*texts, *figures))):
                raise ValueError("a figure or text of another type")
            code, subject, fix = texts
            return cls(code, Severity(values["severity"]), subject, figures, fix)
        except (KeyError, TypeError, AttributeError) as error:
            raise ValueError(f"no diagnostic ({type(error).__name__}: {error})") from error


def _to_json(value: object) -> object:
    if isinstance(value, Diagnostic):
        return value.to_json()
    return None if isinstance(value, float) and not math.isfinite(value) else value


def stop(reason: StopReason, fix: str = "", **figures: "str | float | Diagnostic | None") -> Diagnostic:
    """Return the diagnostic of a stop, an error with the code `reason`."""
    return Diagnostic(reason, Severity.ERROR, reason.partition(".")[0], figures, fix)


def note(
    code: str, severity: Severity = Severity.INFO, fix: str = "", subject: str = "", **figures: object
) -> Diagnostic:
    """Return a diagnostic. The default of `subject` is the first word of its code.

    Several names become one text, with commas. Several fractions or diagnostics become one diagnostic, so that the
    reader's language decides on their decimal sign. NumPy's numbers become Python's.

    >>> note("use.unknown", valid=["imu", "wheels"]).figures["valid"]
    'imu, wheels'
    """
    figure_values = {name: _figure(value) for name, value in figures.items()}
    return Diagnostic(code, severity, subject or code.partition(".")[0], figure_values, fix)


def fault(code: str, fix: str = "", subject: str = "", **figures: object) -> Diagnostic:
    """Return a diagnostic with the severity ERROR."""
    return note(code, Severity.ERROR, fix, subject, **figures)


def merge_diagnostics(diagnostics: Iterable[Diagnostic]) -> Diagnostic | None:
    """Return several messages as one diagnostic; None for an empty list."""
    first, *other_diagnostics = (*diagnostics, None)
    for diagnostic in other_diagnostics[:-1]:
        first = fault("messages.then", first=first, second=diagnostic)
    return first


SEVERITY_ORDER = (Severity.ERROR, Severity.WARNING, Severity.UNKNOWN, Severity.INFO, Severity.OK)


def most_severe_first(diagnostics: Iterable[Diagnostic]) -> tuple[Diagnostic, ...]:
    """Return the messages, the most severe first, in stable order.

    >>> [one.code for one in most_severe_first([note("a"), note("b", Severity.WARNING)])]
    ['b', 'a']
    """
    return tuple(sorted(diagnostics, key=lambda message: SEVERITY_ORDER.index(message.severity)))


MAX_LISTED_NAMES = 20  # largest number of known names that are listed


def _figure(value: object) -> "str | float | Diagnostic | None":
    if value is None or isinstance(value, str | bool | Diagnostic):
        return value
    if isinstance(value, Integral):
        return int(value)
    if isinstance(value, Real):
        return float(value)
    return _list_figure([*value]) if isinstance(value, Iterable) else str(value)


def _list_figure(values: list[Any]) -> "str | Diagnostic":
    """Return several values as one figure: names as a text with commas, diagnostics and fractions as a diagnostic."""
    if not any(isinstance(value, Diagnostic | float) for value in values):
        return ", ".join(map(str, values)) or "–"
    first, *other_diagnostics = (
        value if isinstance(value, Diagnostic) else note("messages.number", value=value) for value in values
    )
    for diagnostic in other_diagnostics:
        first = note("messages.list", first=first, second=diagnostic)
    return first


def nearest(name: str, valid_names: Iterable[str], cutoff: float = 0.6) -> Diagnostic:
    """Return a message with the known names, at most MAX_LISTED_NAMES, and the name most similar to `name`, if any."""
    import difflib

    names = list(valid_names)
    if not names:
        return note("name.none")
    names_of = {valid_name.casefold(): valid_name for valid_name in reversed(names)}
    close_names = [names_of[key] for key in difflib.get_close_matches(name.casefold(), names_of, 1, cutoff)]
    name_list = _figure(names if len(names) <= MAX_LISTED_NAMES else [*names[:MAX_LISTED_NAMES], "…"])
    only = "-only" if len(names) == 1 else ""
    if close_names:
        return note(f"name.near{only}", match=close_names[0], valid=name_list)
    return note(f"name.unknown{only}", valid=name_list)
