"""Define the subcommands of `baqueano robot` that maintain the hardware here or at HOST: doctor, flash, calibrate."""

from pathlib import Path
from typing import Any

import click

from baqueano.cli import options
from baqueano.cli.subcommands import SubcommandGroup
from baqueano.cli.terminal import print_answer, print_message
from baqueano.errors import UsageError

host = click.argument("host", default="here")


@click.command(
    help="Check line, firmware, IMU, battery, supply, permissions, disk and clock; advise what to do."
)
@host
@options.vehicle
@options.runs_folder
@click.option("--jitter", "jitter_s", type=float, is_flag=False, flag_value=10.0, default=0.0, metavar="[SECONDS]",
              help="Also measure how late a 100 Hz loop wakes up; default: 10 s.")  # fmt: skip
@options.as_json
def doctor(
    host: str, vehicle: str | None, settings: tuple[str, ...], folder: str, jitter_s: float, as_json: bool
) -> None:
    from baqueano.robot import HOME
    from baqueano.robot.workshop.doctor import Check, Report, examine
    from baqueano.robot.workshop.exclusive_hardware import fetch_result, stopped_service

    if host == "here":
        vehicle_file = options.load_vehicle(vehicle, settings)
        with stopped_service(print_message):
            report = examine(vehicle_file.robot, Path("/"), Path(folder), jitter_s, print_message)
    else:
        jitter_option = [f"--jitter={jitter_s:g}"] if jitter_s else []
        report = fetch_result(
            lambda rows: Report([Check(**row) for row in rows]), host,
            "robot", "doctor", "--runs", f"{HOME}/runs", *jitter_option,
        )  # fmt: skip
    print_answer(report, as_json)
    if report.verdict == "bad":
        click.get_current_context().exit(1)


@click.command(help="Write the package's firmware into the Uno; with --hex another one.")
@host
@options.vehicle
@click.option(
    "--hex",
    "hex_file",
    type=click.Path(path_type=Path),
    help=("Intel hex file, such as the file that make firmware builds."),
)
@options.as_json
def flash(
    host: str, vehicle: str | None, settings: tuple[str, ...], hex_file: Path | None, as_json: bool
) -> None:
    from baqueano.robot.uno.flash import FlashResult, flash as write
    from baqueano.robot.workshop.exclusive_hardware import fetch_result, stopped_service

    if host == "here":
        vehicle_file = options.load_vehicle(vehicle, settings)
        with stopped_service(print_message):
            result = write(vehicle_file.robot.port, hex_file, print_message)
    elif hex_file is not None:
        raise UsageError.of("cli.hex-at-host", host=host)
    else:
        result = fetch_result(lambda rows: FlashResult(**rows[0]), host, "robot", "flash")
    print_answer(result, as_json)


@click.group(
    cls=SubcommandGroup,
    help=(
        "Calibrate what differs from vehicle to vehicle: the mounting of the IMU, the wiring of the motors."
    ),
)
def calibrate() -> None:
    pass


@calibrate.command(
    help=("Calibrate axes and biases of the IMU: at rest, with the front lifted, and by half a turn by hand.")
)
@host
@options.vehicle
@options.update
@options.as_json
def imu(host: str, vehicle: str | None, settings: tuple[str, ...], update: bool, as_json: bool) -> None:
    from baqueano.robot.workshop.calibrate_imu import ImuCalibration, ImuReader, calibrate as find
    from baqueano.robot.workshop.exclusive_hardware import fetch_result, open_hardware

    vehicle_file = options.load_vehicle(vehicle, settings)
    if host == "here":
        with open_hardware(vehicle_file.robot, print_message, in_chip_axes=True, motors=False) as floor_tests:
            mounted_imu = find(ImuReader(floor_tests.imu), print_message)
    else:  # its service uses its own vehicle file, so that file is written there
        update_option = ["--update"] if update else []
        verb = ("robot", "calibrate", "imu", *update_option)
        mounted_imu = fetch_result(lambda rows: ImuCalibration.from_row(rows[0]), host, *verb)
    print_answer(mounted_imu, as_json)
    values = mounted_imu.values(vehicle_file)
    options.save_update(
        vehicle_file.with_values(values, {key: {"run": "calibrate imu"} for key in values}), update
    )


@calibrate.command(
    help=(
        "Measure wiring, dead zones and slopes of the motors, and store them in the Uno. This needs 1 m of "
        "free floor."
    )
)
@host
@options.vehicle
@options.as_json
def motors(host: str, vehicle: str | None, settings: tuple[str, ...], as_json: bool) -> None:
    from baqueano.robot.service.configuration import firmware_config
    from baqueano.robot.workshop.calibrate_motors import MotorCalibration, calibrate as find
    from baqueano.robot.workshop.exclusive_hardware import fetch_result, open_hardware

    motors: Any
    if host == "here":
        vehicle_file = options.load_vehicle(vehicle, settings)
        with open_hardware(vehicle_file.robot, print_message) as floor_tests:
            floor_tests.uno.configure(firmware_config(vehicle_file.robot, floor_tests.uno.info))
            motors = find(floor_tests, print_message)
    else:
        motors = fetch_result(MotorCalibration.from_rows, host, "robot", "calibrate", "motors")
    print_answer(motors, as_json)
