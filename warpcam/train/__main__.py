"""``python -m warpcam.train`` is the command ``warpcam train``."""

import sys

from warpcam.tools.cli import main

sys.exit(main(["train", *sys.argv[1:]]))
