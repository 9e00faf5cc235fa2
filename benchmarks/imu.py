"""Measure the cost of the IMU's driver and its recovery, on the emulated chip: `python -m benchmarks.imu [--smallest]`.

The CPU time of a call is of this machine. It does not include the transfer by the kernel, which returns prepared
numbers. All other figures are in the time of the emulated bench, at 400 kHz with a call each 10 ms. They are the same
on every machine.
"""

import argparse
import ctypes
import tempfile
import time
from pathlib import Path

import numpy as np

from tests.emulated.i2c_ioctl import Bench, start

CALLS, MOMENTS, STAMPS_S = 4000, 12, 20.0


class Patch:
    """A replacement for pytest's monkeypatch outside a test."""

    def setattr(self, place, name, value) -> None:
        setattr(place, name, value)


def bench(ppm: float = 8000.0, **settings):
    """Return an emulated bench, and an IMU that has run for 1 s on it."""
    b = Bench(Patch(), Path(tempfile.mkdtemp()), clock_ppm=ppm)
    device = start(b, **settings)
    drive(b, device, 1.0)
    return b, device


def drive(b, device, seconds: float, is_over=lambda samples, events: False):
    """Call the device each 10 ms; return the samples with the times of their calls, events, and longest call [ns]."""
    samples, events, longest, due = [], [], 0, b.clock.now
    end = b.clock.now + seconds * 1e9
    while due < end and not is_over(samples, events):
        due += 10_000_000
        b.clock.now = call_ns = max(b.clock.now, due)
        samples += [(call_ns, sample) for sample in device.read()]
        longest = max(longest, b.clock.now - call_ns)
        events += device.events()
    return samples, events, longest


def cost(calls: int) -> np.ndarray:
    """Return the CPU time [µs] of calls that find two new samples, sorted."""
    import smbus2.smbus2

    b, device = bench()
    drive(b, device, 11.0)
    rng = np.random.default_rng(0)
    blocks = [rng.integers(-3000, 3000, 14).astype(">i2").tobytes() for _ in range(64)]
    registers = {0x19: bytes(device._registers()), 0x6A: bytes([0x40, 1]), 0x72: bytes([0, 28])}
    turn = 0

    def ioctl(fd, request, arg):
        nonlocal turn
        register, out = arg.msgs[0].buf[0][0], arg.msgs[1]
        turn += 1
        data = registers.get(register, (b"\x01" if register == 0x3A else b"") + blocks[turn % 64])
        ctypes.memmove(out.buf, data, out.len)

    smbus2.smbus2.ioctl = ioctl
    began, durations = b.clock.now, []
    for n in range(calls):
        b.clock.now = int(began + (n + 1) * 2 * device.clock.period_ns)
        before = time.thread_time_ns()
        samples = device.read()
        durations.append(time.thread_time_ns() - before)
        assert len(samples) == 2
    return np.sort(durations) / 1e3


def recoveries(moments: int) -> None:
    """Print the recovery from each fault of the bus or the chip."""
    waits = []
    for moment in np.linspace(0.05, 1.0, moments):
        b, device = bench()
        drive(b, device, moment)
        began = b.clock.now
        b.chip.brown_out()
        samples, _, _ = drive(
            b, device, 2.0, lambda s, e: s and [x for x in e if x.message.code == "imu.started"]
        )
        waits.append((samples[-1][0] - began) / 1e6)
    print(f"brown-out: good samples again after {min(waits):.0f}-{max(waits):.0f} ms ({moments} moments)")
    b, device = bench()
    began = b.clock.now
    b.bus.fail(121, 6)
    samples, _, _ = drive(b, device, 1.0)
    print(f"three failed calls: samples again after {(samples[0][0] - began) / 1e6:.0f} ms")
    b, device = bench()
    began, b.bus.sda_low = b.clock.now, True
    _, events, longest = drive(b, device, 3.0)
    events_text = ", ".join(f"{e.message.code} {(e.t_ns - began) / 1e9:.2f} s" for e in events)
    began, b.bus.sda_low = b.clock.now, False
    samples, _, _ = drive(b, device, 1.0)
    print(
        f"bus held: longest call {longest / 1e6:.1f} ms; {events_text}; freed, "
        f"back {(samples[0][0] - began) / 1e6:.0f} ms"
    )
    b, device = bench()
    began = b.clock.now
    b.chip.freeze()
    samples, events, _ = drive(b, device, 1.2)
    events_text = ", ".join(f"{e.message.code} {(e.t_ns - began) / 1e9:.2f} s" for e in events)
    print(f"frozen: {len(samples)} samples believed; {events_text}")


def stamps(duration_s: float) -> None:
    """Print the errors of the timestamps against the sampling times of the chip."""
    for ppm in (-40_000, 8_000, 40_000):
        b = Bench(Patch(), Path(tempfile.mkdtemp()), clock_ppm=ppm)
        device = start(b)
        samples, _, longest = drive(b, device, duration_s)
        sample_times = np.array(b.chip.taken)
        error = (
            np.array([sample_times[np.argmin(np.abs(sample_times - s.t_ns))] - s.t_ns for _, s in samples])
            / 1e3
        )
        rate = device.rate_hz / (200.0 * (1.0 + ppm * 1e-6)) - 1.0
        parts = []
        for first, last in ((0, 1), (1, 2), (2, round(duration_s))):
            part = error[round(first / duration_s * len(error)) : round(last / duration_s * len(error))]
            parts.append(
                f"{first}-{last} s mean {part.mean():+.0f} std {part.std():.0f} max {np.abs(part).max():.0f}"
            )
        print(f"clock {ppm:+d} ppm: rate to {rate * 1e6:+.1f} ppm; stamps [µs] {'; '.join(parts)}", end="; ")
        print(f"longest call {longest / 1e6:.2f} ms")


def main() -> None:
    """Print the cost, the errors of the timestamps, and the recovery from faults."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--smallest", action="store_true", help="few calls and moments: that it runs")
    calls, moments, stamps_s = (100, 2, 4.0) if parser.parse_args().smallest else (CALLS, MOMENTS, STAMPS_S)
    cost_us = cost(calls)
    print(f"CPU of a call: median {cost_us[calls // 2]:.0f} µs, 99 % {cost_us[calls * 99 // 100]:.0f} µs")
    stamps(stamps_s)
    recoveries(moments)


if __name__ == "__main__":
    main()
