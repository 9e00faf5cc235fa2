"""Print what the package promises, the tests of each promise, and their results: `make promises`.

The name of a test begins with the numbers of its promises: `test_r4_fw1_…` tests R4 and FW-1. R1 to R29 are the
requirements of firmware/uno/README.md. A row states the figure that its tests check, and the original aim if that
was different.
"""

import re
import sys
import textwrap
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
TEST = re.compile(r"^(?:async )?def (test_((?:(?:fw|rt|es|id|lg|fi|ne|su|r)\d+_)+)\w+)\(", re.MULTILINE)
WORDS = {
    "FW-1": "the motors are off 320 ms after the last new command (the aim is 260)",
    "FW-2": "the motors are off 150 ms after the firmware hangs",
    "FW-3": "the firmware starts disarmed, with the motors off, and reports the cause of its start",
    "FW-4": "a command is obeyed only with its nonce, a newer number, two correct checksums and values in range",
    "FW-5": "frames that are repeated, late or out of order do not move a motor",
    "FW-6": "after damaged bytes the next frame is read",
    "FW-7": "a reset of the Uno ends the drive; only a person can start it again",
    "FW-8": "a low battery disarms the vehicle and keeps it disarmed; its voltage is reported",
    "RT-1": "missed ticks are skipped and counted; they are not computed later",
    "RT-2": "a computer that stalls or is overloaded stops the drive",
    "RT-3": "a block that raises an exception stops the vehicle and is named; the run is complete",
    "RT-4": "a command that is not finite, or exceeds its limits, does not reach the motors",
    "RT-5": "the vehicle stops when the program is killed",
    "RT-6": "the drive continues for half a second without IMU; after that the vehicle stops",
    "RT-7": "repeated readings of an IMU are excluded; an IMU at rest is not excluded",
    "RT-8": "readings at the end of the range are not used by the estimator",
    "RT-9": "a blocked I2C bus delays one tick at most and is released; its settings are checked again",
    "RT-10": "an unplugged serial line does not block the program; it is opened again, disarmed",
    "RT-11": "a change of the date does not change a tick",
    "RT-12": "a connection that is lost while teaching stops the vehicle; the run is kept",
    "RT-13": "a driver who sends no signal for half a second loses control of the vehicle",
    "RT-14": "one client drives; the other clients cannot drive",
    "RT-15": "any client stops the vehicle, latched; 50 ms beside 5 flooding clients (the aim is 100 ms beside 50)",
    "RT-16": "a full disk ends the log and not the drive, and is reported",
    "RT-17": "heat and low voltage of the computer are measured each second during a drive",
    "RT-18": "memory does not grow in five minutes of driving (the aim is a day)",
    "RT-19": "faulty hardware prevents a drive, and the fault is reported",
    "ES-1": "an invalid covariance is refused, and the message contains a valid one",
    "ES-2": "P stays symmetric and positive over 100,000 ticks (the aim is 10 million)",
    "ES-3": "P stays positive after a measurement that is almost exact",
    "ES-4": "a value that is not finite does not enter the state",
    "ES-5": "one outlier in ten readings increases the error by a tenth at most",
    "ES-6": "a correct sensor is not refused",
    "ES-7": "a sensor that is refused for long is reported; while the vehicle moves, it is not accepted by force",
    "ES-8": "NEES and NIS are inside their chi-square intervals",
    "ES-9": "a state that no sensor observes is reported during the drive",
    "ES-10": "headings are wrapped, and pass half a turn without a jump",
    "ES-11": "the filter stays finite for ticks of any length, also for repeated and late ticks",
    "ES-12": "a replay gives the same numbers, bit for bit",
    "ES-13": "derivatives equal those of CasADi and finite differences",
    "ID-0": "a fit has a verdict; a refused fit is not written",
    "ID-1": "a parameter that is not identifiable is named, with the motion that it needs",
    "ID-2": "wrong units are detected and named",
    "ID-3": "timestamps that repeat, jump or jitter do not change the fit",
    "ID-4": "cells without a number are excluded and counted",
    "ID-5": "one outlier in ten samples has little effect on the fit",
    "ID-6": "samples at the end of a sensor's range are excluded",
    "ID-7": "the samples of a stuck sensor are excluded while it is stuck",
    "ID-8": "the delay of the commands is estimated from any initial value",
    "ID-9": "lost frames that were logged as zero are excluded",
    "ID-10": "half a second of data is refused",
    "ID-11": "initial values with the wrong sign and a factor of five converge (the aim is a factor of 100)",
    "ID-12": "a model that raises an exception or diverges is named, and does not end the program",
    "ID-13": "a result that contradicts physics is reported",
    "ID-14": "error bars equal the Cramér-Rao bound, and their intervals contain the true values",
    "LG-1": "kill -9 loses one second of a run at most",
    "LG-2": "a power cut loses 1.5 s at most and does not damage other runs",
    "LG-3": "a stalled disk does not delay a tick; estimates are dropped first",
    "LG-4": "a flipped bit never gives a wrong run without a message",
    "LG-5": "every complete chunk before a cut of a run can be read",
    "LG-6": "a run that would fill the memory is refused",
    "LG-7": "the content of a file is not executed: pickle, eval and YAML are not used",
    "LG-8": "a run of an hour loads in a second and 150 MB",
    "LG-9": "a CSV in any encoding, or with decimal commas, is read correctly or refused",
    "LG-10": "a file is replaced as a whole or stays unchanged",
    "LG-11": "paths with accents, spaces and links work, and a full disk does not damage a file",
    "FI-1": "a vehicle file is TOML, and any other text is refused with its line",
    "FI-2": "a mistyped key is detected, and the correct one is proposed",
    "FI-3": "values that contradict physics are refused with the calculation",
    "FI-4": "a file that is too large or too deep, or has too long numbers, is refused at once",
    "FI-5": "YAML is not read",
    "FI-6": "invalid input of a client is answered and does not end the service",
    "FI-7": "a file of a newer format is refused, with advice",
    "NE-1": "the network cannot reach a port of the program",
    "NE-2": "a page checks Host, Origin and token",
    "NE-3": "watching, stopping and driving are separate rights",
    "NE-4": "a heartbeat of the driver needs a growing number and a new picture; guesses are slowed down",
    "NE-5": "a client that does not read is disconnected and does not delay the others",
    "NE-6": "names from the network give access to runs alone, and to no other file",
    "NE-7": "a connection is encrypted by ssh",
    "NE-8": "a report does not load other files and does not execute code",
    "NE-9": "of twenty vehicles in one room, each obeys its own driver only",
    "SU-1": "at most six packages are needed on board",
    "SU-2": "the lock has hashes, and a Pi is set up without a network",
    "SU-3": "the firmware in the wheel equals the build of its sources (without an audit so far)",
    "SU-4": "the wheel is built and installed without a download",
}
WHY_NOT = {  # of promises without a test
    "RT-17": "the temperature is measured and stops a drive; the low voltage of the computer is not measured",
    "ES-9": "a fit names such a state; during a drive it is not reported",
    "LG-2": "the test needs cut images of a block device, as root; kill -9 is tested instead (LG-1)",
    "LG-8": "an hour with estimates takes 5.9 s and 233 MB, measured once on this machine",
}
# the last of several results of a test counts
RESULTS = "no test", "not run", "skipped", "kept", "not kept"


def promises() -> dict[str, str]:
    """Return the sentence of each promise, by its number."""
    firmware = (ROOT / "firmware/uno/README.md").read_text(encoding="utf-8")
    return dict(re.findall(r"^\| (R\d+) \| (.*) \|$", firmware, re.MULTILINE)) | WORDS


def keepers() -> dict[str, list[str]]:
    """Return the tests, as file::function, that name each promise."""
    tests: dict[str, list[str]] = {}
    for path in sorted((ROOT / "tests").rglob("test_*.py")):
        for name, numbers in TEST.findall(path.read_text(encoding="utf-8")):
            for room, k in re.findall(r"([a-z]+)(\d+)_", numbers):
                number = f"R{k}" if room == "r" else f"{room.upper()}-{k}"
                tests.setdefault(number, []).append(f"{path.relative_to(ROOT).as_posix()}::{name}")
    return tests


class Ends:
    """Record the result of each test; the cases of one parametrised test count together."""

    def __init__(self) -> None:
        self.of: dict[str, str] = {}

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        test = report.nodeid.partition("[")[0]
        end = {"passed": "kept", "skipped": "skipped", "failed": "not kept"}.get(report.outcome)
        if end is None:  # the test is repeated: the last result counts
            return
        if report.when == "call" or end != "kept":
            self.of[test] = max(self.of.get(test, "skipped"), end, key=RESULTS.index)


def main(arguments: list[str]) -> int:
    """Run the tests that name a promise, with options for pytest, and print the table; return 1 if one fails."""
    by_number, ends = keepers(), Ends()
    tests = sorted({test for names in by_number.values() for test in names})
    exit_code = pytest.main(["-q", "-p", "no:randomly", *arguments, *tests], plugins=[ends])
    counts = dict.fromkeys(reversed(RESULTS), 0)
    for number, words in promises().items():
        results = {test: ends.of.get(test, "not run") for test in by_number.get(number, [])} or {
            "–": "no test"
        }
        counts[max(results.values(), key=RESULTS.index)] += 1
        if number not in by_number:
            results = {WHY_NOT.get(number, "–"): "no test"}
        print(f"\n{number:<6}{textwrap.shorten(words, 100, placeholder=' …')}")
        for test, end in results.items():
            print(f"{'':6}{end:<10}{test.removeprefix('tests/')}")
    print(f"\n{sum(counts.values())} promises: " + ", ".join(f"{n} {end}" for end, n in counts.items()))
    return int(exit_code)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
