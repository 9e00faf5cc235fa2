"""Run all benches, or only the benches that are named."""

import argparse
import importlib
import json
import sys

BENCHES = (
    "kernels", "simulation", "many", "filter", "recommended", "fit", "live_information", "tuning", "laps",
    "controllers", "start", "onboard", "door", "page",
)  # fmt: skip


def main() -> int:
    """Run the benches; return 0 if every target was met or none is judged, else 1."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument(
        "names", nargs="*", metavar="name", help=f"one or more of {', '.join(BENCHES)}; all if left out"
    )
    parser.add_argument("--json", action="store_true", help="one object with rows and verdict")
    parser.add_argument(
        "--smallest",
        action="store_true",
        help="sizes that show in seconds that they run; no target is judged",
    )
    args = parser.parse_args()
    unknown = [name for name in args.names if name not in BENCHES]
    if unknown:
        parser.error(f"no bench {unknown[0]!r}: expected one of {', '.join(BENCHES)}")
    rows, all_met = [], True
    for name in args.names or BENCHES:
        for bench in importlib.import_module(f"benchmarks.{name}").benches(args.smallest):
            rows += bench.as_rows()
            all_met = all_met and bench.met
            print(bench.table() + "\n", file=sys.stderr if args.json else sys.stdout, flush=True)
    verdict = "NOT JUDGED" if args.smallest else "MET" if all_met else "MISSED"
    if args.json:
        print(json.dumps({"rows": rows, "verdict": verdict}))
    elif args.smallest:
        print("At their smallest sizes benchmarks show that they run; no target is judged.")
    return int(verdict == "MISSED")


if __name__ == "__main__":
    sys.exit(main())
