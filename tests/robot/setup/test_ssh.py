"""A HOST cannot be an option of ssh, and its output cannot send control codes to this terminal."""

import pytest

from baqueano.door import remote, ssh
from baqueano.errors import RobotUnreachable, UsageError
from baqueano.robot.setup import deployed_vehicle_file, install
from baqueano.robot.workshop import exclusive_hardware
from tests.codes import refused

OPTIONS = [
    "-oProxyCommand=touch pwned",
    "-F/tmp/x",
    "me@-oProxyCommand=x",
    "-",
    "",
    "me@",
    "-x:22",
    "a b",
    "r1\n-x",
    "[-x]:22",
]


@pytest.mark.parametrize("host", OPTIONS)
def test_a_host_that_would_be_an_option_is_refused(programs, host):
    calls = programs(ssh="exit 0")
    for go in (
        lambda: exclusive_hardware.fetch_rows(host, "robot", "doctor"),
        lambda: install.host_machine(host),
    ):
        with refused("ssh.host", UsageError):
            go()
    with refused("ssh.host", UsageError), remote.connect(host):
        pass
    assert not calls.exists() or not calls.read_text()


@pytest.mark.parametrize(
    ("host", "words"),
    [
        ("me@r1", "-- me@r1"),
        ("me@r1:2222", "-p 2222 -- me@r1"),
        ("r1", "-- r1"),
        ("me@fe80::1", "-- me@fe80::1"),
        ("2001:db8::5", "-- 2001:db8::5"),
        ("me@[fe80::1%wlan0]:22", "-p 22 -- me@fe80::1%wlan0"),
        ("COMPUTER", "-- COMPUTER"),
    ],
)
def test_ssh_commands_have_a_double_dash_before_the_host(host, words):
    assert f" {words} true" in " ".join(ssh.ssh_command(host, "true"))
    assert f" {words} exec baqueano" in " ".join(remote._attach_command(host))


def test_an_advised_ssh_command_has_its_port_as_an_option(programs):
    programs(ssh="exit 255")
    with refused("setup.no-answer", RobotUnreachable) as error_info:
        install.host_machine("me@r1:2222")
    assert error_info.value.diagnostic.fix == "ssh -p 2222 me@r1"


@pytest.mark.parametrize(
    "go",
    [
        lambda: exclusive_hardware.fetch_rows("r1", "robot", "doctor"),
        lambda: install.host_machine("r1"),
        lambda: install.remove("r1", install.TargetMachine((3, 11), "aarch64", "pi")),
        lambda: deployed_vehicle_file.renew_file("r1", None),
    ],
)
def test_ssh_output_cannot_send_terminal_control_codes(programs, capfd, go):
    programs(ssh=r"printf 'why: \033]0;pwned\007 \342\200\256 \302\233 end\n' >&2; exit 3")
    with pytest.raises(Exception, match="r1"):
        go()
    output = capfd.readouterr().err
    assert r"why: \x1b]0;pwned\x07 \u202e \x9b end" in output
    assert "\x1b" not in output


def test_setup_steps_are_printed_without_terminal_control_codes(programs, capfd):
    programs(ssh=r"printf 'done \033[2J step\r\n[sudo] password: '; exit 0")
    install._run_steps("r1", ["do"], as_root=True)
    assert capfd.readouterr().out == "done \\x1b[2J step\n[sudo] password: "


def test_an_endless_ssh_answer_is_refused(programs, monkeypatch):
    monkeypatch.setattr(ssh, "MAX_ANSWER_BYTES", 1 << 20)
    programs(ssh="yes")
    for go in (
        lambda: exclusive_hardware.fetch_rows("r1", "robot", "doctor"),
        lambda: install.host_machine("r1"),
    ):
        with refused("ssh.too-much", RobotUnreachable, max_mb=1):
            go()


def test_ne7_data_sent_over_ssh_arrive_unchanged(programs, tmp_path):
    programs(ssh=f"cat >{tmp_path / 'came'}; exit 7")
    data = bytes(range(256)) * 4096
    assert ssh.run_command(ssh.ssh_command("r1", "x"), data) == (b"", 7)
    assert (tmp_path / "came").read_bytes() == data
