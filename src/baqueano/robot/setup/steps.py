"""The changes on a Raspberry Pi that make it a vehicle, step by step, and the way to undo each.

Plain Python of the standard library: `baqueano robot setup` sends this file, and the system's python3 runs it as root.

    python3 steps.py plan|do|undo --bundle FOLDER --user NAME [--root /] [--now SECONDS]

Each step says whether it is done already, does it, and undoes what it did: what was there before is kept in
/etc/baqueano/setup.json, which is written after each step, so a setup that was cut off can be undone as well. Runs and
the vehicle file in /var/lib/baqueano are the user's, and stay, with the vehicle.toml.before of the last change.
"""

import argparse
import hashlib
import json
import os
import shutil
import subprocess
import sys
import time
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from baqueano.contracts.values import JsonObject

GROUPS = ("dialout", "i2c", "gpio", "input")
BEGIN, END = "# baqueano: begin", "# baqueano: end"
CONFIG = f"""{BEGIN}
[all]
dtparam=i2c_arm=on,i2c_arm_baudrate=400000
# the I2C clock follows the core's: it must not step
[pi3]
core_freq=250
[pi02]
core_freq=250
[all]
{END}
"""
CLOCK_OFF_S = 60.0
WORDS: dict[str, str] = {}  # English → the language of the laptop, which fills it


class Step(NamedTuple):
    """A change. `done` looks, `do` makes it, `undo` takes back what `do` noted."""

    name: str
    done: Callable[[], bool]
    do: Callable[[], object]
    undo: Callable[[], object]


class Pi:
    """The machine below `root`, and what was changed on it."""

    def __init__(self, root: Path, bundle: Path, user: str, run: Callable[..., str] | None = None) -> None:
        self.root, self.bundle, self.user = root, bundle, user
        self.run = run or commanded
        self.kept = self.at("etc/baqueano/setup.json")
        try:
            self.noted: JsonObject = json.loads(text_of(self.kept) or "{}")
        except ValueError as error:
            said = _(
                "{path} is damaged ({error}): the former state of this machine is lost. Type on the vehicle sudo mv "
                "{path} {path}.damaged, and then set it up again",
                path=self.kept, error=error,
            )  # fmt: skip
            sys.exit(said)

    def at(self, path: str) -> Path:
        """A path of the machine."""
        return self.root / path.lstrip("/")

    def note(self, name: str, what: object) -> None:
        """Keeps what was there before, once; of a list, what is new too. None forgets it."""
        if what is None:
            self.noted.pop(name, None)
        elif isinstance(what, list):
            self.noted[name] = list(dict.fromkeys([*self.noted.get(name, []), *what]))
        else:
            self.noted.setdefault(name, what)
        if not self.noted:
            self.kept.unlink(missing_ok=True)
            self.kept.parent.rmdir()
            return
        self.kept.parent.mkdir(parents=True, exist_ok=True)
        whole(self.kept, json.dumps(self.noted, indent=1))

    @property
    def config(self) -> Path:
        """config.txt of the boot partition, where this image has it."""
        old = self.at("boot/config.txt")
        return (
            old
            if old.exists() and not self.at("boot/firmware/config.txt").exists()
            else self.at("boot/firmware/config.txt")
        )

    def groups(self) -> dict[str, list[str]]:
        """Members of those of GROUPS that this system has."""
        fields = [line.split(":") for line in text_of(self.at("etc/group")).splitlines()]
        there = {f[0]: f[3].split(",") for f in fields if len(f) == 4}
        return {group: there[group] for group in GROUPS if group in there}

    @property
    def venv(self) -> Path:
        """The environment of its own."""
        return self.at("opt/baqueano")


def text_of(path: Path) -> str:
    """Return the text of a file, "" where there is none."""
    return path.read_text(encoding="utf-8") if path.exists() else ""


def _(words: str, /, **figures: object) -> str:
    """Return words in the language of who typed `robot setup`."""
    return WORDS.get(words, words).format_map(figures)


def whole(path: Path, text: str) -> None:
    """Writes a file beside the old one and puts it in its place: where the power goes meanwhile, the old one stays."""
    target = path.resolve()
    part = target.with_name(f"{target.name}.part")
    with part.open("w", encoding="utf-8") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    os.replace(part, target)


def commanded(*command: str) -> str:
    """Return the output of a command; SystemExit with its words where it fails."""
    done = subprocess.run(command, capture_output=True, encoding="utf-8", errors="replace")
    if done.returncode:
        said, line = (done.stderr or done.stdout).strip()[-2000:], " ".join(command)
        sys.exit(_("{command} failed ({code}): {words}", command=line, code=done.returncode, words=said))
    return done.stdout


def steps(pi: Pi, now_s: float | None = None) -> list[Step]:
    """All of them, in order."""
    unit = text_of(pi.bundle / "baqueano.service")
    unit = unit.replace("@user@", pi.user).replace("@groups@", " ".join(pi.groups()))
    rules = text_of(pi.bundle / "60-baqueano.rules")
    return [
        clock(pi, now_s),
        boot_block(pi),
        written(pi, "etc/modules-load.d/baqueano.conf", "i2c-dev\n"),
        written(pi, "etc/udev/rules.d/60-baqueano.rules", rules),
        groups(pi),
        environment(pi),
        linked(pi, "usr/local/bin/baqueano", "/opt/baqueano/bin/baqueano"),
        vehicle(pi),
        written(pi, "etc/systemd/system/baqueano.service", unit),
        service(pi),
    ]


def clock(pi: Pi, now_s: float | None) -> Step:
    """Set the laptop's time on a Pi, which lacks one without a network."""
    return Step(
        _("clock: the laptop's time") if now_s is not None else _("clock: as it is"),
        lambda: now_s is None or abs(time.time() - now_s) < CLOCK_OFF_S,
        lambda: pi.run("date", "-s", f"@{now_s:.0f}"),
        lambda: None,
    )


def boot_block(pi: Pi) -> Step:
    """I2C at 400 kHz behind a core clock that stands still."""

    def without() -> str:
        text = pi.config.read_text(encoding="utf-8")
        head, begin, rest = text.partition(BEGIN)
        return head + rest.partition(END + "\n")[2] if begin else text

    def do() -> None:
        pi.note("boot", True)
        text = without()
        whole(pi.config, text + ("" if not text or text.endswith("\n") else "\n") + CONFIG)

    def undo() -> None:
        if "boot" in pi.noted and pi.config.exists():
            whole(pi.config, without())
            pi.note("boot", None)

    if not pi.config.exists():
        return Step(_("config.txt is missing: this is not a Raspberry Pi"), lambda: True, lambda: None, undo)
    name = _("{path}: I2C at 400 kHz, core_freq fixed (after the next start)", path=pi.config)
    return Step(name, lambda: CONFIG in pi.config.read_text(encoding="utf-8"), do, undo)


def written(pi: Pi, path: str, text: str) -> Step:
    """A whole file; what was there before comes back."""
    target, key = pi.at(path), f"file {path}"

    def do() -> None:
        pi.note(key, {"before": target.read_text(encoding="utf-8") if target.exists() else None})
        target.parent.mkdir(parents=True, exist_ok=True)
        whole(target, text)

    def undo() -> None:
        if key in pi.noted:
            before = pi.noted[key]["before"]
            if before is None:
                target.unlink(missing_ok=True)
            else:
                whole(target, before)
            pi.note(key, None)

    return Step(f"/{path}", lambda: target.exists() and target.read_text(encoding="utf-8") == text, do, undo)


def linked(pi: Pi, path: str, to: str) -> Step:
    """A command on everybody's path."""
    link, key = pi.at(path), f"link {path}"

    def do() -> None:
        pi.note(key, {"before": os.readlink(link) if link.is_symlink() else None})
        link.parent.mkdir(parents=True, exist_ok=True)
        link.unlink(missing_ok=True)
        link.symlink_to(to)

    def undo() -> None:
        if key in pi.noted:
            link.unlink(missing_ok=True)
            if pi.noted[key]["before"] is not None:
                link.symlink_to(pi.noted[key]["before"])
            pi.note(key, None)

    return Step(f"/{path} → {to}", lambda: link.is_symlink() and os.readlink(link) == to, do, undo)


def groups(pi: Pi) -> Step:
    """The user may open the line, the bus and a game pad."""

    def missing() -> list[str]:
        return [group for group, members in pi.groups().items() if pi.user not in members]

    def do() -> None:
        pi.note("groups", missing())
        pi.run("usermod", "-aG", ",".join(missing()), pi.user)

    def undo() -> None:
        for group in pi.noted.get("groups", []):
            pi.run("gpasswd", "-d", pi.user, group)
        pi.note("groups", None)

    return Step(
        _("{user} is in {groups}", user=pi.user, groups=", ".join(pi.groups())),
        lambda: not missing(),
        do,
        undo,
    )


def environment(pi: Pi) -> Step:
    """A venv of its own, from the wheels of the bundle: neither the internet nor the system's pip is asked. The one
    before it stays until the new one is whole, and comes back where that fails."""
    wheels = [f"{path.name} {zlib.crc32(path.read_bytes()):08x}" for path in sorted(pi.bundle.glob("*.whl"))]
    stamp, before = pi.venv / "bundle.txt", pi.venv.with_name("baqueano.before")

    def do() -> None:
        pi.note("environment", True)
        if stamp.exists():  # one that is whole
            shutil.rmtree(before, ignore_errors=True)
            os.rename(pi.venv, before)
        try:
            install()
        except BaseException:
            shutil.rmtree(pi.venv, ignore_errors=True)
            if before.exists():
                os.rename(before, pi.venv)
            raise
        shutil.rmtree(before, ignore_errors=True)

    def install() -> None:
        shutil.rmtree(pi.venv, ignore_errors=True)
        pi.venv.parent.mkdir(parents=True, exist_ok=True)
        python = sys.executable if sys.prefix == sys.base_prefix else "python3"
        pi.run(python, "-m", "venv", "--without-pip", str(pi.venv))
        locks = {
            name: (pi.bundle / f"{name}.lock").read_text(encoding="utf-8") for name in ("pip", "packages")
        }
        pips = [(path, hashlib.sha256(path.read_bytes()).hexdigest()) for path in pi.bundle.glob("pip-*.whl")]
        pip = next((path for path, found in pips if f"sha256:{found}" in locks["pip"]), None)
        if pip is None:
            sys.exit("the wheel of pip is not the one of the lock, so nothing was installed")
        words = (
            "install",
            "--quiet",
            "--no-index",
            "--no-deps",
            "--no-warn-script-location",
            "--require-hashes",
        )
        wanted = ("--find-links", str(pi.bundle), "-r", str(pi.bundle / "packages.lock"))
        pi.run(str(pi.venv / "bin/python"), str(pip / "pip"), *words, *wanted)
        whole(stamp, "\n".join(wheels))

    def undo() -> None:
        if "environment" in pi.noted:
            shutil.rmtree(pi.venv, ignore_errors=True)
            shutil.rmtree(before, ignore_errors=True)
            pi.note("environment", None)

    same = lambda: stamp.exists() and stamp.read_text(encoding="utf-8") == "\n".join(wheels)  # noqa: E731
    return Step(_("/opt/baqueano: a venv with {wheels} wheels", wheels=len(wheels)), same, do, undo)


def vehicle(pi: Pi) -> Step:
    """The vehicle file. One that is there is replaced only by one that was made from it, whose text is in the bundle as
    vehicle.toml.seen; it stays beside it."""
    target, ours = pi.at("var/lib/baqueano/vehicle.toml"), pi.bundle / "vehicle.toml"
    before, seen = target.with_name("vehicle.toml.before"), pi.bundle / "vehicle.toml.seen"

    def done() -> bool:
        if not ours.exists() or not target.exists():
            return not ours.exists()
        return not seen.exists() or target.read_bytes() == ours.read_bytes()

    def do() -> None:
        target.parent.mkdir(parents=True, exist_ok=True)
        if target.exists():
            if target.read_bytes() != seen.read_bytes():
                sys.exit(
                    _("{path} was changed by somebody else meanwhile and stays: type it again", path=target)
                )
            shutil.copyfile(target, before)
        part = target.with_name("vehicle.toml.part")
        shutil.copyfile(ours, part)
        os.replace(part, target)
        pi.run("chown", "-R", pi.user, str(target.parent))

    old = _("; the one before is vehicle.toml.before") if target.exists() and not done() else ""
    return Step(f"/var/lib/baqueano/vehicle.toml{old}", done, do, lambda: None)


def service(pi: Pi) -> Step:
    """Starts now and at each start of the machine."""

    def do() -> None:
        pi.note("service", True)
        pi.run("udevadm", "control", "--reload")
        pi.run("systemctl", "daemon-reload")
        pi.run("systemctl", "enable", "baqueano.service")
        pi.run("systemctl", "restart", "--no-block", "baqueano.service")

    def undo() -> None:
        if "service" in pi.noted:
            pi.run("systemctl", "disable", "--now", "baqueano.service")
            pi.note("service", None)

    return Step(_("baqueano.service: enabled and started"), lambda: False, do, undo)


def undo(pi: Pi, todo: list[Step]) -> int:
    """Takes back what was noted, the last first."""
    if not pi.noted:
        print(_("nothing of baqueano is installed here"))
        return 0
    for step in reversed(todo):
        before = len(pi.noted)
        step.undo()
        if len(pi.noted) < before:
            print(_("undone   {step}", step=step.name))
    pi.run("systemctl", "daemon-reload")
    pi.run("udevadm", "control", "--reload")
    print(_("runs and vehicle file in /var/lib/baqueano stay; config.txt counts after the next start"))
    return 0


def main(arguments: list[str] | None = None, run: Callable[..., str] | None = None) -> int:
    """See above; one line for each step."""
    parser = argparse.ArgumentParser()
    parser.add_argument("what", choices=("plan", "do", "undo"))
    parser.add_argument("--bundle", type=Path, default=Path())
    parser.add_argument("--user", required=True)
    parser.add_argument("--root", type=Path, default=Path("/"))
    parser.add_argument("--now", type=float)
    options = parser.parse_args(arguments)
    pi = Pi(options.root, options.bundle, options.user, run)
    todo = steps(pi, options.now)
    if options.what == "undo":
        return undo(pi, todo)
    for step in todo:
        if step.done():
            print(_("as it is {step}", step=step.name))
        elif options.what == "plan":
            print(_("would    {step}", step=step.name))
        else:
            step.do()
            print(_("done     {step}", step=step.name))
    return 0


if __name__ == "__main__":
    sys.exit(main())
