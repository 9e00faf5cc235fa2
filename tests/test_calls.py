"""A wrong call of a public function raises one paragraph with a call that can be typed."""

import copy
import inspect
import re
from pathlib import Path

import numpy as np
import pytest

import baqueano as bq
from baqueano.calibration.at_rest import RestMeasurement
from baqueano.calibration.result import Calibration
from baqueano.contracts.result import pandas
from baqueano.drive import drive
from baqueano.errors import AnswerNo, FileError, Misuse, NoAttribute, UsageError
from baqueano.identify.noise.covariances import Noise
from baqueano.identify.result.fit_result import Fit
from baqueano.runs.importing.recordings import ImportedRun
from baqueano.runs.route_file import read_route, write_route
from baqueano.runs.run import Run
from baqueano.tune.tune_result import TuneResult
from tests.codes import includes, refused

ROBOT = bq.load("small")
ROUTE = bq.guides.shapes.circle(0.5, 0.2)
RUN = bq.simulate(ROBOT, np.tile([0.5, 0.0, 0.0], (5, 1)))
SOURCE = Path(bq.__file__).parent
ADVICE = re.compile(r"^@checked_call\(\s*(['\"])(.*?)\1[,)]", re.MULTILINE)
EXAMPLES = sorted(
    {call for path in SOURCE.rglob("*.py") for _, call in ADVICE.findall(path.read_text(encoding="utf-8"))}
)


def method_code(call) -> str:
    with pytest.raises(Misuse) as error:
        call()
    return error.value.diagnostic.code


@pytest.mark.parametrize(
    ("code", "call"),
    [
        ("call.kind", lambda: bq.repeat(ROBOT, "lab")),
        ("call.unknown", lambda: bq.tune(ROBOT, ROUTE, speed=0.2)),
        ("call.kind", lambda: bq.replay("0001.mcap")),
        ("call.kind", lambda: bq.identify(np.zeros((10, 3)), ROBOT)),
        ("call.kind", lambda: bq.tune(ROBOT, np.zeros(3))),
        ("call.kind", lambda: bq.import_run("map.toml", np.zeros((3, 3)))),
        ("call.kind", lambda: bq.import_run("map.toml", [3])),
        ("call.kind", lambda: ROBOT.with_values(["model.mass_kg", 0.7])),
        ("call.kind", lambda: RUN.cut("a", 3.0)),
        ("call.kind", lambda: bq.compare([RUN, ROBOT])),
        ("call.kind", lambda: bq.compare(RUN, ROBOT)),
        ("call.kind", lambda: bq.compare({"a": RUN, "b": 3})),
        ("call.kind", lambda: bq.compare(3)),
        ("call.kind", lambda: bq.repeat(Path("small.toml"), ROUTE)),
        ("call.kind", lambda: bq.identify(Path("1.mcap"), ROBOT)),
        ("call.kind", lambda: bq.guides.shapes.sinuous_circle([0.5], 0.1, 1, 0.2)),
        ("call.kind", lambda: bq.load(3)),
        ("call.kind", lambda: bq.experiment(ROBOT, np.zeros((2, 3)), truth="small")),
        ("call.kind", lambda: bq.experiment(ROBOT, "random_steps")),
        ("call.kind", lambda: bq.identify(RUN, ROBOT, free="model.mass_kg")),
        ("call.kind", lambda: bq.FitOptions(segment_s="3")),
        ("call.kind", lambda: bq.routes.smooth("lab")),
        ("call.kind", lambda: Fit.updated_file(None, ROBOT)),
        ("call.kind", lambda: Noise.updated_file(None, RUN)),
        ("call.kind", lambda: RestMeasurement.updated_file(None, RUN)),
        ("call.kind", lambda: Calibration.updated_file(None, RUN)),
        ("call.kind", lambda: bq.identify(RUN, ROBOT, options={"segment_s": 3.0})),
        ("call.kind", lambda: bq.import_run(3)),
        ("call.kind", lambda: bq.import_run(pandas().DataFrame({"t": [0.0]}))),
        ("call.kind", lambda: ROBOT.save(3)),
        ("call.kind", lambda: RUN.plot("path", ax=3)),
        ("call.kind", lambda: RUN.plot(3)),
        ("call.positions", lambda: TuneResult.updated_file(None, ROBOT)),
        ("call.order", lambda: bq.identify(ROBOT, RUN)),
        ("call.order", lambda: bq.repeat("lab", ROBOT)),
        ("call.missing", lambda: bq.repeat(ROBOT)),
        ("call.missing", lambda: bq.excitation("prbs", ROBOT)),
        ("call.missing", lambda: Noise.updated_file(None)),
        ("call.positions", lambda: bq.replay(RUN, ROBOT, None, "ekf")),
        ("call.option-of", lambda: bq.identify(RUN, ROBOT, segment_s=3.0)),
        ("call.unknown", lambda: bq.FitOptions(segmet_s=3.0)),
        ("call.unknown", lambda: ROBOT.with_values(mass_kg=1.0)),
        ("call.of-other-argument", lambda: bq.identify(RUN, ROBOT, bq.FitOptions())),
    ],
)
def test_a_wrong_call_is_a_message(code, call):
    assert method_code(call) == code


def test_a_method_with_too_many_arguments_is_answered_with_their_number_without_self():
    with pytest.raises(Misuse) as error:
        Noise.updated_file(None, ROBOT, "", 3)
    assert error.value.diagnostic.figures["maximum"] == 2


def test_a_text_in_place_of_an_object_is_answered_with_the_line_that_reads_it():
    with pytest.raises(Misuse) as error:
        bq.compare("runs/0001.mcap")
    assert error.value.diagnostic.fix == 'run = bq.read_run("runs/0001.mcap")'


@pytest.mark.parametrize(
    ("call", "name", "value_text"),
    [
        (lambda: bq.compare([RUN, ROBOT]), "runs[1]", "VehicleFile(…)"),
        (lambda: bq.compare([RUN, "runs/0002.mcap"]), "runs[1]", '"runs/0002.mcap"'),
        (lambda: bq.compare([RUN, Run]), "runs[1]", "class Run"),
        (lambda: bq.load(int), "source", "class int"),
        (lambda: bq.identify(RUN, ROBOT, [3]), "free[0]", "3"),
    ],
)
def test_the_wrong_item_of_a_list_is_named(call, name, value_text):
    with pytest.raises(Misuse) as error:
        call()
    figures = error.value.diagnostic.figures
    assert (figures["name"], figures["value"]) == (name, value_text)


def test_a_number_in_a_list_of_names_is_answered_with_a_text():
    with pytest.raises(Misuse) as error:
        bq.identify(RUN, ROBOT, [3])
    assert error.value.diagnostic.figures["expected"] == "a text"


def test_a_result_in_place_of_its_part_is_answered_with_the_part():
    lesson = bq.teach(ROBOT, [(0.1, (0.4, 0.0, 0.0)), (0.2, (0.4, 0.0, 0.2))])
    with pytest.raises(Misuse) as error:
        bq.repeat(ROBOT, lesson)
    assert error.value.diagnostic.fix == "bq.repeat(robot, result.route)"
    with pytest.raises(Misuse) as error:
        bq.identify(ImportedRun(RUN, ()), ROBOT)
    assert error.value.diagnostic.fix == "bq.identify(result.run, robot)"


def test_an_unknown_kind_of_a_call_does_not_name_the_vehicle_file():
    with refused("block.unknown", FileError):
        bq.replay(RUN, ROBOT, estimator="ekff")


def test_a_class_that_lacks_a_value_is_answered_with_an_object_of_it():
    class Mine:
        def __init__(self, gain):
            self.gain = gain

        def init(self):
            return None

        def step(self, state, reference, estimate):
            return state, None

    with pytest.raises(FileError) as error:
        bq.repeat(ROBOT, ROUTE, controller=Mine)
    assert error.value.diagnostic.fix == "controller=Mine(gain=1.0)"


def test_the_options_of_a_function_are_part_of_its_signature_and_of_its_errors():
    assert {"starts", "controller", "draws"} <= inspect.signature(bq.tune).parameters.keys()
    with pytest.raises(Misuse) as error:
        bq.tune(ROBOT, ROUTE, start=2)
    assert error.value.diagnostic.figures["suggestion"].figures["match"] == "starts"


def test_an_unknown_attribute_of_a_result_is_answered_with_its_methods():
    with pytest.raises(NoAttribute) as error:
        RUN.parameters  # noqa: B018
    assert error.value.diagnostic.code == "front.no-attribute"
    assert "table" in error.value.diagnostic.figures["suggestion"].figures["valid"]
    assert copy.deepcopy(RUN) == RUN
    with pytest.raises(NoAttribute) as error:
        RUN.tables  # noqa: B018
    assert error.value.diagnostic.figures["suggestion"].figures["match"] == "table"


def test_a_run_in_memory_is_saved(tmp_path):
    assert bq.read_run(RUN.save(tmp_path / "mine.mcap")) == RUN


def test_runs_are_compared_one_by_one_in_a_list_and_with_names():
    row = bq.compare(RUN, RUN).rows()[1]
    assert repr(bq.compare([RUN, RUN]).rows()[1]) == repr(row)
    assert [run.name for run in bq.compare({"a": RUN, "b": RUN}).runs] == ["a", "b"]


def test_correct_calls_are_not_changed():
    assert isinstance(bq.simulate(ROBOT, [[0.5, 0.0, 0.0]], seed=np.int64(1)), Run)
    assert list(inspect.signature(bq.repeat).parameters)[:3] == ["vehicle_file", "route", "laps"]
    assert bq.repeat.__doc__


@pytest.mark.parametrize("call", EXAMPLES)
def test_an_advised_call_matches_its_function(call):
    """The call is evaluated with a function that only binds the arguments."""
    name = call.partition("(")[0]
    function = eval(name, {"bq": bq, "drive": drive})
    values = {
        "robot": ROBOT,
        "route": ROUTE,
        "run": RUN,
        "path": ROUTE,
        "u": 1,
        "fit": 1,
        "MyController": 1,
        "blocks": 1,
    }
    signature = inspect.signature(function)
    assert eval(
        f"bind{call.removeprefix(name)}",
        {"bq": bq, "bind": signature.bind, "first": 1, "second": 1, **values},
    )


def test_every_function_of_the_front_door_checks_its_call():
    functions = [name for name in bq.__all__ if inspect.isfunction(getattr(bq, name))]
    advised_calls = {call.removeprefix("bq.").partition("(")[0] for call in EXAMPLES}
    assert set(functions) <= advised_calls


def test_an_unknown_name_of_the_package_is_answered_with_a_similar_one():
    with pytest.raises(AttributeError, match="repeat"):
        bq.repeet  # noqa: B018


def test_a_fraction_for_a_whole_number_is_answered_with_the_whole_number():
    route = bq.guides.shapes.circle(0.3, 0.2)
    with pytest.raises(Misuse) as error:
        bq.repeat(bq.load("small"), route, laps=1.6)
    assert error.value.diagnostic.fix == "bq.repeat(robot, route, laps=2)"


def test_saving_a_fit_is_answered_with_the_call_that_writes_its_vehicle_file():
    fit = Fit.__new__(Fit)
    with pytest.raises(NoAttribute) as error:
        fit.save("vehicle.toml")
    assert error.value.diagnostic.code == "front.save-file"
    assert "updated_file().save(" in error.value.diagnostic.fix


def test_a_guide_that_raises_is_named_by_teach():
    class Broken:
        def init(self):
            return None

        def step(self, state, estimate):
            raise RuntimeError("no path")

    with refused("route.stopped", AnswerNo) as error:
        bq.teach(bq.load("small"), Broken, duration_s=3.0)
    assert includes(error.value.diagnostic, "block.raised")


def test_a_missing_signal_is_answered_with_a_call_that_runs():
    with pytest.raises(Misuse) as error_info:
        bq.simulate(ROBOT)
    assert isinstance(eval(error_info.value.diagnostic.fix, {"bq": bq, "robot": ROBOT}), Run)


@pytest.mark.parametrize("name", ["circle", "eight"])
def test_the_name_of_a_shape_is_answered_with_its_route(name):
    with pytest.raises(Misuse) as error_info:
        bq.repeat(ROBOT, name)
    names = {}
    exec(error_info.value.diagnostic.fix, names)
    assert len(names["route"].t_s) > 100


def test_a_channel_without_a_limit_has_no_negative_zeros():
    u = bq.excitation("random_steps", ROBOT.command.limit, 5.0, ROBOT.rate_hz)
    assert not np.signbit(u[:, 1]).any()


@pytest.mark.parametrize(
    ("name", "answer"), [("eigth", "eight"), ("Circel", "circle"), ("xyzzy", "sinuous-circle")]
)
def test_a_misspelt_shape_is_answered_with_the_nearest_one(tmp_path, monkeypatch, name, answer):
    """Before, the answer was `shape("eigth")`, which does not exist. A name like no other is answered by an example."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises(Misuse) as error:
        bq.repeat(bq.load("small"), name)
    assert f'shape("{answer}"' in error.value.diagnostic.fix


def test_the_name_of_a_stored_route_is_answered_with_the_line_that_reads_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("routes").mkdir()
    write_route(ROUTE, Path("routes/lap.csv"))
    with refused("call.kind", Misuse) as error:
        bq.repeat(ROBOT, "lap")
    assert error.value.diagnostic.fix == 'from baqueano.runs import read_route; route = read_route("lap")'
    assert np.array_equal(read_route("lap").eta, ROUTE.eta)
    write_route(ROUTE, Path("routes/lap.v2.csv"))
    assert np.array_equal(read_route("lap.v2").eta, ROUTE.eta)


@pytest.mark.parametrize("name", ["last", "2", "0002-repeat"])
def test_a_run_of_the_folder_is_read_by_its_number_or_name(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    for stem in ("0001-experiment", "0002-repeat"):
        RUN.save(f"runs/{stem}.mcap")
    assert bq.read_run(name).path == Path("runs/0002-repeat.mcap")
    with refused("runs.unknown", FileError):
        bq.read_run("3")


@pytest.mark.parametrize("times_s", [(3.0, 2.0), (float("nan"), 3.0)])
def test_a_part_of_a_run_does_not_end_before_its_start(times_s):
    with refused("runs.cut-order", UsageError):
        RUN.cut(*times_s)
    assert len(RUN.cut(2.0, 2.0).t_ns) == 0
