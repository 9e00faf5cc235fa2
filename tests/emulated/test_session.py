"""The permission to drive: the nonce of this boot, and only commands newer than the last executed one (R16, R17,
R26).
"""

import itertools
import random

import pytest

from baqueano.robot.uno.frames import PROTOCOL, VERSION, Config, Drive, DriveFlag, Info, ResetCause, State

ARM = DriveFlag.ARM


def test_r16_each_boot_has_a_new_nonce(uno):
    nonces = [uno.info().nonce]
    for k in range(20):
        if k % 2:
            uno.reset(ResetCause.EXTERNAL)
        else:
            uno.power_cycle(k)
        nonces.append(uno.next_frame(Info, 0.1).nonce)
        uno.frames()
    assert all(a != b for a, b in itertools.pairwise(nonces))
    assert len(set(nonces)) == len(nonces)


def test_r16_an_interrupted_boot_does_not_repeat_an_old_nonce(uno):
    """Resets at every moment of the first 20 ms: a nonce that was sent is never sent again."""
    chance = random.Random(5)
    nonces = [uno.info().nonce]
    for _ in range(40):
        uno.reset(ResetCause.BROWN_OUT)
        uno.run(chance.uniform(0, 0.02))
        nonces += [f.nonce for f in uno.frames() if isinstance(f, State | Info)][-1:]
    uno.reset(ResetCause.BROWN_OUT)
    last = uno.next_frame(Info, 0.1).nonce
    assert last not in nonces
    assert sorted(nonces) == nonces


def test_r16_fw4_a_command_with_another_nonce_is_counted_and_ignored(uno):
    uno.hold(300, 300, 0.1)
    for nonce in range(1, 256, 5):
        uno.send(Drive((uno.nonce() + nonce) & 0xFF, 900, 900, ARM))
        uno.run(0.003)
    assert uno.duty(0) == pytest.approx(0.3)
    state = uno.state()
    assert state.ignored_frames == uno.info().wrong_nonce == 51


def test_r16_a_command_with_another_nonce_does_not_reset_the_command_timeout(uno):
    uno.hold(300, 300, 0.1)
    last = uno.t_s
    while uno.t_s < last + 0.32:
        uno.send(Drive((uno.nonce() + 1) & 0xFF, 300, 300, ARM))
        uno.run(0.01)
    assert not uno.moving


def test_r17_fw5_a_repeated_command_does_not_reset_the_command_timeout(uno):
    uno.hold(300, 300, 0.1)
    old_seq = uno.seq
    last = uno.t_s
    while uno.t_s < last + 0.32:
        uno.drive(300, 300, seq=old_seq)
        uno.run(0.01)
    assert not uno.moving
    assert uno.info().old_sequence >= 30


@pytest.mark.parametrize(
    ("step", "is_obeyed"), [(1, True), (127, True), (128, False), (255, False), (0, False)]
)
def test_r17_a_newer_sequence_number_is_1_to_127_ahead(uno, step, is_obeyed):
    for start in (0, 100, 200, 255):
        uno.arm()
        uno.seq = uno.state().drive_seq
        while uno.seq != start:
            uno.seq = (uno.seq + min((start - uno.seq) & 0xFF, 100)) & 0xFF
            uno.run_until(uno.drive(0, 0, seq=uno.seq) + 2e-3)
        uno.drive(400, 400, seq=start + step)
        uno.run(0.03)
        assert uno.moving == is_obeyed
        uno.seq = uno.state().drive_seq
        uno.drive(0, 0)
        uno.run(0.05)


def test_r17_fw5_the_newest_of_commands_out_of_order_is_executed(uno):
    chance = random.Random(6)
    uno.arm()
    last_seq = uno.seq
    for _ in range(60):
        batch = [(last_seq + k, 100 + 10 * k) for k in range(1, 5)]
        last_seq += 4
        chance.shuffle(batch)
        for seq, duty in batch + batch[:2]:
            uno.drive(duty, duty, seq=seq)
        uno.run(0.02)
        assert uno.duty(0) == pytest.approx(0.14), batch
    assert uno.state().drive_seq == last_seq & 0xFF


@pytest.mark.parametrize("count_lost", [0, 126, 127, 200, 254, 255, 1000])
def test_r17_within_129_commands_after_any_loss_a_command_is_executed(uno, count_lost):
    """A sequence number of eight bits has this cost: after a gap of 127 to 255 commands the next commands look old."""
    uno.arm()
    uno.seq += count_lost
    refusals = -1
    while not uno.moving:
        uno.run_until(uno.drive(300, 300) + 2e-3)
        refusals += 1
        assert refusals <= 129
    assert (refusals == 0) == (count_lost % 256 < 127)


def test_r26_fw3_info_contains_version_configuration_and_reset_cause(uno):
    uno.run(0.02)
    first = [f for f in uno.frames() if isinstance(f, Info)]
    assert len(first) == 1, "sent once at boot, without a request"
    info = uno.info()
    assert (info.protocol, info.version_major, info.version_minor, info.version_patch) == (PROTOCOL, *VERSION)
    assert info.config == Config()
    assert info.reset_cause == ResetCause.POWER
    config = Config(500, 20, 100, 1000, 6000)
    uno.send(config)
    assert uno.next_frame(Info).config == config
    uno.reset(ResetCause.EXTERNAL)
    assert uno.next_frame(Info, 0.1).config == Config(), "a configuration is that of a session"
