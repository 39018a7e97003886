"""Strict reading of YAML into frozen dataclasses: what is not known or not allowed is named."""

import math
from collections.abc import Callable, Sequence
from dataclasses import MISSING, field, fields
from difflib import get_close_matches
from pathlib import Path
from typing import Any, TypeVar

from warpcam.core import plain_yaml
from warpcam.core.errors import WarpcamError
from warpcam.core.file_access import FileAccess, Limits, read_named
from warpcam.core.numbers import is_finite_number

T = TypeVar("T")
Reader = Callable[[Any, str], Any]


def setting(read: Reader, default: Any = MISSING) -> Any:
    """A field that ``read_dataclass`` reads by ``read(value, where)``; without a default it is needed."""
    return field(metadata={"read": read}, **({} if default is MISSING else {"default": default}))


def read_file(kind: type[T], path: Path, limits: Limits | None) -> T:
    """A dataclass of a YAML file.

    Raises:
        RefusedError: The file, or what it stands for, is over a limit.
        WarpcamError: The file cannot be read, or something in it is not known or not allowed.
    """
    try:
        import yaml
    except ModuleNotFoundError:
        raise WarpcamError("pyyaml is not installed, and YAML files need it: pip install 'warpcam[datasets]'") from None
    try:
        text = read_named(path, limits, "read_recipes").decode()
        plain_yaml.check(text, FileAccess(None, trusted=True, limits=limits), str(path))
        value = yaml.safe_load(text)
    except OSError as error:
        raise WarpcamError(f"{path}: it cannot be read: {error.strerror or error}") from None
    except RecursionError:
        raise WarpcamError(f"{path}: its entries lie in each other too deep") from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise WarpcamError(f"{path}: it is not YAML: {' '.join(str(error).split())}") from None
    return read_dataclass(kind, {} if value is None else value, str(path))


def read_dataclass(kind: type[T], value: Any, where: str) -> T:
    """A dataclass of a mapping, whose keys are names of its fields."""
    known = {each.name: each for each in fields(kind)}  # type: ignore[arg-type]
    given = read_mapping(value, where)
    for key in given:
        if key not in known:
            raise WarpcamError(f"{where}: unknown key {key!r}{_nearest(key, known)}; allowed are {', '.join(known)}")
    for name, each in known.items():
        if name not in given and each.default is MISSING:
            raise WarpcamError(f"{where}: {name!r} is missing")
    return kind(**{key: known[key].metadata["read"](item, f"{where}: {key}") for key, item in given.items()})


def read_mapping(value: Any, where: str) -> dict[str, Any]:
    if not isinstance(value, dict) or not all(isinstance(key, str) for key in value):
        raise WarpcamError(f"{where}: a mapping with names as keys is needed, got {value!r}")
    return value


def nested(kind: type[T]) -> Reader:
    """Reader of one dataclass."""
    return lambda value, where: read_dataclass(kind, value, where)


def by_name(read: Reader) -> Reader:
    """Reader of a mapping of names of the user's to what ``read`` reads: pairs, sorted as they came."""
    return lambda value, where: tuple(
        (key, read(item, f"{where}: {key}")) for key, item in read_mapping(value, where).items()
    )


def dataclass_by_name(kind: type[T]) -> Reader:
    """Reader of a mapping of names of the user's to dataclasses; nothing stands for one without settings."""
    return by_name(lambda value, where: read_dataclass(kind, {} if value is None else value, where))


def number(low: float = -math.inf, high: float = math.inf) -> Reader:
    """Reader of a finite number from ``low`` to ``high``."""

    def read(value: Any, where: str) -> float:
        if not is_finite_number(value) or not low <= value <= high:
            raise WarpcamError(f"{where}: {_wanted('a number', low, high)} is needed, got {value!r}")
        return float(value)

    return read


def span(low: float = -math.inf, high: float = math.inf, whole: bool = False) -> Reader:
    """Reader of a pair (from, to) of numbers from ``low`` to ``high``; one number stands for both."""

    def read(value: Any, where: str) -> tuple[float, float]:
        pair = value if isinstance(value, list) else [value, value]
        good = len(pair) == 2 and all(is_finite_number(each) and low <= each <= high for each in pair)
        if not good or pair[0] > pair[1] or (whole and not all(isinstance(each, int) for each in pair)):
            kind = "[from, to] of whole numbers" if whole else "[from, to]"
            raise WarpcamError(f"{where}: {_wanted(kind, low, high)} or one number is needed, got {value!r}")
        return pair[0], pair[1]

    return read


def vector(size: int) -> Reader:
    """Reader of ``size`` finite numbers."""

    def read(value: Any, where: str) -> tuple[float, ...]:
        if not isinstance(value, list) or len(value) != size or not all(map(is_finite_number, value)):
            raise WarpcamError(f"{where}: {size} numbers are needed, got {value!r}")
        return tuple(map(float, value))

    return read


def optional(read: Reader) -> Reader:
    """Reader that takes nothing, too."""
    return lambda value, where: None if value is None else read(value, where)


def one_of(*allowed: str) -> Reader:
    """Reader of one of several words."""

    def read(value: Any, where: str) -> str:
        if value not in allowed:
            near = _nearest(value, allowed)
            raise WarpcamError(f"{where}: one of {', '.join(allowed)} is needed, got {value!r}{near}")
        return str(value)

    return read


def names(value: Any, where: str) -> tuple[str, ...]:
    """One name or a list of names."""
    several = [value] if isinstance(value, str) else value
    if not isinstance(several, list) or not several or not all(isinstance(each, str) for each in several):
        raise WarpcamError(f"{where}: a name or a list of names is needed, got {value!r}")
    return tuple(several)


def flag(value: Any, where: str) -> bool:
    if not isinstance(value, bool):
        raise WarpcamError(f"{where}: true or false is needed, got {value!r}")
    return value


def folder(value: Any, where: str) -> str:
    """A folder that is there; paths that are not absolute begin where the command was run."""
    if not isinstance(value, str) or not Path(value).is_dir():
        raise WarpcamError(f"{where}: there is no folder {value!r}")
    return str(Path(value).resolve())


def freeze(value: Any) -> Any:
    """Lists and mappings of plain values as tuples, which can be compared and hashed."""
    if isinstance(value, dict):
        return tuple((key, freeze(item)) for key, item in value.items())
    return tuple(map(freeze, value)) if isinstance(value, list | tuple) else value


def _wanted(kind: str, low: float, high: float) -> str:
    if low > -math.inf and high < math.inf:
        return f"{kind} from {low:g} to {high:g}"
    if low > -math.inf:
        return f"{kind} of at least {low:g}"
    return kind


def _nearest(key: Any, known: Sequence[str] | dict[str, Any]) -> str:
    found = get_close_matches(str(key), list(known), 1)
    return f", did you mean {found[0]!r}?" if found else ""
