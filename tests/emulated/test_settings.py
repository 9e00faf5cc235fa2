"""Settings of a vehicle survive resets, and damaged or out-of-range settings are not used (R15, R19)."""

import random

import pytest

from baqueano.robot.uno import codec, frames
from baqueano.robot.uno.frames import (
    AskSettings,
    Config,
    Drive,
    Driver,
    EncoderKind,
    Info,
    ResetCause,
    Settings,
    StateFlag,
    WheelCurve,
    Wiring,
)

OURS = Settings(
    Wiring.LEFT_MOTOR_REVERSED | Wiring.ENCODERS_SWAPPED,
    Driver.TB6612,
    EncoderKind.QUADRATURE,
    kick_ms=20,
    dither_permille=30,
    dither_ms=7,
    battery_permille=3127,
    curves=(
        WheelCurve(110, 900, 500),
        WheelCurve(120, 910, 510),
        WheelCurve(130, 920, 520),
        WheelCurve(140, 930, 530),
    ),
)
AT_SETTINGS, STORED = 8, 35


def settings_of(uno):
    uno.run(0.02)
    uno.frames()
    uno.send(AskSettings())
    return uno.next_frame(Settings, 0.1)


def store(uno, settings=OURS):
    uno.send(settings)
    assert uno.next_frame(Settings, 0.5) == settings


def unchecked(frame, seq=1):
    """Return the bytes of a frame whose numbers the codec would refuse."""
    return codec.encode_frame(frames.LAYOUT_KINDS[type(frame)], seq, frames.pack(frame))


def test_r15_an_uno_without_settings_uses_factory_settings_and_sets_a_flag(uno):
    assert settings_of(uno) == Settings()
    assert uno.state().flags & StateFlag.FACTORY


@pytest.mark.parametrize("end_by", ["reset", "power", "another part with the same EEPROM"])
def test_r15_settings_survive_resets(uno, new_uno, end_by):
    store(uno)
    assert not uno.state().flags & StateFlag.FACTORY
    if end_by == "reset":
        uno.reset(ResetCause.EXTERNAL)
        uno.run(0.02)
    elif end_by == "power":
        uno.power_cycle()
        uno.run(0.02)
    else:
        uno = new_uno(eeprom=uno.eeprom())
    assert settings_of(uno) == OURS
    assert not uno.state().flags & StateFlag.FACTORY


def test_r15_settings_are_confirmed_only_after_verification(uno):
    """At most one byte is stored per millisecond, so 35 bytes are not confirmed within 35 ms."""
    sent_s = uno.send(OURS)
    uno.next_frame(Settings, 0.5)
    assert uno.t_s - sent_s >= 0.035
    assert uno.eeprom()[AT_SETTINGS + 1 : AT_SETTINGS + 33] == frames.pack(OURS)


def test_r15_telemetry_and_stop_work_while_settings_are_stored(uno):
    uno.run(0.05)
    uno.frames()
    uno.send(OURS)
    uno.run(0.1)
    assert len([f for f in uno.frames() if isinstance(f, frames.State)]) >= 9


def test_r15_settings_are_refused_while_armed(uno):
    uno.hold(300, 300, 0.1)
    uno.send(OURS)
    uno.drive(300, 300)
    uno.run(0.2)
    assert settings_of(uno) == Settings()
    assert uno.info().not_armed == 1


@pytest.mark.parametrize("place", [0, 1, 17, 32, 33, 34])
def test_r15_a_damaged_byte_in_eeprom_invalidates_all_settings(new_uno, uno, place):
    store(uno)
    eeprom = bytearray(uno.eeprom())
    eeprom[AT_SETTINGS + place] ^= 0x10
    second = new_uno(eeprom=bytes(eeprom))
    assert settings_of(second) == Settings()
    assert second.state().flags & StateFlag.FACTORY


def test_r15_settings_of_an_interrupted_write_are_not_used(uno, new_uno):
    """The write is cut after every few bytes: nothing was begun, or the checksum is wrong, or all is stored."""
    first = OURS._replace(kick_ms=99, battery_permille=2999)
    store(uno, first)
    before = uno.eeprom()
    outcomes = set()
    for cut_ms in range(0, 160, 12):
        second = new_uno(eeprom=before)
        sent_s = second.send(OURS)
        second.run_until(sent_s + cut_ms * 1e-3)
        second.power_cycle()
        second.run(0.02)
        settings = settings_of(second)
        factory = bool(second.state().flags & StateFlag.FACTORY)
        assert (settings, factory) in [(first, False), (Settings(), True), (OURS, False)], (
            f"cut after {cut_ms} ms"
        )
        outcomes.add((settings == OURS, factory))
    assert outcomes >= {(False, True), (True, False)}


def test_r19_configurations_at_their_limits_are_accepted(uno):
    for is_least in (True, False):
        numbers = [
            field.value_range.low if is_least else field.value_range.high
            for field in frames.LAYOUT_FIELDS[Config]
        ]
        config = Config(*numbers)._replace(pwm_hz=50 if is_least else 20_000)
        uno.send(config)
        assert uno.info().config == config


@pytest.mark.parametrize(
    ("name", "value"),
    [
        (f.path, v)
        for f in frames.LAYOUT_FIELDS[Config]
        for v in (f.value_range.low - 1, f.value_range.high + 1)
        if 0 <= v <= 255
    ]
    + [
        ("dead_man_ms", 1001),
        ("slew_permille_per_ms", 1001),
        ("pwm_hz", 25_001),
        ("least_battery_mv", 20_001),
    ],
)
def test_r19_a_configuration_out_of_range_is_refused_as_a_whole(uno, name, value):
    uno.write(unchecked(Config(telemetry_ms=20)._replace(**{name: value})))
    info = uno.info()
    assert info.config == Config()
    assert info.out_of_range == 1


def test_r19_settings_out_of_range_are_refused_as_a_whole(uno):
    flat = frames.flat_values(OURS)
    errors = 0
    for place, field in enumerate(frames.LAYOUT_FIELDS[Settings]):
        for value in (field.value_range.low - 1, field.value_range.high + 1):
            if frames.integer_range(field.code).low <= value <= frames.integer_range(field.code).high:
                uno.write(unchecked(frames.unflatten(Settings, [*flat[:place], value, *flat[place + 1 :]])))
                uno.run(0.01)
                errors += 1
    assert errors > 20
    assert settings_of(uno) == Settings()
    assert uno.info().out_of_range == errors
    assert uno.eeprom()[AT_SETTINGS:] == b"\xff" * (1024 - AT_SETTINGS)


@pytest.mark.parametrize(
    ("left", "right", "flags"),
    [
        (1001, 0, 1),
        (0, -1001, 1),
        (32767, 0, 1),
        (-32768, -32768, 1),
        (0, 0, 8),
        (500, 500, 1 | 4),
        (500, 0, 2),
    ],
)
def test_r19_fw4_a_command_out_of_range_changes_nothing(uno, left, right, flags):
    uno.hold(200, 200, 0.1)
    uno.write(unchecked(Drive(uno.nonce(), left, right, flags), seq=uno.seq + 1))
    uno.run(0.05)
    assert uno.duty(0) == uno.duty(1) == pytest.approx(0.2)
    assert uno.info().out_of_range == 1


def test_r15_settings_can_be_stored_thousands_of_times(uno):
    """Bytes that do not change are not written: boots and settings wear only the cells that differ."""
    chance = random.Random(4)
    for _ in range(5):
        settings = OURS._replace(kick_ms=chance.randint(0, 100))
        store(uno, settings)
        uno.reset(ResetCause.EXTERNAL)
        assert uno.next_frame(Info, 0.1).boots
        assert settings_of(uno) == settings
