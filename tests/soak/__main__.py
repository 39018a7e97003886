"""``python -m tests.soak --minutes 20 --device cuda:0``: frames without end, and whether memory and images stay.

Worlds move, are reset and randomised; renderers are made and dropped; other threads draw. Every 10,000th frame is
compared with that of a new scene and renderer. Exits with 1 if a bit differed, a thread failed, or memory grew.
"""

import argparse
import json
import sys
from pathlib import Path

import warp as wp

from tests.soak import soak

LIMITS = {"host": 64 << 20, "held": 1 << 20, "taken": 64 << 20}  # bytes that memory may grow


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m tests.soak", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--minutes", type=float, default=20.0, help="how long (default: %(default)s)")
    parser.add_argument("--frames", type=int, help="at most")
    parser.add_argument("--device", default="cuda:0", help="a device of Warp's (default: %(default)s)")
    parser.add_argument("--check-every", type=int, default=10_000, help="frames (default: %(default)s)")
    parser.add_argument("--renew-every", type=int, default=500, help="frames (default: %(default)s)")
    parser.add_argument("--threads", type=int, default=2, help="that draw meanwhile (default: %(default)s)")
    parser.add_argument("--worlds", type=int, default=16, help="(default: %(default)s)")
    parser.add_argument("--out", type=Path, help="JSON file for the results")
    options = parser.parse_args(arguments)
    device = wp.get_device(options.device)

    def write(result: soak.Result) -> None:
        if options.out is not None:
            options.out.write_text(json.dumps(result.as_dict(), indent=1) + "\n")

    with wp.ScopedDevice(device):
        result = soak.run(
            device,
            seconds=60.0 * options.minutes,
            frames=options.frames,
            check_every=options.check_every,
            renew_every=options.renew_every,
            threads=options.threads,
            worlds=options.worlds,
            checked=write,
        )
    told = result.as_dict()
    print({name: value for name, value in told.items() if name != "samples"})
    write(result)
    grown = [name for name, most in LIMITS.items() if result.growth[name] > most]
    for name in grown:
        print(f"soak: memory grew: {name} by {result.growth[name]:,} bytes, {LIMITS[name]:,} are allowed")
    if not result.checks:
        print(f"soak: no frame was compared in {result.frames} frames; give --check-every")
    return int(bool(result.differences or grown or not result.checks))


if __name__ == "__main__":
    sys.exit(main())
