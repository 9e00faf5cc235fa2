"""Read the faults back from the events of a run."""

from collections.abc import Iterable
from dataclasses import replace

from baqueano.diagnostics import Diagnostic
from baqueano.worlds.faults.fault import SOURCE, Fault


def find_faults(events: Iterable[tuple[int, str, Diagnostic | None]]) -> list[Fault]:
    """Return the faults in the events of a run, in order; an event is (time [ns], source, message).

    If a person ended a fault, its duration lasts until that time.
    """
    fault_by_number: dict[int, Fault] = {}
    for _, source, message in events:
        if source != SOURCE or message is None:
            continue
        number = int(message.figures["number"])
        if message.code == "shake.end":
            fault_by_number[number] = replace(
                fault_by_number[number], duration_s=float(message.figures["duration_s"])
            )
        else:
            fault_by_number[number] = Fault.from_diagnostic(message)
    return list(fault_by_number.values())
