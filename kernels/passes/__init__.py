"""Passes of a frame. Each module registers what it binds, see ``plan/passes.py``; all are imported with the package."""

import importlib
import pkgutil

for _module in pkgutil.iter_modules(__path__):
    importlib.import_module(f"{__name__}.{_module.name}")
