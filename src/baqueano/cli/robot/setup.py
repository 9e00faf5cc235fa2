"""Define the subcommands of `baqueano robot` that install a vehicle on a Pi, or remove it: card, setup, remove."""

from pathlib import Path

import click

from baqueano.cli import options
from baqueano.cli.terminal import print_message, print_result
from baqueano.diagnostics import note
from baqueano.errors import UsageError
from baqueano.messages.language import translate as _
from baqueano.messages.printable import baqueano_command

host = click.argument("host")


@click.command(
    help="Write first-boot files on a card with 64-bit Raspberry Pi OS Lite: name, user, ssh key, network."
)
@click.argument("folder", required=False, type=click.Path(path_type=Path))
@click.option("--name", help="Host name of the robot; default: a new one.")
@click.option(
    "--user",
    default="pilot",
    show_default=True,
    help=("User name for ssh; the key is the only way to log in."),
)
@click.option("--key", type=click.Path(path_type=Path), help="Public ssh key; default: yours in ~/.ssh.")
@click.option("--wifi", metavar="SSID", help="Name of the Wi-Fi that the robot joins.")
@click.option(
    "--own-network",
    "own",
    is_flag=True,
    help=("Let the robot open its own Wi-Fi, with its host name, for up to four clients."),
)
@click.option(
    "--password",
    help=(
        "Password of the Wi-Fi. If it is missing, the command asks for it; for the robot's own network it "
        "is generated."
    ),
)
@click.option(
    "--country", default="", help=("Country of the Wi-Fi, two letters; without it the Wi-Fi stays off.")
)
def card(
    folder: Path | None, name: str | None, user: str, key: Path | None, wifi: str | None, own: bool,
    password: str | None, country: str,
) -> None:  # fmt: skip
    from baqueano.robot.setup.card import (
        Network,
        boot_partition,
        new_name,
        new_password,
        public_key,
        write_card,
    )

    if wifi is not None and own:
        raise UsageError.of("cli.network-conflict")
    boot, text, name = boot_partition(folder), public_key(key), name or new_name()
    network = None
    if wifi is not None:
        secret = password or click.prompt(_("password of {wifi}", wifi=wifi), hide_input=True, err=True)
        network = Network(wifi, secret, country)
    elif own:
        network = Network(name, password or new_password(), country, own=True)
    for line in write_card(boot, name, user, text, network):
        print_result(line)
    if network is None:
        print_result(note("cli.no-network"))
    elif own:
        print_result(note("cli.own-network", ssid=network.ssid, password=network.password))
    print_result(note("cli.card-written", fix=baqueano_command("robot", "setup", f"{user}@{name}.local")))


@click.command(
    help="Install baqueano and its service on the Raspberry Pi at HOST, over ssh; every change is printed."
)
@host
@options.vehicle
@click.option("--dry-run", "dry", is_flag=True, help="Only show the changes, and do not make them.")
@click.option("--bundle", "folder", type=click.Path(path_type=Path, file_okay=False),
              help="Folder of the robot's packages; default: the cache.")  # fmt: skip
def setup(host: str, vehicle: str | None, settings: tuple[str, ...], dry: bool, folder: Path | None) -> None:
    from baqueano.door.ssh import ssh_line
    from baqueano.robot.setup.install import host_machine, make_bundle, setup as install
    from baqueano.symbolic.c_code.compile import user_cache

    vehicle_file = options.load_vehicle(vehicle, settings)
    machine = host_machine(host)
    python = f"{machine.python[0]}.{machine.python[1]}"
    folder = make_bundle(
        folder or user_cache() / "robot" / f"{python}-{machine.kind}", machine, print_message
    )
    (folder / "vehicle.toml").write_text(vehicle_file.text, encoding="utf-8")
    has_own_file = vehicle is not None or options.DEFAULT_FILE.exists()
    if not has_own_file:
        print_message(note("cli.no-vehicle-file"))
    install(
        host,
        folder,
        machine,
        vehicle=vehicle_file if has_own_file else None,
        notify=print_result,
        is_dry_run=dry,
    )
    if not dry:
        fix = baqueano_command("robot", "doctor", host)
        print_result(note("cli.is-a-vehicle", fix=fix, host=host, ssh=ssh_line(host)))


@click.command(help="Remove everything that setup installed at HOST, except the runs.")
@host
def remove(host: str) -> None:
    from baqueano.robot.setup.install import host_machine, remove as undo

    undo(host, host_machine(host))
