"""Packages whose own page of names costs nothing until a name is used.

`from fullsphere.model import remap` loads what the function needs; `import fullsphere.model.errors` must not: the
command answers --help and faults in an option without NumPy.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterable, Mapping, Sequence
from types import ModuleType
from typing import Any


def offer(package: str, modules: Mapping[str, Sequence[str]]) -> None:
    """Let a package answer names that stand in its modules, and load a module when one of its names is asked for.

    Where a name is that of its module too (`remap`, `register`, `compose`) the package answers what the module holds,
    whether or not the module was loaded before; `from package.remap import tiles` finds the module as ever.

    Parameters
    ----------
    package
        The `__name__` of the package, which is being imported.
    modules
        For each module of the package the names that it defines.
    """
    page = sys.modules[package]
    page.__class__ = _Page
    page.__dict__["_homes"] = {name: module for module, names in modules.items() for name in names}


class _Page(ModuleType):
    _homes: dict[str, str]

    def __getattr__(self, name: str) -> Any:
        home = self._homes.get(name)
        if home is None:
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}")
        value = getattr(importlib.import_module(f"{self.__name__}.{home}"), name)
        self.__dict__[name] = value
        return value

    def __setattr__(self, name: str, value: Any) -> None:
        if name in self._homes and isinstance(value, ModuleType):
            return  # the import system would put the module in the place of the function of its name
        super().__setattr__(name, value)

    def __dir__(self) -> Iterable[str]:
        return sorted({*super().__dir__(), *self._homes})
