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
TEST = re.compile(r"^def (test_((?:(?:fw|rt|es|id|lg|fi|ne|su|r)\d+_)+)\w+)\(", re.MULTILINE)
WORDS = {
    "FW-1": "motors are off 320 ms after the last fresh command (260 is aimed at)",
    "FW-2": "motors are off 150 ms after the firmware hangs",
    "FW-3": "the firmware starts disarmed with quiet motor pins, and tells why it started",
    "FW-4": "a command counts with nonce, newer number, both checks and values in range alone",
    "FW-5": "frames that are repeated, late or out of order move nothing",
    "FW-6": "after garbage the next frame is read",
    "FW-7": "a reset of the Uno ends the drive; only a person starts it again",
    "FW-8": "a low battery disarms, keeps disarmed, and is told in volts",
    "RT-1": "ticks that are missed are skipped and counted, never made up for",
    "RT-2": "a computer that stands still or is overloaded drives no further",
    "RT-3": "a block that raises stops the vehicle, is named, and the run is whole",
    "RT-4": "no command that is not finite or beyond its limits reaches the motors",
    "RT-5": "a program that dies leaves a stopped vehicle",
    "RT-6": "half a second without IMU is bridged, more stops",
    "RT-7": "an IMU that repeats its words is held back, a resting one never",
    "RT-8": "readings at the end of the range do not reach the estimate",
    "RT-9": "a held I2C bus delays no tick twice and is freed; settings are checked again",
    "RT-10": "a pulled serial line blocks nothing and is opened again, disarmed",
    "RT-11": "setting the date changes no tick",
    "RT-12": "a connection lost while teaching stops the vehicle and keeps the run",
    "RT-13": "whoever drives and falls silent loses the vehicle within half a second",
    "RT-14": "one client drives, the others cannot",
    "RT-15": "anyone stops it, latched: within 50 ms beside 5 flooding clients (100 ms beside 50 is aimed at)",
    "RT-16": "a full disk ends the log and not the drive, and is told",
    "RT-17": "heat and low voltage of the computer are read each second while driving",
    "RT-18": "nothing piles up in five minutes of driving (a day is aimed at)",
    "RT-19": "hardware that is not well refuses to drive and says why",
    "ES-1": "covariances that cannot be are refused, with a valid one beside them",
    "ES-2": "P stays symmetric and positive over 100,000 ticks (10 million are aimed at)",
    "ES-3": "P stays positive where a measurement is almost exact",
    "ES-4": "nothing that is not finite enters the state",
    "ES-5": "one reading in ten far off costs a tenth of the error at most",
    "ES-6": "a sound sensor is not refused",
    "ES-7": "a sensor refused for long is told and never forced in while moving",
    "ES-8": "NEES and NIS lie in their chi-square bands",
    "ES-9": "a state that nothing observes is announced while driving",
    "ES-10": "headings are wrapped and cross half a turn without a jump",
    "ES-11": "ticks of any length, repeated or late ones too, leave the filter finite",
    "ES-12": "a replay gives the same bits",
    "ES-13": "derivatives are those of CasADi and of differences",
    "ID-0": "the answer is a verdict; a refused fit is not written",
    "ID-1": "what a drive does not show is named with the motion that would",
    "ID-2": "wrong units are found and named",
    "ID-3": "times that repeat, jump or jitter do no harm",
    "ID-4": "cells without a number are left out and counted",
    "ID-5": "one outlier in ten hardly matters",
    "ID-6": "a clipped sensor is left out where it is clipped",
    "ID-7": "a stuck sensor is left out for as long",
    "ID-8": "the delay of the commands is found from any start",
    "ID-9": "lost frames that were logged as zero are excluded",
    "ID-10": "half a second of data is refused",
    "ID-11": "starts wrong by a factor of five and in sign come right (100 is aimed at)",
    "ID-12": "a model that raises, is not finite or runs away is named and crashes no fit",
    "ID-13": "no result that physics forbids is given without a word",
    "ID-14": "error bars are those of the Cramér-Rao bound and hold the truth",
    "LG-1": "kill -9 loses at most one second of a run",
    "LG-2": "a power cut loses at most 1.5 s and harms no other run",
    "LG-3": "a stalled disk holds no tick up and drops estimates first",
    "LG-4": "a flipped bit never gives a silently wrong run",
    "LG-5": "a run cut anywhere gives every whole chunk before the cut",
    "LG-6": "a run that would fill the memory is refused",
    "LG-7": "nothing of a file is run as code: no pickle, no eval, no YAML",
    "LG-8": "a run of an hour loads in a second and 150 MB",
    "LG-9": "a CSV in any encoding or with decimal commas is read right or refused",
    "LG-10": "files are replaced whole or not at all",
    "LG-11": "accents, spaces, links and full disks in a path do no harm",
    "FI-1": "a vehicle file is TOML and nothing else",
    "FI-2": "a mistyped key is found and the right one proposed",
    "FI-3": "values that physics forbids are refused with the arithmetic",
    "FI-4": "a file too large, deep or long in its numbers is refused at once",
    "FI-5": "no YAML is read",
    "FI-6": "nonsense from a client is answered and ends nothing",
    "FI-7": "a file of a newer format is refused with what to do",
    "NE-1": "no port is opened to the network",
    "NE-2": "a page checks Host, Origin and token",
    "NE-3": "seeing, stopping and driving are separate rights",
    "NE-4": "a driver's beats count by a growing number before a fresh picture; guesses are slowed down",
    "NE-5": "a client that does not read is let go and holds nobody up",
    "NE-6": "names from the other side reach no file but runs",
    "NE-7": "a connection is encrypted: it is ssh",
    "NE-8": "a report fetches nothing and runs nothing",
    "NE-9": "twenty vehicles in one room never obey each other's commands",
    "SU-1": "at most six packages on board",
    "SU-2": "the lock has hashes, and a Pi is set up without a network",
    "SU-3": "the firmware in the wheel is what its sources build to (no audit yet)",
    "SU-4": "the wheel is built and installed without a download",
}
WHY_NOT = {  # of promises without a test
    "RT-17": "the temperature is read and stops a drive; low voltage of the computer is not read",
    "ES-9": "a fit names what a drive does not show; while driving nothing announces it",
    "LG-2": "it needs cut images of a block device, as root; kill -9 is tested instead (LG-1)",
    "LG-8": "an hour with estimates takes 5.9 s and 233 MB here, measured once",
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
    tests = sorted({test for several in by_number.values() for test in several})
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
