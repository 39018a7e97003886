"""Kernel keys in words, for people."""

from dataclasses import fields
from enum import IntEnum, IntFlag
from typing import Any

from warpcam.kernels.plan.launches import SceneTypes


def describe(name: str, key: Any) -> str:
    """A pass and the key of its kernel, on one line."""
    if key is None:
        return name
    words = [f"{field.name.replace('_', ' ')} {_word(getattr(key, field.name))}" for field in fields(key)]
    if "blocks" not in {field.name for field in fields(key)}:
        words.append(f"blocks {key.blocks}")
    return f"{name}: {'; '.join(words)} on a multiprocessor"


def _word(value: Any) -> str:
    if isinstance(value, SceneTypes):
        return " ".join(part for part in map(_word, (value.geometry, value.scene)) if part != "none") or "none"
    if isinstance(value, IntFlag):
        return " ".join(str(flag.name) for flag in type(value) if flag in value) or "none"
    if isinstance(value, IntEnum):
        return value.name
    if isinstance(value, bool):
        return "yes" if value else "no"
    return "x".join(map(str, value)) if isinstance(value, tuple) else str(value)
