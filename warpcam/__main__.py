"""``python -m warpcam`` is the command ``warpcam``."""

import sys

from warpcam.tools.cli import main

sys.exit(main())
