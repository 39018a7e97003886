"""Newton's own tests of its cameras, as its wheel has them, with our class in place of the one they test."""

import importlib
import unittest
from typing import Any


def run(module: str, case: str, name: str, replaced: dict[str, Any]) -> unittest.TestResult:
    """One of its test methods, with names of the module replaced for as long as it runs."""
    loaded = importlib.import_module(f"newton.tests.{module}")
    before = {key: getattr(loaded, key) for key in replaced}
    try:
        for key, value in replaced.items():
            setattr(loaded, key, value)
        result = unittest.TestResult()
        getattr(loaded, case)(name).run(result)
    finally:
        for key, value in before.items():
            setattr(loaded, key, value)
    return result
