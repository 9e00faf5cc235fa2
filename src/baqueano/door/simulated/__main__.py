"""`python -m baqueano.door.simulated VEHICLE`: the protocol of the door on stdin and stdout, or at a socket.

It ends with its stdin, and so with the process that started it.
"""

import argparse
import os
import signal
import socket
import sys
import threading
from pathlib import Path

from baqueano.contracts.names import STORED_ROUTES
from baqueano.door.pipes import forward_bytes
from baqueano.door.simulated.missions import StoredRoutes
from baqueano.door.simulated.pace import PacedClock
from baqueano.door.simulated.service import SimulatedService
from baqueano.door.sockets import Door
from baqueano.errors import BaqueanoError
from baqueano.messages.notation import COMMAND_LINE, use_notation
from baqueano.vehicle_file import load


def main(arguments: list[str] | None = None) -> int:
    """Run the service, and return its exit code."""
    options = _parser().parse_args(arguments)
    with use_notation(COMMAND_LINE):
        return _serve(options)


def _serve(options: argparse.Namespace) -> int:
    """Serve until the input ends; return the exit code."""
    try:
        vehicle_file = load(options.vehicle)
        truth = vehicle_file if options.truth is None else vehicle_file.simulation_truth(load(options.truth))
        pace = PacedClock(options.pace)
    except BaqueanoError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    options.runs.mkdir(parents=True, exist_ok=True)
    routes = StoredRoutes(options.routes)
    service = SimulatedService(
        vehicle_file, truth, options.runs, routes, options.seed, options.backend, pace=pace
    )
    door = Door(options.socket, service.operator, options.runs, service.handlers())
    service.broadcast, service.frames = door.broadcast, door.frames
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent ends this process by its stdin
    signal.signal(signal.SIGTERM, lambda number, frame: service.end())
    if options.socket is None:
        _serve_pipes(door, service)
    service.run()
    door.close()
    return 0


def _serve_pipes(door: Door, service: SimulatedService) -> None:
    """Join stdin and stdout to the door, and redirect the output of blocks to stderr."""
    input_stream, output_stream = sys.stdin.buffer, os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    near_end, far_end = socket.socketpair()
    door.add_client(far_end)

    def forward() -> None:
        forward_bytes(near_end, input_stream, output_stream)
        service.end()

    threading.Thread(target=forward, name="pipes", daemon=True).start()


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m baqueano.door.simulated", description=__doc__)
    parser.add_argument("vehicle", help="a vehicle file, or one of the garage")
    parser.add_argument("--truth", help="the vehicle file of the simulated body, if it is another one")
    parser.add_argument("--seed", type=int, default=0, help="of the noise of the first drive")
    parser.add_argument("--pace", type=float, default=1.0, help="simulated seconds in a second")
    parser.add_argument("--runs", type=Path, default=Path("runs"), help="the folder of the runs")
    parser.add_argument("--routes", type=Path, default=STORED_ROUTES, help="the folder of the routes")
    parser.add_argument("--backend", default="auto", help="how blocks are computed")
    parser.add_argument("--socket", type=Path, help="the socket at which it listens instead of the pipes")
    return parser


if __name__ == "__main__":
    sys.exit(main())
