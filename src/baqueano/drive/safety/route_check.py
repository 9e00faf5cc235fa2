"""Check a route before the vehicle moves, for all requests: from the command line, Python, the page or a robot."""

from baqueano.diagnostics import Diagnostic, Severity
from baqueano.errors import AnswerNo
from baqueano.guides.route import Route
from baqueano.routes import examine
from baqueano.routes.room import Room
from baqueano.symbolic import TraceError
from baqueano.vehicle_file import VehicleFile

LIMIT_CODES = ("route.speed-too-high", "route.turns-too-fast", "route.curve-too-tight")  # limits of the model
ACCEPTABLE_CODES = (*LIMIT_CODES, "route.gap")  # findings that the user can accept


def route_warnings(
    route: Route,
    vehicle_file: VehicleFile,
    room: Room | None = None,
    *,
    measured: bool = True,
    force: bool = False,
    backend: str = "auto",
) -> tuple[Diagnostic, ...]:
    """Return the warnings about a route. Raise AnswerNo, with the first reason, if the route must not be driven.

    A model that was not `measured` cannot prove that a route is too fast: the finding is then only a warning. `force`
    allows a route that is too fast or has gaps. A jump, a wall, and a value that is not finite are always refused.
    """
    try:
        report = examine(route, vehicle_file, room, backend=backend)
    except TraceError:  # a user's vehicle that cannot be compiled: its limits are unknown
        report = examine(route, None, room)
    for finding in report.findings:
        passes = (finding.code in ACCEPTABLE_CODES and force) or (
            finding.code in LIMIT_CODES and not measured
        )
        if finding.severity == Severity.ERROR and not passes:
            raise AnswerNo(finding)
    return report.findings
