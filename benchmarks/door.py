"""Measure the door (the vehicle's socket) under load: delays of a stop and of a message, and the service's memory.

The service of a simulated vehicle drives at 100 Hz in a separate process. The flooding guests run in a second process:
they send `runs` continuously, and read the answers. All processes use the same clock. The times with and without guests
are measured in turn, so that other work of the machine slows both. A stop waits for the next tick, up to 10 ms, before
it becomes a zero command. Between two messages through the door, a control thread of the service only wakes up and
writes: what it loses beyond MOST_WAKE_MS, the machine takes from every thread.
"""

import json
import os
import selectors
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import numpy as np

from benchmarks.harness import Bench, LeftOut, Row
from benchmarks.processes import before_others, forget_most, quantile, resident_mb, spread

FLOODING, MANY = 5, 12  # guests
MOST_STOP_MS, MAX_MESSAGE_MS, MOST_WAKE_MS, MOST_MB = 50.0, 5.0, 1.0, 20.0
RUNS = 300  # in the folder: the answer to `runs` is long
STARTS_S = 120.0
EVERY = 2  # ticks between two messages of the loop with the time


def benches(smallest: bool) -> list[Bench | LeftOut]:
    """Return the delays of a stop and of a message, with and without guests, and the memory of the service."""
    if not hasattr(socket, "AF_UNIX"):
        return [LeftOut("the door", "it is a socket of Unix")]
    with before_others() as share, serve_vehicle(2 if smallest else RUNS) as (service, guest, door):
        stops = _stops(guest, door, 1 if smallest else 20, share)
        return [*stops, _memory(service, guest, door, 0.5 if smallest else 10.0)]


@contextmanager
def serve_vehicle(runs: int = RUNS) -> Iterator[tuple[int, "Teacher", Path]]:
    """Yield the process id of a service with this number of runs, a client, and the path of the socket."""
    with ExitStack() as open_things:
        folder = Path(open_things.enter_context(tempfile.TemporaryDirectory(ignore_cleanup_errors=True)))
        for k in range(runs):
            (folder / f"{k:04d}-experiment.mcap").touch()
        service, door = open_things.enter_context(_child("serve", folder))
        yield service, open_things.enter_context(Teacher(door)), door


class Times(NamedTuple):
    """Times [ms] of one service: from STOP to a zero command, and the delays of the loop's messages.

    The delays of messages are in one list per round of half a second, `control` are those of the control thread in the
    quiet rounds.
    """

    idle: list[float]
    flood_stops: list[float]
    messages: list[list[float]]
    messages_flooded: list[list[float]]
    control: list[list[float]]

    def late_ms(self) -> list[float]:
        """Return the 95 % quantile of the delays of each quiet round, minus the delay of the machine itself."""
        return [
            quantile(delays, 0.95) - max(0.0, quantile(control, 0.95) - MOST_WAKE_MS)
            for delays, control in zip(self.messages, self.control, strict=True)
        ]


def in_turn(guest: "Teacher", door: Path, rounds: int) -> Times:
    """Begin and stop drives, in turn without guests and with FLOODING guests; return the times."""
    times = Times([], [], [], [], [])
    for _ in range(rounds):
        guest.begin()
        guest.control_ms.clear()
        times.messages.append(guest.message_delays_ms(0.5))
        times.control.append(list(guest.control_ms))
        times.idle.append(guest.stop())
        guest.begin()
        with flood(door, FLOODING):
            times.messages_flooded.append(guest.message_delays_ms(0.5))
            times.flood_stops.append(guest.stop())
    return times


def _stops(guest: "Teacher", door: Path, rounds: int, share: str) -> list[Bench | LeftOut]:
    times = in_turn(guest, door, rounds)
    times_ms, flooded_ms, control_ms = [
        [x for delays in rows for x in delays]
        for rows in (times.messages, times.messages_flooded, times.control)
    ]
    worst_ms, late_ms = quantile(times.flood_stops, 0.95), median(times.late_ms())
    first = f"{'with' if guest.first else 'without'} SCHED_FIFO, {share}"
    stops = (
        Row("nobody else is there", 1e-3 * median(times.idle), 1.0,
            note=f"p95 {quantile(times.idle, 0.95):.1f} ms, {first}"),
        Row(
            f"{FLOODING} guests flood", 1e-3 * median(times.flood_stops),
            median(times.flood_stops) / median(times.idle),
            is_missed=worst_ms > MOST_STOP_MS,
            note=f"p95 {worst_ms:.1f} ms (at most {MOST_STOP_MS:g}) of {rounds}; {spread(times.flood_stops)}",
        ),
    )  # fmt: skip
    tellings = (
        Row("nobody else is there", 1e-3 * median(times_ms), 1.0, is_missed=late_ms > MAX_MESSAGE_MS,
            note=f"p95 {quantile(times_ms, 0.95):.2f} ms, {late_ms:.2f} in pairs (at most {MAX_MESSAGE_MS:g})"),
        Row("a thread that only wakes up and writes", 1e-3 * median(control_ms), median(control_ms) / median(times_ms),
            note=f"p95 {quantile(control_ms, 0.95):.2f} ms of {len(control_ms)}"),
        Row(f"{FLOODING} guests flood", 1e-3 * median(flooded_ms), median(flooded_ms) / median(times_ms),
            note=f"p95 {quantile(flooded_ms, 0.95):.2f} ms of {len(flooded_ms)}"),
    )  # fmt: skip
    names = "from a STOP to the zero command", "from the loop's word to who listens"
    return [Bench(name, rows) for name, rows in zip(names, (stops, tellings), strict=True)]


def _memory(service: int, guest: "Teacher", door: Path, seconds: float) -> Bench:
    before, growth_mb = grown_mb(service, guest, door, seconds)
    note = f"{growth_mb:+.1f} MB to {before:.0f} MB (at most {MOST_MB:g})"
    return Bench(
        f"memory of the service while {MANY} guests ask for `runs`, half of whom read nothing",
        (Row(f"{seconds:g} s of it", seconds, 1.0, is_missed=growth_mb > MOST_MB, note=note),),
    )


def grown_mb(service: int, guest: "Teacher", door: Path, seconds: float) -> tuple[float, float]:
    """Return the memory [MB] of the service before MANY guests request the runs, and its largest growth [MB]."""
    guest.begin()
    before = resident_mb(service)
    forget_most(service)
    with flood(door, MANY):
        guest.message_delays_ms(seconds)
    guest.stop()
    return before, resident_mb(service, peak=True) - before


class Teacher:
    """A client that begins a drive, receives its messages, and stops it."""

    def __init__(self, door: Path) -> None:
        from baqueano.drive.mission import Mission, pack
        from baqueano.vehicle_file import load

        self._door = door
        self._mission = pack(
            Mission("experiment", u=np.tile([0.5, 0.0, 0.1], (2000, 1))), load("small")
        ).to_json()
        self._line, self._control = socket.socket(socket.AF_UNIX), socket.socket(socket.AF_UNIX)
        self.control_ms: list[float] = []  # delays [ms] of the control thread
        self.first = False  # True if the loop of the service runs under SCHED_FIFO

    def __enter__(self) -> "Teacher":
        self._line.connect(str(self._door))
        self._line.settimeout(STARTS_S)
        self._file = self._line.makefile("rb")
        self._control.connect(str(self._door.with_name("control")))
        threading.Thread(target=self._read_control, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()
        self._line.close()
        self._control.shutdown(socket.SHUT_RDWR)

    def _read_control(self) -> None:
        with self._control, self._control.makefile("rb") as lines:
            for line in lines:
                self.control_ms.append(1e-6 * (time.monotonic_ns() - int(line)))

    def begin(self) -> None:
        """Begin a drive, and wait until it has begun."""
        from baqueano.door import VERSION

        self._say(type="clear")
        self._hear("state", lambda word: word["state"] == "READY")
        self._say(type="mission", door=VERSION, mission=self._mission, attended=False)
        self._hear("tick")

    def message_delays_ms(self, seconds: float) -> list[float]:
        """Return the delay [ms] of each message of the loop in the next `seconds`."""
        begun_ns, times_ms = time.monotonic_ns(), []
        while time.monotonic_ns() < begun_ns + 1e9 * seconds:
            word = self._hear("tick")
            self.first = word["first"]
            if word["t_ns"] > begun_ns:  # earlier ones have waited in the buffer
                times_ms.append(1e-6 * (time.monotonic_ns() - word["t_ns"]))
        return times_ms

    def stop(self) -> float:
        """Return the time [ms] from a STOP to the first zero command."""
        begun_ns = time.monotonic_ns()
        self._say(type="stop", why="it nears the stairs")
        zero = self._hear("zero")
        self._hear("done")
        return 1e-6 * (zero["t_ns"] - begun_ns)

    def _say(self, **words: object) -> None:
        self._line.sendall(json.dumps(words).encode() + b"\n")

    def _hear(self, kind: str, condition: Any = lambda word: True) -> dict[str, Any]:
        for line in self._file:
            word = json.loads(line)
            if word["type"] == "no":
                raise RuntimeError(word["why"])
            if word["type"] == kind and condition(word):
                return word
        raise EOFError


def serve(folder: str) -> None:
    """Run a service; its loop sends the time of each tick, and of the first zero command after others."""
    from baqueano.door.simulated.missions import StoredRoutes
    from baqueano.door.simulated.service import SimulatedService
    from baqueano.door.sockets import Door
    from baqueano.robot.service.realtime import request_realtime
    from baqueano.vehicle_file import load
    from baqueano.worlds import FaultyWorld

    place, file = Path(folder), load("small")
    service = SimulatedService(file, file, place, StoredRoutes(place))
    door = Door(place / "door", service.operator, place, service.handlers())
    service.broadcast, service.frames = door.broadcast, door.frames
    bell, ear = socket.socketpair()
    listener = socket.socket(socket.AF_UNIX)
    listener.bind(str(place / "control"))
    listener.listen(1)
    threading.Thread(target=_wake_and_write, args=(listener, ear), daemon=True).start()
    request_realtime()
    first, write, moves, ticks = bool(os.sched_getscheduler(0) & os.SCHED_FIFO), FaultyWorld.write, False, 0

    def write_with_stamp(self: Any, command: Any) -> None:
        nonlocal moves, ticks
        write(self, command)
        zero, ticks = not np.any(command.u), ticks + 1
        if (zero and moves) or ticks % EVERY == 0:
            door.broadcast(
                {"type": "zero" if zero and moves else "tick", "t_ns": time.monotonic_ns(), "first": first}
            )
        else:
            bell.send(f"{time.monotonic_ns()}\n".encode())
        moves = not zero

    FaultyWorld.write = write_with_stamp
    signal.signal(signal.SIGTERM, lambda number, frame: service.end())
    service.run()
    door.close()


def _wake_and_write(listener: socket.socket, ear: socket.socket) -> None:
    line = listener.accept()[0]
    while stamp := ear.recv(64):
        line.sendall(stamp)


def flooding(door: str, number: str) -> None:
    """Send `runs` continuously from `number` guests; above FLOODING guests, every second guest does not read."""
    words, look = b'{"type": "runs"}\n' * 1000, selectors.DefaultSelector()
    for k in range(int(number)):
        _connect_guest(look, door, reads=int(number) <= FLOODING or k % 2 == 0)
    print("they are here", flush=True)
    while True:
        for key, events in look.select():
            line, reads = key.fileobj, key.data
            try:
                if events & selectors.EVENT_READ and reads:
                    line.recv(1 << 20)  # pyright: ignore[reportAttributeAccessIssue]
                if events & selectors.EVENT_WRITE:
                    line.send(words)  # pyright: ignore[reportAttributeAccessIssue]
            except BlockingIOError:
                continue
            except OSError:  # it did not read, and was disconnected
                look.unregister(line)
                line.close()  # pyright: ignore[reportAttributeAccessIssue]
                _connect_guest(look, door, reads)


def _connect_guest(look: selectors.BaseSelector, door: str, reads: bool) -> None:
    line = socket.socket(socket.AF_UNIX)
    line.connect(door)
    line.setblocking(False)
    look.register(line, selectors.EVENT_WRITE | (selectors.EVENT_READ if reads else 0), reads)


@contextmanager
def flood(door: Path, number: int) -> Iterator[None]:
    """Run `number` guests that flood the socket, in a separate process, within the context."""
    with _program("flooding", str(door), str(number)) as program:
        assert program.stdout is not None
        program.stdout.readline()
        yield


@contextmanager
def _child(role: str, folder: Path) -> Iterator[tuple[int, Path]]:
    door, end = folder / "door", time.monotonic() + STARTS_S
    with _program(role, str(folder)) as program:
        while not door.exists():
            assert program.poll() is None, "the service did not start"
            assert time.monotonic() < end, "the service did not start"
            time.sleep(0.05)
        yield program.pid, door


@contextmanager
def _program(role: str, *words: str) -> Iterator["subprocess.Popen[bytes]"]:
    code = f"import sys; from benchmarks.door import {role}; {role}(*sys.argv[1:])"
    with subprocess.Popen([sys.executable, "-c", code, *words], stdout=subprocess.PIPE) as program:
        try:
            yield program
        finally:
            program.terminate()
            with suppress(subprocess.TimeoutExpired):
                program.wait(STARTS_S)
