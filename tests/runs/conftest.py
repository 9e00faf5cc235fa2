"""A small run with all kinds of data, and small files to import."""

import shlex
from types import SimpleNamespace

import numpy as np
import pytest

from baqueano.cli import main
from baqueano.errors import FileError
from baqueano.runs import Channel, EstimateLog, Event, ReferenceLog, Run, TruthLog, import_run
from tests.codes import includes

VEHICLE = 'format = 1\nname = "pequeño"\n\n[sensors.imu]\nkind = "imu"\n'


def _make_run(N=200, n=3, seed=0, start_ns=1_700_000_000_123_456_789):
    random = np.random.default_rng(seed)
    draw = random.normal
    t_ns = start_ns + 10_000_000 * np.arange(N) + random.integers(0, 999, N)
    slow, root = t_ns[::5], draw(size=(N, 6, 6))
    innovation = draw(size=(N, 3))
    innovation[::7] = np.nan
    events = (Event(int(t_ns[3]), "warning", "supervisor", "1.2 m/s > 1.0 m/s, ñandú"),) if N > 3 else ()
    return Run(
        name="0001-test",
        path=None,
        t_ns=t_ns,
        applied_commands=draw(size=(N, n)),
        requested_commands=draw(size=(N, n)) * 1e300,
        sensors={
            "imu": Channel(t_ns - 1234, t_ns, draw(size=(N, 3))),
            "odometer": Channel(slow - 7_000_000, slow, draw(size=(len(slow), 1)) * 5e-324),
        },
        estimate=EstimateLog(
            t_ns,
            draw(size=(N, 3)),
            draw(size=(N, 3)),
            np.einsum("nij,nkj->nik", root, root),
            innovation,
            draw(size=(N, 3, 3)),
        ),
        reference=ReferenceLog(t_ns, draw(size=(N, 3)), draw(size=(N, 3)), np.zeros(N)),
        truth=TruthLog(t_ns, draw(size=(N, 3)), draw(size=(N, 3)), np.full((N, 3), np.nan)),
        events=events,
        vehicle_text=VEHICLE,
        metadata={"seed": "7", "kind": "experiment", "ñandú": "sí"},
        sent_commands=-draw(size=(N, n)),
    )


def run_line(line):
    """Run the command line of a page, which must succeed."""
    with pytest.raises(SystemExit) as exit_info:
        main(shlex.split(line)[1:])
    assert exit_info.value.code in (0, None)


def make_record(tick, **parts):
    """Return the record of a tick of the loop, which lacks all parts that are not given."""
    none = dict.fromkeys(("requested_command", "sent_command", "estimate", "reference"))
    return SimpleNamespace(tick=tick, **none | parts)


@pytest.fixture
def make_run():
    return _make_run


@pytest.fixture
def run():
    return _make_run()


DT = 0.02


def recording(N=1500, seed=3):
    """Return a car that really moves: columns of its board at 50 Hz and of a camera, consistent with each other."""
    random = np.random.default_rng(seed)
    t = DT * np.arange(N)
    slow = np.convolve(random.normal(size=N), np.ones(60) / 8, "same")
    v = 1.0 + 0.6 * np.sin(0.5 * t)
    w = 1.2 * np.sin(0.9 * t) + 0.5 * slow
    psi = np.cumsum(w) * DT
    x, y = np.cumsum(v * np.cos(psi)) * DT, np.cumsum(v * np.sin(psi)) * DT
    noise = random.normal(size=(4, N))
    board = {
        "t": t,
        "id": np.full(N, 3.0),
        "throttle": 0.4 * v,
        "steer": 0.2 * w / v,
        "ax": np.gradient(v, DT) + 0.05 * noise[0],
        "ay": v * w + 0.05 * noise[1],
        "wz": w + 0.01 * noise[2],
        "speed": v + 0.01 * noise[3],
    }
    camera = {"t": t + 0.003, "x": x, "y": y, "yaw": np.mod(psi + np.pi, 2 * np.pi) - np.pi}
    return board, camera


def write_csv(path, columns, sep=",", decimal=".", encoding="utf-8", digits=9):
    rows = zip(*columns.values(), strict=True)
    cells = [
        [c if isinstance(c, str) else format(c, f".{digits}g").replace(".", decimal) for c in row]
        for row in rows
    ]
    text = "\n".join(sep.join(row) for row in [list(columns), *cells]) + "\n"
    path.write_bytes(text.encode(encoding))
    return path


MAP = """
format = 1
start_ns = 1000000000
[files.board]
path = "board.csv"
time = "t"
time_unit = "s"
[files.camera]
path = "camera.csv"
time = "t"
time_unit = "s"
shift_s = 0.002
[ticks]
file = "board"
[command]
file = "board"
names = ["throttle", "steering"]
in_force = "from"
u = [{ column = "throttle", unit = "1" }, { column = "steer", unit = "1" }]
[sensors.imu]
file = "board"
z = [
  { column = "ax", unit = "m/s^2" },
  { column = "ay", unit = "m/s^2" },
  { column = "wz", unit = "rad/s" },
]
[sensors.odometer]
file = "board"
z = [{ column = "speed", unit = "m/s" }]
[truth]
file = "camera"
eta = [{ column = "x", unit = "m" }, { column = "y", unit = "m" }, { column = "yaw", unit = "rad" }]
"""


@pytest.fixture
def lab(tmp_path):
    return Lab(tmp_path)


class Lab:
    """A folder with a recording and its map; both can be changed."""

    def __init__(self, folder):
        self.folder, self.map = folder, MAP
        self.board, self.camera = recording()

    recording = staticmethod(recording)

    def fresh(self):
        return Lab(self.folder)

    def edit(self, old, new):
        assert old in self.map
        self.map = self.map.replace(old, new)
        return self

    def save(self, **format):
        write_csv(self.folder / "board.csv", self.board, **format)
        write_csv(self.folder / "camera.csv", self.camera)
        path = self.folder / "lab.toml"
        path.write_text(self.map, encoding="utf-8")
        return path

    def run(self, **format):
        return import_run(self.save(**format))

    def refused(self, code, **figures):
        """Return the diagnostic of the refused import; it, or one of its causes, has this code and these figures."""
        with pytest.raises(FileError) as error_info:
            self.run()
        assert "\n" not in str(error_info.value)
        assert includes(error_info.value.diagnostic, code, **figures), error_info.value.diagnostic
        return error_info.value.diagnostic

    def codes(self, **format):
        return [d.code for d in self.run(**format).findings]
