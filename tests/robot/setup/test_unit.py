"""The unit of the onboard service: real-time, and without rights that a foreign block could use to harm the
computer.
"""

import configparser
import re
import shutil
import subprocess
from pathlib import Path

import pytest

import baqueano.robot

UNIT = Path(baqueano.robot.__file__).parent / "files/baqueano.service"
EXPOSURE = 3.0  # of 10, by systemd-analyze


class MultiDict(dict):
    """A dict that retains all values of a repeated key."""

    def __setitem__(self, key, value):
        if isinstance(value, list) and key in self:
            self[key].extend(value)
        else:
            super().__setitem__(key, value)


@pytest.fixture
def service():
    parser = configparser.RawConfigParser(dict_type=MultiDict, strict=False, empty_lines_in_values=False)
    parser.optionxform = str
    parser.read_string(UNIT.read_text())
    return parser["Service"]


def test_the_unit_has_real_time_priority_watchdog_and_restart(service):
    expected = {
        "Type": "notify", "WatchdogSec": "2", "Restart": "always", "RestartSec": "2", "CPUSchedulingPolicy": "fifo",
        "CPUSchedulingPriority": "40", "LimitMEMLOCK": "infinity", "RuntimeDirectory": "baqueano",
        "StateDirectory": "baqueano",
    }  # fmt: skip
    assert expected.items() <= dict(service).items()
    assert int(service["LimitRTPRIO"]) >= 40
    assert "RestrictRealtime" not in service
    assert "StartLimitIntervalSec=0" in UNIT.read_text().splitlines()  # of its section Unit


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("NoNewPrivileges", "yes"),
        ("CapabilityBoundingSet", ""),
        ("ProtectSystem", "strict"),
        ("ProtectHome", "yes"),
        ("PrivateNetwork", "yes"),
        ("RestrictAddressFamilies", "AF_UNIX"),
        ("DevicePolicy", "closed"),
    ],
)
def test_the_unit_isolates_blocks_from_network_and_system(service, key, value):
    assert service[key] == value


def test_the_unit_writes_only_to_folders_made_by_systemd(service):
    assert service["StateDirectory"] == service["RuntimeDirectory"] == service["CacheDirectory"] == "baqueano"
    start = service["ExecStart"]
    paths = re.findall(r"--(?:vehicle|runs|door) (\S+)", start)
    assert all(path.startswith(("/var/lib/baqueano/", "/run/baqueano/")) for path in paths)
    assert len(paths) == 3
    assert "XDG_CACHE_HOME=/var/cache/baqueano" in service["Environment"]


def test_the_unit_allows_the_devices_of_the_drivers(service):
    devices = service["DeviceAllow"]
    assert all(name in devices for name in ("char-ttyACM", "char-ttyUSB", "char-i2c", "/dev/gpiomem"))


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="this system has no systemd-analyze")
def test_systemd_rates_the_unit_as_hardened(tmp_path):
    unit = tmp_path / "baqueano.service"
    unit.write_text(UNIT.read_text().replace("@user@", "pilot").replace("@groups@", "dialout i2c"))
    process = subprocess.run(
        ["systemd-analyze", "security", "--offline=true", "--no-pager", str(unit)],
        capture_output=True, text=True, env={"LC_ALL": "C.UTF-8", "PATH": "/usr/bin:/bin"},
    )  # fmt: skip
    exposure = re.search(r"Overall exposure level for \S+: ([\d.]+)", process.stdout)
    if exposure is None:
        pytest.skip("this systemd-analyze judges no file")
    assert float(exposure[1]) <= EXPOSURE
