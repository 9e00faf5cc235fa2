"""Install baqueano on a Raspberry Pi over ssh: make a bundle of wheels here, and run the steps of steps.py there.

The robot does not need the internet: this computer downloads the wheels for the robot's Python and processor, once,
into its cache. The bundle is sent to /tmp on the robot, its steps run as root, and the bundle is deleted. The terminal
requests the passwords of ssh and sudo.
"""

import ast
import hashlib
import io
import re
import shlex
import shutil
import subprocess
import sys
import tarfile
import time
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path
from typing import NamedTuple

import baqueano
from baqueano.door.ssh import run_command, ssh_command, ssh_line
from baqueano.errors import FileError, RobotUnreachable, UsageError
from baqueano.messages.language import translate as _
from baqueano.robot.setup.deployed_vehicle_file import renew_file
from baqueano.vehicle_file.file import VehicleFile

# a package of the lock
LOCKED_PACKAGE = re.compile(r"^([\w.-]+)==(\S+)(?: \\\n +--hash=sha256:\w+)+\n", re.MULTILINE)
MACHINE_TYPES = ("aarch64", "x86_64")
MIN_PYTHON = (3, 11)
GLIBC = (
    "manylinux2014",
    "manylinux_2_24",
    "manylinux_2_26",
    "manylinux_2_27",
    "manylinux_2_28",
    "manylinux_2_31",
)
TARGET_FOLDER = "/tmp/baqueano-setup"
BASE_FILE = "vehicle.toml.seen"
# unnecessary once the texts are joined
IMPORT_LINE = re.compile(r"^from baqueano\.robot\.setup\.machine import .*\n", re.MULTILINE)
NO_WORDS = "WORDS: dict[str, str] = {}"
PROBE_COMMAND = (
    'python3 -c "import sys, os, pwd; '
    'print(*sys.version_info[:2], os.uname().machine, pwd.getpwuid(os.getuid())[0])"'
)
PROBE_OUTPUT = r"\d{1,3} \d{1,3} [\w-]{1,32} [\w.-]{1,64}"  # the answer to PROBE_COMMAND
Notify = Callable[[str], object]


class TargetMachine(NamedTuple):
    """The version of Python, the processor and the user's name at a host."""

    python: tuple[int, int]
    kind: str
    user: str


def host_machine(host: str) -> TargetMachine:
    """Return the machine at a host.

    Raise RobotUnreachable if ssh fails. Raise UsageError for a 32-bit system, or a Python that is too old.
    """
    output, code = run_command(ssh_command(host, PROBE_COMMAND))
    fields = output.decode(errors="replace").split()
    if code or not re.fullmatch(PROBE_OUTPUT, " ".join(fields)):
        raise RobotUnreachable.of("setup.no-answer", ssh_line(host), host=host)
    target = TargetMachine((int(fields[0]), int(fields[1])), fields[2], fields[3])
    if target.kind not in MACHINE_TYPES:
        raise UsageError.of("setup.32-bit", host=host, computer=target.kind)
    if target.python < MIN_PYTHON:
        raise UsageError.of(
            "setup.old-python",
            host=host,
            major=target.python[0],
            minor=target.python[1],
            min_major=MIN_PYTHON[0],
            min_minor=MIN_PYTHON[1],
        )
    return target


def make_bundle(folder: Path, machine: TargetMachine, notify: Notify = lambda text: None) -> Path:
    """Collect all files and wheels for `machine` in `folder`, and return `folder`.

    Wheels of other packages that are already present are not downloaded again. Raise FileError if pip fails.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for old_wheel in folder.glob("baqueano-*.whl"):
        old_wheel.unlink()
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet"]
    tree = Path(baqueano.__file__).resolve().parents[2]
    if (tree / "pyproject.toml").exists():
        _run_pip([*pip, "wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", str(folder), str(tree)])
    else:
        _run_pip([*pip, "download", "--no-deps", "--dest", str(folder), f"baqueano=={baqueano.__version__}"])
    lock = (files("baqueano.robot") / "files" / "onboard.lock").read_text(encoding="utf-8")
    packages = {match[1]: match[0] for match in LOCKED_PACKAGE.finditer(lock)}
    missing_packages = [
        match[1]
        for match in LOCKED_PACKAGE.finditer(lock)
        if not list(folder.glob(f"{match[1]}-{match[2]}-*.whl"))
    ]
    if missing_packages:
        notify(
            _(
                "downloading {missing} for Python {version} on {kind}",
                missing=", ".join(missing_packages),
                version=f"{machine.python[0]}.{machine.python[1]}",
                kind=machine.kind,
            )
        )
        tag = f"{machine.python[0]}{machine.python[1]}"
        platforms = [x for glibc in GLIBC for x in ("--platform", f"{glibc}_{machine.kind}")]
        abis = ["--abi", f"cp{tag}", "--abi", "abi3", "--abi", "none"]
        (folder / "onboard.lock").write_text(lock, encoding="utf-8")
        _run_pip(
            [*pip, "download", "--only-binary=:all:", "--implementation", "cp", "--python-version", tag, *abis,
             *platforms, "--dest", str(folder), "--no-deps", "--require-hashes", "-r", str(folder / "onboard.lock")]
        )  # fmt: skip
    _write_locks(folder, packages)
    for name in ("baqueano.service", "60-baqueano.rules"):
        shutil.copyfile(str(files("baqueano.robot") / "files" / name), folder / name)
    (folder / "steps.py").write_text(translated_steps(), encoding="utf-8")
    return folder


def translated_steps() -> str:
    """Return the joined text of machine.py and steps.py, with their messages in the current language.

    The text runs without this package.
    """
    sources = [
        (files("baqueano.robot.setup") / name).read_text(encoding="utf-8")
        for name in ("machine.py", "steps.py")
    ]
    text = IMPORT_LINE.sub("", "\n\n".join(sources))
    calls = (node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Call))
    texts = [
        call.args[0].value
        for call in calls
        if isinstance(call.func, ast.Name) and call.func.id == "_" and isinstance(call.args[0], ast.Constant)
    ]
    catalogue = {str(word): _(str(word)) for word in texts}
    return text.replace(NO_WORDS, f"{NO_WORDS[:-2]}{catalogue!r}", 1)


def _write_locks(folder: Path, packages: dict[str, str]) -> None:
    """Write the lock files with the hashes of all wheels, including the wheel just built; pip has a separate lock."""
    pip_lock = "".join(
        f"baqueano=={path.name.split('-')[1]} --hash=sha256:{hashlib.sha256(path.read_bytes()).hexdigest()}\n"
        for path in folder.glob("baqueano-*.whl")
    )
    (folder / "pip.lock").write_text(packages["pip"], encoding="utf-8")
    other_locks = "".join(text for name, text in packages.items() if name != "pip")
    (folder / "packages.lock").write_text(other_locks + pip_lock, encoding="utf-8")


def _run_pip(command: list[str]) -> None:
    process = subprocess.run(command, capture_output=True, encoding="utf-8", errors="replace")
    if process.returncode:
        lines = process.stderr.strip().splitlines() or [_("without output")]
        raise FileError.of("setup.packages", reply=lines[-1])


def setup(
    host: str, folder: Path, machine: TargetMachine, *, vehicle: "VehicleFile | None" = None,
    notify: Notify = lambda text: None, is_dry_run: bool = False, root: str = "/",
) -> None:  # fmt: skip
    """Send `folder` to HOST and run the steps there; their output appears in the terminal.

    A vehicle file `vehicle` replaces the file at HOST, but the calibrations of that file stay; `notify` receives the
    changes. Without `vehicle`, the file at HOST stays. With `is_dry_run` the steps are only planned. Raise
    RobotUnreachable if `folder` cannot be sent, or if the steps fail; other errors are as in `renew_file`.
    """
    (folder / BASE_FILE).unlink(missing_ok=True)
    if vehicle is not None:
        new_file = renew_file(host, vehicle, root)
        (folder / "vehicle.toml").write_bytes(new_file.text.encode())
        if new_file.base:
            (folder / BASE_FILE).write_bytes(new_file.base)
        for line in new_file.lines:
            notify(f"vehicle.toml  {line}")
    archive = io.BytesIO()
    with tarfile.open(fileobj=archive, mode="w") as tar:
        for path in sorted(folder.iterdir()):
            tar.add(path, path.name)
    command = f"rm -rf {TARGET_FOLDER} && mkdir -m 700 {TARGET_FOLDER} && tar -x -C {TARGET_FOLDER}"
    if run_command(ssh_command(host, command), archive.getvalue())[1]:
        raise RobotUnreachable.of("setup.packages-not-sent", host=host)
    arguments = [
        "--bundle",
        TARGET_FOLDER,
        "--user",
        machine.user,
        "--root",
        root,
        "--now",
        f"{time.time():.0f}",
    ]
    try:
        _run_steps(host, ["plan" if is_dry_run else "do", *arguments], as_root=not is_dry_run)
    finally:
        run_command(ssh_command(host, f"rm -rf {TARGET_FOLDER}"))


def remove(host: str, machine: TargetMachine, *, root: str = "/") -> None:
    """Undo the changes of `setup` at HOST. Raise RobotUnreachable if the steps cannot be sent, or fail."""
    text = translated_steps()
    command = f"rm -rf {TARGET_FOLDER} && mkdir -m 700 {TARGET_FOLDER} && cat >{TARGET_FOLDER}/steps.py"
    if run_command(ssh_command(host, command), text.encode())[1]:
        raise RobotUnreachable.of("setup.nothing-sent", host=host)
    try:
        _run_steps(
            host, ["undo", "--bundle", TARGET_FOLDER, "--user", machine.user, "--root", root], as_root=True
        )
    finally:
        run_command(ssh_command(host, f"rm -rf {TARGET_FOLDER}"))


def _run_steps(host: str, arguments: list[str], as_root: bool) -> None:
    terminal = sys.stdin is not None and sys.stdin.isatty()
    sudo = ["sudo"] if terminal else ["sudo", "-n"]
    command = shlex.join([*(sudo if as_root else ()), "python3", f"{TARGET_FOLDER}/steps.py", *arguments])
    if run_command(
        ssh_command(host, command, *(["-t"] if terminal and as_root else [])), return_output=False
    )[1]:
        raise RobotUnreachable.of("setup.not-finished", host=host)
