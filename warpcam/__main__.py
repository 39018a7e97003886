"""``python -m warpcam`` is the command ``warpcam``."""

import sys

from warpcam.cli import main

sys.exit(main())
