"""Read a vehicle file, check all of it, and build its blocks."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Any

from baqueano.blocks import check_role, permit_blocks, resolve_named
from baqueano.contracts.blocks import OwnBlock
from baqueano.contracts.calls import checked_call
from baqueano.contracts.result import Result, shorten
from baqueano.contracts.values import JsonObject, TableRow, Tree
from baqueano.diagnostics import Diagnostic, note
from baqueano.errors import FileError, UsageError
from baqueano.estimators import AugmentedEkf
from baqueano.messages import text
from baqueano.sensors.imu_filter import low_pass_hz
from baqueano.signals import ByName
from baqueano.vehicle_file import build, garage
from baqueano.vehicle_file.build import BuildContext
from baqueano.vehicle_file.envelope import Envelope, read_envelope
from baqueano.vehicle_file.head import (
    TABLE_NAMES,
    TOP_LEVEL_KEYS,
    CommandSpec,
    Geometry,
    Hardware,
    Simulation,
    read_command,
    read_head,
    read_top,
)  # fmt: skip
from baqueano.vehicle_file.paths import current_value, raise_missing_attribute, refuse_change
from baqueano.vehicle_file.plausibility import check_values
from baqueano.vehicle_file.provenance import ParameterCov, Provenance, is_measured, model_values, read_history
from baqueano.vehicle_file.tables import ReadReport, report_unknown_key
from baqueano.vehicle_file.text.toml_text import read_text, tables, with_present_keys

if TYPE_CHECKING:
    from baqueano.guides.route import Route

LOOP_ROLES = ("estimator", "guide", "controller", "supervisor")


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class VehicleFile:
    """A vehicle as its file describes it. It is immutable: `with_values` and `override` return a new object.

    Its blocks are built on demand. They raise FileError if a value is missing; it names the command that finds it.

    Attributes
    ----------
    name : str
        Name of the vehicle.
    path : Path or None
        Path of the file; None for a vehicle of the garage or from a run.
    text : str
        Text of the whole file, including changes.
    data : dict
        Tables of the file.
    command : CommandSpec
        Names, unit and limits of the command.
    rate_hz : float
        Ticks per second.
    geometry : Geometry
        Dimensions of the body.
    vehicle : Vehicle
        The block of [model].
    sensors : NamedTuple of Sensor
        The blocks of [sensors], by name.
    provenance : dict of Provenance
        Run, date and standard deviation by dotted key.
    parameter_cov : ParameterCov or None
        Covariance of the last fit.
    envelope : Envelope or None
        The motion in the runs of the last fit.
    notes : tuple of Diagnostic
        Remarks about values that do not prevent the use of the file.
    layers : tuple of str
        Sources of the values, lowest first.
    label : str
        Name of the file in messages.
    robot : Hardware
        The table [robot].
    simulation : Simulation
        The table [simulation].
    on_disk : str or None
        Text of the file at `path` when it was read.

    Examples
    --------
    >>> load("small").with_values({"model.mass_kg": 0.7}).vehicle.mass_kg
    0.7
    """

    name: str
    path: Path | None
    text: str
    data: JsonObject = field(repr=False)
    command: CommandSpec
    rate_hz: float
    geometry: Geometry
    vehicle: Tree
    sensors: ByName[Tree]
    provenance: dict[str, Provenance]
    parameter_cov: ParameterCov | None
    envelope: Envelope | None
    notes: tuple[Diagnostic, ...]
    layers: tuple[str, ...]
    label: str
    robot: Hardware
    simulation: Simulation = field(default=Simulation(), repr=False)
    on_disk: str | None = field(default=None, repr=False)

    def __repr__(self) -> str:
        figures = {
            "vehicle": self.name, "layers": self.layers, "model": type(self.vehicle).__name__, "rate_hz": self.rate_hz,
            "commands": self.command.names, "unit_name": self.command.unit, "sensors": self.sensors._fields or "-",
        }  # fmt: skip
        return shorten([text(note("front.vehicle", **figures))], [], [])

    if not TYPE_CHECKING:
        __getattr__ = raise_missing_attribute

    def rows(self) -> list[TableRow]:
        """Return one flat dict per key of the model, with the run that measured it."""
        return model_values(self.data, self.provenance)

    def table(self) -> str:
        """Return the text of the whole file."""
        return self.text

    _repr_html_ = Result._repr_html_

    def estimator(self, kind: OwnBlock | None = None, **changes: Any) -> Any:
        """Return the block of [estimator]; `changes` replace its fields. `kind` replaces the block: a built-in kind,
        "file.py:Class", a class built with the values of the file, or a block. Raise FileError for a missing value."""
        return self._block("estimator", kind, changes)

    def kind(self, role: str) -> type:
        """Return the class of the block of a role."""
        own_kind = self.data.get(role, {}).get("kind", build.DEFAULT_KINDS[role])
        return resolve_named(role, own_kind, self.folder)

    def controller(self, kind: OwnBlock | None = None, **changes: Any) -> Any:
        """Return the block of [controller]; the arguments are as for `estimator`."""
        return self._block("controller", kind, changes)

    def supervisor(self, kind: OwnBlock | None = None, **changes: Any) -> Any:
        """Return the block of [supervisor]; the arguments are as for `estimator`."""
        return self._block("supervisor", kind, changes)

    def guide(self, route: "Route | None" = None, kind: OwnBlock | None = None, **changes: Any) -> Any:
        """Return the block of [guide], along `route` if it has fields for a route; see `estimator`."""
        arguments = {"route": route, **route._asdict()} if route is not None else {}
        return self._block("guide", kind, changes, arguments)

    def value(self, key: str) -> Any:
        """Return the value or the default of a key: "model.friction.linear". Raise UsageError for an unknown key."""
        return current_value(self, key)

    @checked_call('robot.with_values({"model.mass_kg": 1.0})')
    def with_values(
        self, values: JsonObject, provenance: JsonObject | None = None,
        parameter_cov: ParameterCov | None = None, envelope: Envelope | None = None,
    ) -> "VehicleFile":  # fmt: skip
        """Return the file with other `values` {dotted key: value} and all comments, checked like any file. Raise
        UsageError for a key that no block reads, or without tomlkit."""
        from baqueano.vehicle_file.text.edit import edit_text

        text = edit_text(self, values, provenance or {}, parameter_cov, envelope)
        return parse(text, self.label, self.path, self.layers, self.on_disk)

    @checked_call('robot.save("vehicle.toml")')
    def save(self, path: str | Path | None = None) -> Path:
        """Write the text, completely or not at all, to `path` or to its present path, and return the path. Raise
        FileError if another program changed the file since it was read, or if it cannot be written. Raise UsageError
        for a file of the garage without `path`."""
        from baqueano.vehicle_file.text.edit import write_file_text

        target = write_file_text(self, path)
        if target == self.path:
            object.__setattr__(self, "on_disk", self.text)  # the file now contains this text
        return target

    @property
    def is_guess(self) -> bool:
        """Return True if no value of its model was measured by a fit that was not refused.

        >>> small = load("small")
        >>> origin = {"model.friction.linear": Provenance("0001-experiment", verdict="USABLE")}
        >>> small.is_guess, small.with_values({}, origin).is_guess
        (True, False)
        """
        return not is_measured(self.provenance)

    @property
    def truth(self) -> "VehicleFile":
        """Return the vehicle that a simulation drives: the key `truth` of [simulation], by default this vehicle.

        The key is a name of the garage, or a file in the folder of this file. Raise FileError if it does not exist, or
        is in another folder.

        >>> load("small").truth.name
        'small'
        """
        truth_name = self.simulation.truth
        if truth_name is None:
            return self
        if truth_name in garage.names():
            return self.simulation_truth(load(truth_name))
        file_folder = Path(self.folder or ".").resolve()
        if not (file_folder / truth_name).resolve().is_relative_to(file_folder):
            raise FileError.of(
                "vehicle.truth-elsewhere", file=self.label, value=truth_name, garage=garage.names()
            )
        return self.simulation_truth(load(file_folder / truth_name))

    def simulation_truth(self, truth: "VehicleFile") -> "VehicleFile":
        """Return `truth` with the IMU filter of this file, and with the sensors that only this file describes."""
        from baqueano.vehicle_file.text.edit import text_with_equipment

        return parse(text_with_equipment(truth, self), truth.label, truth.path, truth.layers, truth.on_disk)

    @property
    def sensors_without_noise(self) -> tuple[str, ...]:
        """Return the names of sensors without noise in the file; estimators use the usual noise of such sensors."""
        return tuple(build.sensors_without_noise(self.sensors))

    @property
    def folder(self) -> str | None:
        """Return the folder to search first for a block of the user; None for a file from a run."""
        return _folder(self.path, self.on_disk)

    @property
    def _context(self) -> BuildContext:
        return BuildContext(self.folder, self.rate_hz, self.geometry)

    def _block(
        self, role: str, kind: OwnBlock | None, changes: JsonObject, arguments: JsonObject | None = None
    ) -> Any:
        if kind is not None and not isinstance(kind, str):
            check_role(role, kind)
            if not isinstance(kind, type):
                return kind
        report = ReadReport(self.label, self.text)
        sensors = build.with_usual_noise(self.sensors) if role == "estimator" else self.sensors
        arguments = {"vehicle": self.vehicle, "sensors": sensors, **(arguments or {})}
        fallback = {"rate_hz": self.rate_hz, "limit": self.command.limit}
        if role == "estimator" and kind and self.kind(role) is AugmentedEkf:
            fallback["process_noise_cov"] = self.estimator().process_noise_cov
        content = build.role_table(
            report, role, self.data.get(role, {}), arguments, fallback, self._context, kind
        )
        report.raise_problems()
        assert content is not None
        if keys := [k for k in content.missing_names if k not in changes]:
            own_kind = self.data.get(role, {}).get("kind")
            raise build.missing_values(report.name, self.path, role, keys, kind, own_kind)
        route_names = {"t_s", "route"} & build.argument_names(content.block_class)
        if role == "guide" and "route" not in arguments and route_names:
            raise UsageError.of("vehicle.no-route", guide=content.block_class.__name__)
        block = build.construct(
            report, (role,), content.block_class, {**content.values, **changes}, self._context
        )
        report.raise_problems()
        return block


VehicleFile.__setattr__ = refuse_change


@checked_call('bq.load("small")')
def load(source: str | Path, allow_blocks: bool = False) -> VehicleFile:
    """Return the vehicle file at a path, or the file of that name in the garage.

    Parameters
    ----------
    source : str or path
        "small", or "my/vehicle.toml".
    allow_blocks : bool
        True to execute even the code of blocks outside the folder of the file.

    Returns
    -------
    VehicleFile
        The file, completely checked.

    Raises
    ------
    FileError
        With every wrong key, its value, and the expected value.

    Examples
    --------
    >>> small = load("small")
    >>> small.command.names, small.command.limit.tolist(), small.rate_hz
    (('u_x', 'u_y', 'u_psi'), [1.0, 0.0, 1.0], 100.0)
    >>> print(small.value("model.mass_kg"), "kg")
    0.61 kg
    """
    path = garage.resolve_path(source)
    text = read_text(path)
    is_users_file = not garage.is_in_garage(path)
    layers = (path.name if is_users_file else f"garage: {path.stem}",)
    with permit_blocks(allow_blocks):
        return parse(text, path.name, path if is_users_file else None, layers, text)


def parse(
    text: str, name: str, path: Path | None = None, layers: Iterable[str] = (), on_disk: str | None = None
) -> VehicleFile:
    """Return a vehicle file from its text.

    Parameters
    ----------
    text : str
        TOML, as in docs/vehicle-file.md.
    name : str
        Name of the file in messages.
    path : Path, optional
        Path of the file, for blocks of the user in its folder.
    layers : iterable of str
        Sources of the values.
    on_disk : str, optional
        Text of the file when it was read.

    Returns
    -------
    VehicleFile
        The file, completely checked.

    Raises
    ------
    FileError
        With every wrong key.

    Examples
    --------
    >>> parse(load("small").text, "copy").name
    'small'
    """
    text = with_present_keys(text, name)
    report, data = ReadReport(name, text), tables(text, name)
    top = read_top(report, data)
    channels, geometry, hardware, simulation = read_head(report, data)
    imu_filter_hz = low_pass_hz(hardware.imu_filter) if "imu_filter" in data.get("robot", {}) else None
    context = BuildContext(_folder(path, on_disk), top.rate_hz, geometry, imu_filter_hz)
    vehicle = build.vehicle(report, data["model"], context)
    sensors = build.sensors(report, data.get("sensors", {}), context)
    report.raise_problems()
    command = read_command(report, channels, vehicle)
    check_values(report, vehicle, sensors, geometry, channels, top.rate_hz)
    provenance, parameter_cov = read_history(report, data, context.folder)
    envelope = read_envelope(report, data, command.names, sensors)
    report.raise_problems()
    vehicle_file = VehicleFile(
        top.name, path, text, data, command, top.rate_hz, geometry, vehicle, sensors, provenance,
        parameter_cov, envelope, tuple(report.notes), tuple(layers) or (name,), name, hardware, simulation, on_disk,
    )  # fmt: skip
    _check_roles(report, vehicle_file)
    return vehicle_file


def _folder(path: Path | None, on_disk: str | None) -> str | None:
    if path is not None:
        return str(path.parent)
    return None if on_disk is None else "."  # of the garage: the working directory


def _check_roles(report: ReadReport, vehicle_file: VehicleFile) -> None:
    """Check the tables of the loop's blocks. Raise FileError with all problems. A missing key is an error only
    when its block is used: `tune` finds gains, `identify` finds noise."""
    data = vehicle_file.data
    for role in LOOP_ROLES:
        if role not in data or (vehicle_file.on_disk is None and _is_users(data[role])):
            continue  # from a run: the user's file might have been moved since
        arguments = {"vehicle": vehicle_file.vehicle, "sensors": build.with_usual_noise(vehicle_file.sensors)}
        fallback = {"rate_hz": vehicle_file.rate_hz, "limit": vehicle_file.command.limit}
        block = build.role_table(report, role, data[role], arguments, fallback, vehicle_file._context)
        if block is not None and not block.missing_names and not report.problems and role != "guide":
            build.construct(report, (role,), block.block_class, block.values, vehicle_file._context)
    for name, table in data.items():
        if name not in TOP_LEVEL_KEYS and name not in TABLE_NAMES:
            report_unknown_key(report, (name,), table, dict.fromkeys((*TOP_LEVEL_KEYS, *TABLE_NAMES), ""))
    report.raise_problems()


def _is_users(table: object) -> bool:
    kind = table.get("kind") if isinstance(table, dict) else None
    return isinstance(kind, str) and ".py:" in kind


def today() -> date:
    """Return today's date, the default date of a value."""
    return date.today()
