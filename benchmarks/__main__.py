"""``python -m warpcam.benchmarks``: the same as ``warpcam bench``."""

import argparse
import sys

from warpcam.benchmarks import options, run
from warpcam.core.errors import WarpcamError


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m warpcam.benchmarks", description=options.ABOUT)
    options.add(parser)
    try:
        return run.run(parser.parse_args())
    except WarpcamError as error:
        print(f"warpcam: {error}", file=sys.stderr)
        return 2


if __name__ == "__main__":
    sys.exit(main())
