"""A folder that replaces a Raspberry Pi, a bundle of wheels for it, and programs that replace its own."""

import ensurepip
import hashlib
import shutil
import zipfile
from importlib.resources import files
from pathlib import Path

import pytest

from baqueano.robot.setup import install

COMMANDS = ("usermod", "gpasswd", "systemctl", "udevadm", "chown", "chmod", "date")
ACCOUNT = "baqueano:x:990:990::/var/lib/baqueano:/usr/sbin/nologin"
CONFIG = "dtparam=audio=on\n[cm4]\notg_mode=1\n"


@pytest.fixture
def programs(tmp_path, monkeypatch):
    """Return a function that puts shell scripts in front of the path; their calls are in the file `calls`."""
    place = tmp_path / "bin"
    place.mkdir()

    def put_scripts(**scripts):
        for name, text in scripts.items():
            (place / name).write_text(f'#!/bin/sh\necho "{name} $*" >>{tmp_path}/calls\n{text}\n')
            (place / name).chmod(0o755)
        return tmp_path / "calls"

    put_scripts(
        ssh='for last; do :; done; exec sh -c "$last"', sudo='[ "$1" = -n ] && shift; exec "$@"',
        **dict.fromkeys(COMMANDS, "exit 0"),
        useradd=f"echo {ACCOUNT} >>{tmp_path}/root/etc/passwd",
        userdel=f"sed -i /^baqueano:/d {tmp_path}/root/etc/passwd",
    )  # fmt: skip
    monkeypatch.setenv("PATH", f"{place}:/usr/local/bin:/usr/bin:/bin")
    monkeypatch.setattr(install, "TARGET_FOLDER", str(tmp_path / "there"))
    return put_scripts


@pytest.fixture
def pi(tmp_path):
    """Return the necessary files of a Raspberry Pi in a folder."""
    root = tmp_path / "root"
    for path, text in {
        "boot/firmware/config.txt": CONFIG,
        "etc/group": "dialout:x:20:\ni2c:x:998:ana\ngpio:x:997:bob\ninput:x:104:\n",
        "etc/passwd": "root:x:0:0:root:/root:/bin/bash\nana:x:1000:1000::/home/ana:/bin/bash\n",
        "etc/udev/rules.d/60-baqueano.rules": "# of somebody else\n",
    }.items():
        (root / path).parent.mkdir(parents=True, exist_ok=True)
        (root / path).write_text(text)
    (root / "usr/local/bin").mkdir(parents=True)
    for folder in ("etc/modules-load.d", "etc/systemd/system", "opt", "var/lib"):
        (root / folder).mkdir(parents=True)
    return root


@pytest.fixture
def wheels(tmp_path):
    """Return a bundle: pip as Python ships it, and one wheel with a command."""
    folder = tmp_path / "bundle"
    folder.mkdir()
    places = (Path(ensurepip.__file__).parent / "_bundled", Path("/usr/share/python-wheels"))
    pip = next((wheel for place in places for wheel in place.glob("pip-*.whl")), None)
    if pip is None:
        pytest.skip("this Python brings no wheel of pip: sudo apt-get install python3-venv")
    shutil.copy(pip, folder)
    with zipfile.ZipFile(folder / "baqueano-0.0.1-py3-none-any.whl", "w") as wheel:
        info = "baqueano-0.0.1.dist-info"
        wheel.writestr("baqueano.py", "def main():\n    print('here I am')\n")
        wheel.writestr(f"{info}/METADATA", "Metadata-Version: 2.1\nName: baqueano\nVersion: 0.0.1\n")
        wheel.writestr(f"{info}/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n")
        wheel.writestr(f"{info}/entry_points.txt", "[console_scripts]\nbaqueano = baqueano:main\n")
        wheel.writestr(f"{info}/RECORD", "")
    for name in ("pip", "baqueano"):
        (path,) = folder.glob(f"{name}-*.whl")
        line = f"{name}=={path.name.split('-')[1]} --hash=sha256:{hashlib.sha256(path.read_bytes()).hexdigest()}\n"
        (folder / f"{'pip' if name == 'pip' else 'packages'}.lock").write_text(line)
    for name in ("files/baqueano.service", "files/60-baqueano.rules"):
        shutil.copy(str(files("baqueano.robot") / name), folder)
    (folder / "steps.py").write_text(install.translated_steps())
    (folder / "vehicle.toml").write_text("# mine\n")
    return folder
