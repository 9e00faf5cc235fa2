"""`baqueano robot card`: the files on the boot partition, and the effect of its script on a folder that replaces the
Pi."""

import configparser
import ctypes
import ctypes.util
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from baqueano.cli import main
from baqueano.errors import FileError, UsageError
from baqueano.robot.setup import card
from baqueano.robot.setup.card import Network, boot_partition, connection_file, public_key, write_card
from tests.codes import refused

KEY = "ssh-ed25519 AAAAC3NzaC1lZDI1NTE5AAAAIG ana's laptop"
CMDLINE = "console=tty1 root=PARTUUID=1 rootwait init=/usr/lib/raspberrypi-sys-mods/firstboot\n"
PROGRAMS = ("hostname", "id", "chown", "systemctl", "raspi-config", "rfkill", "nmcli", "useradd")


@pytest.fixture
def pi(tmp_path):
    root = tmp_path / "pi"
    for path, text in {
        "boot/firmware/cmdline.txt": CMDLINE, "boot/firmware/config.txt": "", "etc/hostname": "raspberrypi\n",
        "etc/hosts": "127.0.0.1\tlocalhost\n127.0.1.1\traspberrypi\n", "etc/sudoers.d/README": "",
    }.items():  # fmt: skip
        (root / path).parent.mkdir(parents=True, exist_ok=True)
        (root / path).write_text(text)
    return root


def start(pi, tmp_path):
    """Run the script as the Pi would and return its calls."""
    programs = tmp_path / "bin"
    programs.mkdir()
    for name in PROGRAMS:
        (programs / name).write_text(f'#!/bin/sh\necho "{name} $*" >>{tmp_path}/calls\n')
        (programs / name).chmod(0o755)
    path = {"PATH": f"{programs}:/usr/bin:/bin", "R": str(pi)}
    subprocess.run([shutil.which("bash") or "bash", pi / "boot/firmware/firstrun.sh"], env=path, check=True)
    return (tmp_path / "calls").read_text()


@pytest.mark.parametrize("own", [False, True])
def test_the_first_start_sets_name_key_and_network_of_the_pi(pi, tmp_path, own):
    boot = pi / "boot/firmware"
    output = write_card(boot, "robot-7", "ana", KEY, Network("it's; a $HOME lab", "p'ss w;rd\\1", "AR", own))
    assert "ana@robot-7.local" in output[0]
    line = (boot / "cmdline.txt").read_text()
    assert line.count("\n") == 1
    assert line.startswith(CMDLINE.strip())
    assert "cfg80211.ieee80211_regdom=AR systemd.run=/boot/firmware/firstrun.sh" in line
    calls = start(pi, tmp_path)
    assert (pi / "etc/hostname").read_text() == "robot-7\n"
    assert "127.0.1.1\trobot-7\n" in (pi / "etc/hosts").read_text()
    keys = pi / "home/ana/.ssh/authorized_keys"
    assert keys.read_text() == KEY + "\n"
    assert keys.stat().st_mode & 0o777 == 0o600
    assert (pi / "etc/sudoers.d/010_baqueano").read_text() == "ana ALL=(ALL) NOPASSWD: ALL\n"
    assert "systemctl enable ssh" in calls
    assert "raspi-config nonint do_wifi_country AR" in calls
    connection = pi / "etc/NetworkManager/system-connections/baqueano.nmconnection"
    assert connection.stat().st_mode & 0o777 == 0o600
    config = configparser.RawConfigParser()
    config.read(connection)
    assert config["wifi"]["ssid"] == "it's\\; a $HOME lab"
    assert config["wifi-security"]["psk"] == "p'ss w;rd\\\\1"
    assert config["wifi"]["mode"] == ("ap" if own else "infrastructure")
    assert config["ipv4"]["method"] == ("shared" if own else "auto")
    assert not (boot / "firstrun.sh").exists()
    log = (boot / "firstrun.log").read_text()
    assert "authorized_keys" in log
    assert "ss w" not in log
    assert "systemd." not in (boot / "cmdline.txt").read_text()


@pytest.mark.skipif(not ctypes.util.find_library("glib-2.0"), reason="GLib is not installed")
@pytest.mark.parametrize("password", ["ab;cd;;ef", "  leading\\s", "trailing ", "#=[];abc"])
def test_glib_reads_the_password_as_it_was_typed(password):
    glib = ctypes.CDLL(ctypes.util.find_library("glib-2.0"))
    new, get, load = glib.g_key_file_new, glib.g_key_file_get_string, glib.g_key_file_load_from_data
    new.restype, get.restype = ctypes.c_void_p, ctypes.c_char_p
    get.argtypes = [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_char_p, ctypes.c_void_p]
    load.argtypes = [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_size_t, ctypes.c_int, ctypes.c_void_p]
    text, file = connection_file(Network("lab", password, "AR"), "r1").encode(), new()
    assert load(file, text, len(text), 0, None)
    assert get(file, b"wifi-security", b"psk", None).decode() == password


def test_the_boot_files_have_lines_of_unix_even_from_windows(pi, monkeypatch):
    def write_text(path, data, encoding=None, errors=None, newline=None):
        path.write_bytes(data.replace("\n", "\r\n" if newline is None else newline).encode())

    monkeypatch.setattr(Path, "write_text", write_text)
    boot = pi / "boot/firmware"
    for user_data in (False, True):
        if user_data:
            (boot / "user-data").write_bytes(b"")
        write_card(boot, "robot-7", "ana", KEY, Network("lab", "password", "AR"))
        assert not [path.name for path in boot.iterdir() if b"\r" in path.read_bytes()]


def test_a_value_that_contains_a_placeholder_is_not_changed(pi, tmp_path):
    key = f"{KEY} me@country@lab"
    write_card(pi / "boot/firmware", "robot-7", "ana", key, Network("@country@", "@connection@", "AR"))
    start(pi, tmp_path)
    assert (pi / "home/ana/.ssh/authorized_keys").read_text() == f"{key}\n"
    connection = pi / "etc/NetworkManager/system-connections/baqueano.nmconnection"
    assert "ssid=@country@\n" in connection.read_text()


def test_cloud_init_starts_the_script_and_old_user_data_are_backed_up(pi):
    boot = pi / "boot/firmware"
    (boot / "user-data").write_text("#cloud-config\n# of the image\n")
    for _ in range(2):
        output = write_card(boot, "robot-7", "ana", KEY, None)
    assert "cloud-init" in output[1]
    assert "bash /boot/firmware/firstrun.sh" in (boot / "user-data").read_text()
    assert "of the image" in (boot / "user-data.before").read_text()
    assert (boot / "cmdline.txt").read_text() == CMDLINE


def test_writing_a_card_twice_starts_the_script_only_once(pi):
    boot = pi / "boot/firmware"
    for country in ("DE", "AR"):
        write_card(boot, "robot-7", "ana", KEY, Network("lab", "password", country))
    line = (boot / "cmdline.txt").read_text()
    assert line.count("systemd.run=") == 1
    assert line.count("regdom=") == 1
    assert "regdom=AR" in line


def test_a_card_without_a_network_stores_no_network(pi, tmp_path):
    write_card(pi / "boot/firmware", "robot-7", "ana", KEY, None)
    assert "rfkill" not in start(pi, tmp_path)
    assert not (pi / "etc/NetworkManager").exists()


@pytest.mark.parametrize(
    ("name", "user", "network", "match"),
    [
        ("Robot 1", "ana", None, ("card.name", {"name": "Robot 1"})),
        ("r1", "root", None, ("card.user", {"user": "root"})),
        ("r1", "ana", Network("x" * 33, "password", "AR"), ("card.network-name", {"bytes": 33})),
        ("r1", "ana", Network("lab", "short", "AR"), ("card.network-password", {"letters": 5})),
        ("r1", "ana", Network("lab", "password", "ar"), ("card.country", {"country": "ar"})),
    ],
)
def test_invalid_card_settings_are_refused_before_writing(pi, name, user, network, match):
    with refused(match[0], UsageError, **match[1]):
        write_card(pi / "boot/firmware", name, user, KEY, network)
    assert not (pi / "boot/firmware/firstrun.sh").exists()


def test_a_folder_that_is_not_a_card_is_reported(tmp_path, monkeypatch):
    with refused("card.no-boot", FileError):
        boot_partition(tmp_path)
    monkeypatch.setattr(card, "BOOT_FOLDERS", (str(tmp_path / "*" / "bootfs"),))
    with refused("card.cards", FileError, cards=0):
        boot_partition(None)
    for user in ("a", "b"):
        (tmp_path / user / "bootfs").mkdir(parents=True)
    with refused("card.cards", FileError, cards=2):
        boot_partition(None)


def test_a_missing_or_private_key_is_reported(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    with refused("card.no-key", FileError):
        public_key(None)
    private = tmp_path / "id"
    private.write_text("-----BEGIN OPENSSH PRIVATE KEY-----\nb3BlbnNz\n")
    with refused("card.no-public-key", FileError):
        public_key(private)


def test_the_card_command_generates_a_password_and_prints_the_next_step(pi, tmp_path, capsys):
    key = tmp_path / "key.pub"
    key.write_text(KEY + "\n")
    boot = str(pi / "boot/firmware")
    with pytest.raises(SystemExit) as exit_info:
        main(["robot", "card", boot, "--key", str(key), "--own-network", "--country", "AR"])
    assert exit_info.value.code == 0
    output = capsys.readouterr().out
    assert re.search(
        r"its Wi-Fi network: (robot-[0-9a-f]{4}), password [a-z2-9]{10}; its address there is 10\.42\.0\.1",
        output,
    )
    assert re.search(r"baqueano robot setup pilot@robot-[0-9a-f]{4}\.local", output)
    with pytest.raises(SystemExit) as exit_info:
        main(["robot", "card", boot, "--key", str(key), "--own-network", "--wifi", "lab"])
    assert exit_info.value.code == 2
    assert "a Pi has one radio" in capsys.readouterr().err
