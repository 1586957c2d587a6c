"""Values of a JSON file taken out of it with their kind checked; errors name the file and the key."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from fullsphere.model.errors import InputError


def object_of(value: Any, where: str) -> dict[str, Any]:
    """The value, which has to be an object of keys and values; `where` is named in errors."""
    if not isinstance(value, dict):
        raise InputError(f"{where}: is not an object of keys and values")
    return value


def demand_keys(data: dict[str, Any], where: str, required: Collection[str], optional: Collection[str]) -> None:
    """InputError if a key is missing that is required, or there is one that is neither required nor optional."""
    missing = [key for key in required if key not in data]
    if missing:
        raise InputError(f"{where}: the key {missing[0]!r} is missing")
    unknown = [key for key in data if key not in required and key not in optional]
    if unknown:
        raise InputError(f"{where}: the key {unknown[0]!r} is unknown; is it misspelt?")


def number_of(
    data: dict[str, Any], key: str, where: str, lower: float | None = None, upper: float | None = None
) -> float:
    """The number of a key, if told so not below `lower` and not above `upper`."""
    value = data[key]
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"{where}: {key} is {value!r}, not a number")
    if (lower is not None and value < lower) or (upper is not None and value > upper):
        within = f"less than {lower:g}" if upper is None else f"not between {lower:g} and {upper:g}"
        raise InputError(f"{where}: {key} is {value:g}, {within}")
    return float(value)


def whole_of(data: dict[str, Any], key: str, where: str, lower: float, upper: float) -> int:
    """The whole number of a key, from `lower` to `upper`."""
    value = number_of(data, key, where, lower, upper)
    if not value.is_integer():
        raise InputError(f"{where}: {key} is {value:g}, not a whole number")
    return int(value)


def numbers_of(data: dict[str, Any], key: str, where: str, count: int | None = None) -> list[float]:
    """The list of numbers of a key, if told so of so many."""
    values = data[key]
    if not isinstance(values, list) or (count is not None and len(values) != count):
        raise InputError(f"{where}: {key} is not a list of {count or ''} numbers".replace("  ", " "))
    if set(map(type, values)) <= {int, float}:
        return list(map(float, values))
    return [number_of({key: item}, key, where) for item in values]


def list_of(data: dict[str, Any], key: str, where: str) -> list[Any]:
    """The list of a key, of anything."""
    if not isinstance(data[key], list):
        raise InputError(f"{where}: {key} is not a list")
    return list(data[key])


def text_of(data: dict[str, Any], key: str, where: str) -> str:
    """The text of a key."""
    if not isinstance(data[key], str):
        raise InputError(f"{where}: {key} is {data[key]!r}, not a text")
    return str(data[key])
