"""Run a worker: read requests on stdin, and write answers to stdout, one at a time, until stdin ends.

to the worker      {"type": "find" | "open" | "frame" | "runs" | "report" | "compare" | …, …}
                   {"type": "vehicle" | "mission" | "fetch" | "lap closure", …}       local_files.py, questions.py
                   {"type": "tune" | "route" | "lap" | "costs" | "downhill" | "write", …}       tuning.py
                   {"type": "block" | "check", …}                                     described_blocks.py
from the worker    a line {…, "bytes": n} followed by n bytes; {"refusal": diagnostic, "code": n, …}
"""

import json
import os
import sys
from collections import OrderedDict
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from baqueano.contracts.values import JsonObject
from baqueano.diagnostics import Verdict, fault, note
from baqueano.errors import AnswerNo, BaqueanoError, FileError, UsageError, error_text
from baqueano.messages import text
from baqueano.messages.language import use_language
from baqueano.messages.notation import COMMAND_LINE, use_notation
from baqueano.web.lab.drives import DriveIdentifications

if TYPE_CHECKING:
    from baqueano.door.simulated.missions import StoredRoutes
    from baqueano.runs import Run
    from baqueano.web.lab.recorded import PackedRun
    from baqueano.web.lab.tuning import TuningWorker

NICENESS = 10  # the vehicle's service and the page have priority
MAX_EXPERIMENT_S = 3600.0  # longest experiment
MAX_OPEN_RUNS = 4  # runs that stay open


class Worker:
    """The open runs, the drives that are identified, and the handlers of the requests."""

    def __init__(self) -> None:
        self._open: OrderedDict[tuple[str, int, str], PackedRun] = OrderedDict()
        self._lines: dict[tuple[str, int], JsonObject] = {}  # list entries of the last request
        self._drives = DriveIdentifications()
        self._tuning_worker: TuningWorker | None = None

    def answer(self, request: JsonObject) -> tuple[JsonObject, bytes]:
        """Return the answer to a request, and the bytes that follow it."""
        handlers: dict[str, Callable[[JsonObject], tuple[JsonObject, bytes]]] = {
            "find": self._find, "open": self._open_run, "frame": self._frame, "runs": self._runs,
            "report": self._report,
            "vehicle": _vehicle, "mission": _mission, "fetch": _fetch, "compare": _compare, "block": _block,
            "check": _block, "lap closure": _close_lap,
            **dict.fromkeys(("tune", "route", "lap", "costs", "downhill", "write"), self._tune),
            "identify": self._drives.answer, "identify run": self._drives.answer_run,
        }  # fmt: skip
        return handlers[request["type"]](request)

    def _tune(self, request: JsonObject) -> tuple[JsonObject, bytes]:
        from baqueano.web.lab.tuning import TuningWorker

        self._tuning_worker = self._tuning_worker or TuningWorker()
        tuning = self._tuning_worker
        handlers = {
            "tune": tuning.begin, "route": tuning.route, "lap": tuning.lap, "costs": tuning.costs,
            "downhill": tuning.descent, "write": tuning.write,
        }  # fmt: skip
        return handlers[request["type"]](request), b""

    def _find(self, request: JsonObject) -> tuple[JsonObject, bytes]:
        """Return the paths of the runs with these names, after reading each run."""
        from baqueano.runs.folder import find

        paths = [find(name, request["folder"]) for name in request["names"]]
        for path in paths:
            self._packed_run(path)
        return {"paths": [str(path.resolve()) for path in paths]}, b""

    def _open_run(self, request: JsonObject) -> tuple[JsonObject, bytes]:
        run = self._packed_run(Path(request["path"]), request.get("filter") or "")
        return run.description | {"fields": run.fields}, b""

    def _frame(self, request: JsonObject) -> tuple[JsonObject, bytes]:
        run = self._packed_run(Path(request["path"]), request.get("filter") or "")
        return {}, run.frame(request["number"], request["first"], request["count"])

    def _packed_run(self, path: Path, estimator: str = "") -> "PackedRun":
        """Return a run, read again if it has changed. If `estimator` is not "", the run is replayed through it."""
        from baqueano.runs import read_run
        from baqueano.vehicle_file.build import DEFAULT_KINDS
        from baqueano.web.lab.recorded import pack_run

        key = (*_version_key(path), estimator)
        if key not in self._open:
            run = read_run(path)
            self._open[key] = pack_run(
                _replay_with_estimator(run, estimator) if estimator else run, DEFAULT_KINDS
            )
        self._open.move_to_end(key)
        while len(self._open) > MAX_OPEN_RUNS:
            self._open.popitem(last=False)
        return self._open[key]

    def _runs(self, request: JsonObject) -> tuple[JsonObject, bytes]:
        """Return the list entry of each of these files; a file that cannot be read has the verdict UNREADABLE."""
        from baqueano.runs import read_run
        from baqueano.web.lab.recorded import run_entry

        lines: list[JsonObject] = []
        old_entries, self._lines = self._lines, {}
        for path in map(Path, request["paths"]):
            try:
                key = _version_key(path)
                entry = old_entries.get(key) or run_entry(read_run(path), path.stat().st_mtime)
                self._lines[key] = entry
                lines.append(entry)
            except BaqueanoError:
                lines.append(
                    {"kind": "?", "seconds": None, "when": None, "laps": None, "verdict": "UNREADABLE"}
                )
        return {"runs": lines}, b""

    def _report(self, request: JsonObject) -> tuple[JsonObject, bytes]:
        from baqueano.report import report
        from baqueano.runs import read_run

        report(read_run(Path(request["path"])), Path(request["to"]))
        return {}, b""


def _replay_with_estimator(run: "Run", estimator: str) -> "Run":
    """Return a run replayed through another estimator: a built-in one, or a class of the user's folder.
    Raise UsageError for any other kind.
    """
    from dataclasses import replace

    from baqueano.drive import replay
    from baqueano.drive.replay import recorded_vehicle_file
    from baqueano.web.lab.described_blocks import available_kinds

    vehicle_file = recorded_vehicle_file(run)
    kinds = available_kinds("estimator", vehicle_file)
    if estimator not in kinds:
        raise UsageError.of("web.no-kind", role="estimator", value=repr(estimator), valid=kinds)
    replay_run = replay(run, vehicle_file, estimator=estimator, backend="auto")
    return replace(
        replay_run, name=estimator, metadata=run.metadata | replay_run.metadata | {"kind": "replay"}
    )


def _block(request: JsonObject) -> tuple[JsonObject, bytes]:
    from baqueano.web.lab.described_blocks import block_description, check_block
    from baqueano.web.lab.tuning import requested_vehicle_file

    answer = block_description if request["type"] == "block" else check_block
    return answer(request, requested_vehicle_file(request)), b""


def _compare(request: JsonObject) -> tuple[JsonObject, bytes]:
    """Return the comparison of these runs, with sentences in the requested language."""
    from baqueano.compare import compare
    from baqueano.compare.table import table_sections
    from baqueano.runs import read_run

    comparison = compare([read_run(Path(path)) for path in request["paths"]])
    with use_language(request["language"]):
        return {
            "names": [run.name for run in comparison.runs], "sections": table_sections(comparison),
            "sentences": [list(run.sentences) for run in comparison.runs],
            "reasons": [text(reason) for reason in comparison.reasons],
        }, b""  # fmt: skip


def _vehicle(request: JsonObject) -> tuple[JsonObject, bytes]:
    """Return the description of a real vehicle, from its local file before its first drive, and the local routes."""
    from baqueano.door.frames.descriptions import vehicle_description
    from baqueano.vehicle_file import load

    return {
        "vehicle": vehicle_description(load(request["vehicle"]), "real"),
        "routes": _routes(request).rows(),
    }, b""


def _routes(request: JsonObject) -> "StoredRoutes":
    from baqueano.door.simulated.missions import StoredRoutes

    return StoredRoutes(Path(request["routes"]))


def _mission(request: JsonObject) -> tuple[JsonObject, bytes]:
    """Return a whole mission in JSON, with the texts of the vehicle file and of the blocks that it names."""
    from baqueano.drive.mission import Mission, pack
    from baqueano.simulate.excitation import excitation
    from baqueano.vehicle_file import load

    vehicle_file, order, kind = load(request["vehicle"]), request["order"], request["kind"]
    route = u = None
    if kind == "teach":
        _routes(request).path(order.get("name", ""))  # an invalid name is refused before the vehicle moves
    if kind == "repeat":
        route = _routes(request).read(order.get("route", ""))
    if kind == "experiment":
        signal = str(order.get("signal", "random_steps"))
        long_s = min(float(order.get("seconds", 60.0)), MAX_EXPERIMENT_S)
        u = excitation(signal, vehicle_file.command.limit, long_s, vehicle_file.rate_hz, 0)
    blocks = order.get("blocks", {}) if kind == "repeat" else {}
    mission = Mission(kind, u=u, route=route, laps=max(0, round(order.get("laps", 1))), blocks=blocks)
    return {"mission": pack(mission, vehicle_file).to_json()}, b""


def _fetch(request: JsonObject) -> tuple[JsonObject, bytes]:
    """Copy a run of a robot into the folder of runs, and store the route that it taught; return all routes.

    If the run is copied but its route cannot be made, `no_route` is the reason as JSON, otherwise None.
    """
    from baqueano.door.remote import connect
    from baqueano.drive.tasks import run_route
    from baqueano.runs import read_run
    from baqueano.runs.folder import release_path, reserve_path
    from baqueano.runs.route_file import write_route

    path = reserve_path(request["folder"], request["kind"])
    try:
        with connect(request["host"]) as robot:
            robot.fetch(request["run"], path)
    finally:
        release_path(path)
    routes, no_route = _routes(request), None
    if request["route"]:
        try:
            write_route(run_route(read_run(path), closed=None), routes.path(request["route"]))
        except BaqueanoError as error:
            no_route = error.diagnostic.to_json()
        except Exception as error:  # the run must be listed
            no_route = fault("web.lab-failed", error=error_text(error)).to_json()
    return {"routes": routes.rows(), "run": path.stem, "no_route": no_route}, b""


def _close_lap(request: JsonObject) -> tuple[JsonObject, bytes]:
    """Write the gyro scale of the lap `run`, which returned to its start, into the vehicle file; return a message.

    The route with the name `route`, which this lap taught, is stored again with the new scale. Raise AnswerNo for a
    run that was not driven by hand with this identified vehicle, or that has already changed the file.
    """
    from baqueano.drive import replay
    from baqueano.drive.closure import lap_closure
    from baqueano.drive.replay import recorded_vehicle_file
    from baqueano.drive.tasks import run_route
    from baqueano.runs import read_run
    from baqueano.runs.route_file import write_route
    from baqueano.vehicle_file.provenance import Provenance
    from baqueano.web.lab.tuning import requested_vehicle_file, stored_run_route

    vehicle_file, run = requested_vehicle_file(request), read_run(Path(request["run"]))
    if vehicle_file.path is None:
        raise UsageError.of("web.tune-garage", "baqueano new mylab", vehicle=vehicle_file.name)
    is_hand_drive = run.metadata.get("kind") == "teach" and stored_run_route({"path": request["run"]}) is None
    if vehicle_file.is_guess or not is_hand_drive or recorded_vehicle_file(run).name != vehicle_file.name:
        raise AnswerNo.of("web.no-lesson", run=run.name, vehicle=vehicle_file.name)
    lap_runs = [
        origin.run for path, origin in vehicle_file.provenance.items() if path.endswith(".gyro_scale")
    ]
    if run.name in lap_runs:
        raise AnswerNo.of("web.lap-used", run=run.name, file=vehicle_file.path.name)
    result = lap_closure(run, vehicle_file)
    origin, old = Provenance(run.name, verdict=Verdict.USABLE), getattr(vehicle_file.sensors, result.gyro)
    new_file = vehicle_file.with_values(result.values, dict.fromkeys(result.values, origin))
    path = _routes(request).path(request["route"]) if request["route"] else None
    is_taught = path is not None and path.is_file()
    route = run_route(replay(run, new_file), closed=True) if is_taught else None
    new_file.save()
    if path is not None and route is not None:
        write_route(route, path)
    figures = {
        "former_value": old.gyro_scale,
        "former_std": old.gyro_scale * old.gyro_scale_std,
        "std": result.std,
    }
    message = note(
        "web.lap-closed", gyro=result.gyro, file=vehicle_file.path.name, value=result.scale, **figures
    )
    return {"message": message.to_json()}, b""


def _version_key(path: Path) -> tuple[str, int]:
    try:
        return str(path), path.stat().st_mtime_ns
    except OSError as error:
        raise FileError.of("web.run-missing", path=path.name) from error


def serve(source: BinaryIO, sink: BinaryIO) -> None:
    """Read requests from `source`, and write their answers to `sink`, until the input ends."""
    worker = Worker()
    for line in source:
        request = json.loads(line)
        payload = b""
        try:
            reply, payload = worker.answer(request)
        except BaqueanoError as error:
            reply = {"refusal": error.diagnostic.to_json(), "code": error.exit_code}
        except Exception as error:  # a damaged run must not end the page
            reply = {"refusal": fault("web.lab-failed", error=error_text(error)).to_json(), "code": 1}
        reply |= {"bytes": len(payload)}
        sink.write(json.dumps(reply).encode() + b"\n" + payload)
        sink.flush()


if __name__ == "__main__":
    with suppress(AttributeError, OSError):
        os.nice(NICENESS)
    with use_notation(COMMAND_LINE):
        serve(sys.stdin.buffer, sys.stdout.buffer)
