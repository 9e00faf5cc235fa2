"""Command-line settings have priority over the file, and the file may name a user block."""

import copy
import pickle
import sys
import tomllib

import numpy as np
import pytest

from baqueano.errors import FileError, UsageError
from baqueano.messages.language import use_language
from baqueano.signals import Command
from baqueano.vehicle_file import load, override, parse
from docs.vehicle_file_keys import reference_table, rows
from tests.codes import refused

MINE = '''"""Mine."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from baqueano.signals import Command


@dataclass(frozen=True, slots=True, eq=False)
class Mine:
    vehicle: Any
    k_x: float = 2.0
    steps: int = 3
    flag: bool = False
    word: str = "a"
    gains: np.ndarray | None = None

    def init(self):
        return None

    def step(self, state, reference, estimate):
        return state, Command(estimate.t_ns, np.zeros(3))
'''


@pytest.fixture
def workshop(tmp_path):
    """Return a folder with a vehicle file whose controller is a user block."""
    (tmp_path / "mine.py").write_text(MINE, encoding="utf-8")
    text = load("small").text.replace('kind = "pd_feedforward"', 'kind = "mine.py:Mine"')
    (tmp_path / "my.toml").write_text(text, encoding="utf-8")
    return tmp_path


@pytest.mark.parametrize("with_tomlkit", [True, False])
def test_the_command_line_has_priority_over_the_file(with_tomlkit, monkeypatch):
    if not with_tomlkit:
        monkeypatch.setitem(sys.modules, "tomlkit", None)
    small = load("small")
    changed_file = override(
        small, ["model.mass_kg=0.7", "model.friction.linear[0]=4", "estimator.gate_sigma=5"]
    )
    assert (changed_file.vehicle.mass_kg, changed_file.vehicle.friction.linear[0]) == (0.7, 4.0)
    assert changed_file.estimator().gate_sigma == 5.0
    assert small.vehicle.mass_kg == 0.61
    assert changed_file.layers == (
        "garage: small", "--set model.mass_kg=0.7", "--set model.friction.linear[0]=4", "--set "
        "estimator.gate_sigma=5",
    )  # fmt: skip
    assert parse(changed_file.text, "again").vehicle.mass_kg == 0.7


@pytest.mark.parametrize(
    ("setting", "part"),
    [
        ("model.mass_kg", "--set model.mass_kg: expected key=value, for example --set model.mass_kg=0.7"),
        ("model.mass_kg=", "expected key=value"),
        ("model.mas_kg=1", "does not have key model.mas_kg. Did you mean model.mass_kg?"),
        (
            "model.mass_kg=-1",
            "--set model.mass_kg=-1: small.toml line 21, [model] mass_kg = -1: expected 0.001",
        ),
        ("model.mass_kg=heavy", "mass_kg = 'heavy': expected one number"),
        ("controller.kind=nothing", 'controller "nothing" does not exist'),
    ],
)
def test_an_invalid_setting_on_the_command_line_is_a_usage_error(setting, part):
    with pytest.raises(UsageError) as error_info:
        override(load("small"), [setting])
    assert part in str(error_info.value)
    assert error_info.value.exit_code == 2


LARGE = ["geometry.radius_m=0.7", "model.mass_kg=61", "model.inertia_kg_m2=15"]


@pytest.mark.parametrize(
    "settings", [LARGE, LARGE[::-1], ["controller.e_max=[0.2, 0.1, 0.3]", "controller.kind=lqr"]]
)
def test_settings_that_are_valid_only_together_are_accepted_in_any_order(settings):
    file = override(load("small"), settings)
    assert file.layers[1:] == tuple(f"--set {setting}" for setting in settings)
    with pytest.raises(UsageError):
        override(load("small"), settings[:1])


def test_the_last_of_settings_of_the_same_key_has_priority():
    file = override(load("small"), [*LARGE, "model.mass_kg=60", "model.mass_kg=62"])
    assert file.vehicle.mass_kg == 62.0


def test_a_user_block_is_loaded_from_beside_the_vehicle_file(workshop):
    file = load(workshop / "my.toml")
    controller = file.controller()
    assert (type(controller).__name__, controller.k_x, controller.vehicle) == ("Mine", 2.0, file.vehicle)


def test_fields_of_a_user_block_are_keys_of_its_table(workshop):
    file = load(workshop / "my.toml")
    text = file.text.replace(
        'kind = "mine.py:Mine"',
        'kind = "mine.py:Mine"\nk_x = 5\nsteps = 2\nflag = true\nword = "b"\ngains = [1, 2]',
    )
    controller = parse(text, "my.toml", file.path).controller()
    assert (controller.k_x, controller.steps, controller.flag, controller.word) == (5.0, 2, True, "b")
    assert isinstance(controller.gains, np.ndarray)


@pytest.mark.parametrize(
    ("line", "part"),
    [
        ("k_y = 1", "[controller] k_y is not a key of this table. Did you mean k_x?"),
        ('k_x = "a"', "k_x = 'a': expected one finite number."),
        ("k_x = nan", "k_x = nan: expected one finite number."),
        ("steps = 1.5", "steps = 1.5: expected a whole number."),
        ("flag = 1", "flag = 1: expected true or false."),
        ("word = 1", "word = 1: expected text in quotes"),
    ],
)
def test_the_table_of_a_user_block_is_checked(workshop, line, part):
    file = load(workshop / "my.toml")
    text = file.text.replace('kind = "mine.py:Mine"', f'kind = "mine.py:Mine"\n{line}')
    (workshop / "my.toml").write_text(text, encoding="utf-8")
    with pytest.raises(FileError) as error_info:
        load(workshop / "my.toml")
    assert part in str(error_info.value)


def test_a_user_block_that_replaces_a_block_accepts_its_keys_and_defaults(workshop):
    small = load("small")
    controller = small.controller(kind=f"{workshop / 'mine.py'}:Mine", k_x=7.0)
    assert (controller.k_x, controller.steps) == (7.0, 3)
    _, command = controller.step(None, None, Command(5, np.zeros(3)))
    assert command.t_ns == 5


@pytest.mark.parametrize(
    ("content", "code", "figures"),
    [
        ("class Other: pass\n", "name.unknown-only", {"valid": "Other"}),
        ("class Mnie: pass\n", "name.near-only", {"match": "Mnie"}),
        ("def broken(:\n", "block.not-python", {"file": "mine.py", "line": 1}),
        (
            "x = 1\ny = x / 0\n",
            "block.raised-while-read",
            {"place": "mine.py line 2", "error": "ZeroDivisionError: division by zero"},
        ),
        ("Mine = 3\n", "block.not-class", {"file": "mine.py", "value": "Mine", "kind": "int"}),
        ("import nothing_of_this_name\n", "block.raised-while-read", {"place": "mine.py line 1"}),
        (
            MINE.replace(
                "    k_x: float = 2.0", "    k_x: float = 2.0\n    def __post_init__(self):\n        1 / 0"
            ),
            "vehicle.not-built",
            {"block": "Mine (mine.py line 16)"},
        ),
        (
            MINE.replace(
                "    k_x: float",
                '    def __post_init__(self):\n        raise ValueError("no")\n    k_x: float',
            ),
            "vehicle.refused",
            {"block": "Mine (mine.py line 11)", "error": "no"},
        ),
    ],
)
def test_an_error_in_a_user_file_names_file_and_line(workshop, content, code, figures):
    (workshop / "mine.py").write_text(content, encoding="utf-8")
    with refused(code, FileError, **figures):
        load(workshop / "my.toml")


@pytest.mark.parametrize(
    "text", ['"""Un controlador\nmás del artículo."""\n', "# mi control\n# más rápido\nx = 1\n"]
)
def test_a_block_saved_in_the_encoding_of_an_old_editor_is_named_as_such(workshop, text):
    (workshop / "mine.py").write_bytes(text.encode("cp1252"))
    with refused("toml.not-utf-8", FileError, file="mine.py", line=2, byte=0xE1):
        load(workshop / "my.toml")


def test_a_missing_user_file_is_reported(workshop):
    (workshop / "mine.py").rename(workshop / "mien.py")
    with refused("block.file-absent", FileError):
        load(workshop / "my.toml")


def test_the_vehicle_file_of_a_run_loads_without_the_user_block_file(workshop):
    text = load(workshop / "my.toml").text
    (workshop / "mine.py").unlink()
    file = parse(text, "the vehicle file of runs/0001")
    assert file.vehicle.mass_kg == 0.61
    with refused("block.file-absent", FileError):
        file.controller()


def test_a_changed_user_file_is_read_again(workshop):
    assert load(workshop / "my.toml").controller().k_x == 2.0
    (workshop / "mine.py").write_text(MINE.replace("= 2.0", "= 9.0"), encoding="utf-8")
    assert load(workshop / "my.toml").controller().k_x == 9.0


def test_blocks_receive_rate_delay_and_limits_from_the_file():
    car = load("car")
    assert car.estimator().rate_hz == 50.0
    assert car.vehicle.drivetrain.delay_slots == 4  # 80 ms at 50 Hz
    assert car.controller().limit.tolist() == [1.0, 1.0]


def test_an_estimator_of_a_vehicle_without_an_imu_uses_its_sensors_of_velocity():
    """A robot with encoders and a camera, with and without an IMU."""
    head = load("small").text.partition("[sensors.imu]")[0]
    imu, wheels, camera = (f'[sensors.{kind}]\nkind = "{kind}"\n' for kind in ("imu", "wheels", "pose"))
    assert parse(head + wheels + camera, "robot").estimator().use == ("wheels",)
    assert parse(head + imu + wheels + camera, "robot").estimator().use == ("imu",)


@pytest.mark.parametrize("content", ["", 'kind = "battery"'])
def test_a_table_of_a_logged_battery_is_accepted_as_in_the_map_of_an_import(content):
    file = parse(f"{load('small').text}\n[sensors.battery]\n{content}\n", "robot")
    assert file.sensors._fields == load("small").sensors._fields


def test_a_key_in_the_table_of_a_battery_is_refused():
    with refused("vehicle.key-unknown", FileError):
        parse(f"{load('small').text}\n[sensors.battery]\nz = []\n", "robot")


def test_the_documentation_lists_every_key_with_its_meaning():
    key_rows = rows()
    assert [row for row in key_rows if not row["meaning"]] == []
    keys = {(row["table"], row["key"]) for row in key_rows}
    for key in [
        ("model", "mass_kg"),
        ("model.friction", "linear"),
        ("sensors.NAME", "lever_arm_m"),
        ("controller", "alpha"),
    ]:
        assert key in keys
    inertia = next(row for row in key_rows if row["key"] == "inertia_kg_m2")
    assert (inertia["unit"], inertia["range"], inertia["default"]) == (
        "kg m²",
        "1e-09 to 1e+07",
        "½ m R², from radius_m",
    )


def test_the_key_documentation_has_a_table_for_each_block():
    page = reference_table()
    assert '## `[model] kind = "planar"`\n' in page
    assert "| `mass_kg` | mass m | kg |  | 0.001 to 100000 | required |" in page
    assert page.count("## `[model.drivetrain]`\n") == 1


def test_documented_defaults_are_valid_toml():
    defaults = {(row["table"], row["kind"], row["key"]): row["default"] for row in rows()}
    assert defaults["sensors.NAME", "tags", "measures_offset"] == "`true`"
    assert defaults["robot", "", "imu_axes"] == '`["x", "y", "z"]`'
    defaults_text = [
        tomllib.loads(f"key = {default.strip('`')}") for default in defaults.values() if default[:1] == "`"
    ]
    assert len(defaults_text) > 100


def test_the_spanish_documentation_has_the_same_keys_and_no_english():
    english = rows()
    with use_language("es"):
        spanish, page = rows(), reference_table()
    assert [row["key"] for row in spanish] == [row["key"] for row in english]
    assert "| `mass_kg` | masa m | kg |  | 0,001 a 100000 | obligatorio |" in page
    pairs = list(zip(english, spanish, strict=True))
    assert [spanish for english, spanish in pairs if english["meaning"] == spanish["meaning"]] == []
    assert all(
        english["default"] == spanish["default"]
        for english, spanish in pairs
        if english["default"][:1] == "`"
    )


def test_a_missing_attribute_names_the_key_that_begins_so():
    robot = load("small")
    with refused("vehicle.attribute-is-key", AttributeError, key="model.mass_kg") as error_info:
        robot.mass  # noqa: B018
    assert eval(error_info.value.diagnostic.fix) == robot.vehicle.mass_kg
    with refused("vehicle.attribute-is-key", AttributeError, key="model.mass_kg"):
        robot.model  # noqa: B018
    with refused("front.no-attribute", AttributeError, owner="small") as error_info:
        robot.nonsense  # noqa: B018
    assert "with_values" in str(error_info.value)
    with refused("vehicle.no-change", AttributeError) as error_info:
        robot.mass_kg = 1.0
    assert eval(error_info.value.diagnostic.fix.partition(" = ")[2]).vehicle.mass_kg == 1.0
    assert copy.deepcopy(robot).name == pickle.loads(pickle.dumps(robot)).name == "small"
