"""Run benches one after the other, each in a process of its own: ``python -m studies.speed [NAME...] [--scene NAME]``.

Figures are printed as soon as they are measured. A bench that cannot run here is named at the end, and the exit code
is 1; the others run all the same.
"""

import argparse
import subprocess
import sys
from collections.abc import Sequence

BENCHES = {
    "stack": "the focal stack against Mitsuba's thin lens: time, and error at equal samples",
    "grain": "noise that the renderer leaves in each scene's pictures, at rest and moving; time of a slice",
    "encode": "charge to spikes: rate, growth with the length, comparison with public encoders",
    "cameras": "spikes, photons and frames of one sweep: processor seconds per second of the sensor",
    "events": "light to events: seconds per second of the sensor, beside the algorithm of v2e",
    "stream": "the stream file: write, size, three read patterns, file to scores",
    "windows": "random windows for training, read by two processes",
    "score": "ten methods on six sequences",
    "job": "the paper's synthetic set, recipe to leaderboard, and again under another light",
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benches that the arguments name, and return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m studies.speed", description=(__doc__ or "").splitlines()[0])
    listed = "; ".join(f"{name}: {what}" for name, what in BENCHES.items())
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"{listed} (default: all)")
    parser.add_argument("--scene", action="append", default=[], help="scene for the bench grain; repeatable")
    options = parser.parse_args(argv)
    if wrong := [name for name in options.names if name not in BENCHES]:
        parser.error(f"unknown bench {wrong[0]!r}; allowed: {', '.join(BENCHES)}")
    if options.scene and options.names and "grain" not in options.names:
        parser.error(f"--scene is for the bench grain, which is not among {', '.join(options.names)}")
    failed = []
    for name in options.names or BENCHES:
        print(f"## {name}: {BENCHES[name]}", flush=True)
        scenes = [f"--scene={scene}" for scene in options.scene if name == "grain"]
        if subprocess.run([sys.executable, "-m", f"studies.speed.{name}", *scenes]).returncode:
            failed.append(name)
    if failed:
        print(f"studies.speed: {', '.join(failed)} failed", file=sys.stderr)
    return int(bool(failed))


if __name__ == "__main__":
    sys.exit(main())
