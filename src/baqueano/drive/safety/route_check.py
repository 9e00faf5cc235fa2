"""A route is judged before anything moves, whoever asks for the drive: a line, Python, a page or a robot."""

from typing import TYPE_CHECKING

from baqueano.diagnostics import Diagnostic, Severity
from baqueano.errors import AnswerNo
from baqueano.guides.route import Route
from baqueano.routes import examine
from baqueano.symbolic import TraceError

if TYPE_CHECKING:
    from baqueano.routes.examine import Walls
    from baqueano.vehicle_file import VehicleFile

FASTER = ("route.speed-too-high", "route.turns-too-fast")  # the vehicle comes late
UNSURE = (*FASTER, "route.gap")  # that somebody may want all the same


def warnings_of(
    route: Route,
    vehicle_file: "VehicleFile",
    room: "Walls | None" = None,
    *,
    measured: bool = True,
    anyway: bool = False,
    backend: str = "auto",
) -> tuple[Diagnostic, ...]:
    """Return what is to be said of a route that may be driven; AnswerNo with the first reason why it may not.

    A model that nobody `measured` cannot tell that a route is too fast: it only warns. `anyway` drives a route that is
    too fast or has gaps. A jump, a wall, and a value that is not a number are always refused.
    """
    try:
        report = examine(route, vehicle_file, room, backend=backend)
    except TraceError:  # a vehicle of one's own that is not compiled: it cannot be asked for its limits
        report = examine(route, None, room)
    for finding in report.findings:
        passes = (finding.code in UNSURE and anyway) or (finding.code in FASTER and not measured)
        if finding.severity == Severity.ERROR and not passes:
            raise AnswerNo(finding)
    return report.findings
