"""The packages' own pages of names: cheap until used, and complete."""

import ast
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

import fullsphere.model
import fullsphere.mosaic

PACKAGES = [fullsphere.model, fullsphere.mosaic]
HEAVY = ("numpy", "scipy", "cv2", "numba", "OpenImageIO", "matplotlib", "rich")


def after(code: str, expression: str) -> Any:
    """What `expression` is in a fresh interpreter that ran `code`."""
    done = subprocess.run([sys.executable, "-W", "error", "-c", f"{code}\nprint({expression})"], capture_output=True)
    assert done.returncode == 0, done.stderr.decode()
    return ast.literal_eval(done.stdout.decode())


@pytest.mark.parametrize("module", ["fullsphere.model", "fullsphere.mosaic", "fullsphere.model.errors"])
def test_import_loads_nothing_heavy(module: str) -> None:
    assert after(f"import sys, {module}", f"[m for m in {HEAVY} if m in sys.modules]") == []


@pytest.mark.parametrize("package", PACKAGES, ids=lambda package: package.__name__)
def test_every_name_is_there(package: ModuleType) -> None:
    assert set(package._homes) == set(package.__all__) <= set(dir(package))
    for name in package.__all__:
        value = getattr(package, name)
        assert getattr(value, "__name__", name) == name
        assert value is getattr(sys.modules[f"{package.__name__}.{package._homes[name]}"], name)


@pytest.mark.parametrize("package", PACKAGES, ids=lambda package: package.__name__)
def test_type_checkers_see_the_same_names(package: ModuleType) -> None:
    tree = ast.parse(Path(str(package.__file__)).read_text())
    (guarded,) = [node for node in tree.body if isinstance(node, ast.If)]
    imports = [node for node in guarded.body if isinstance(node, ast.ImportFrom)]
    seen = {alias.name: node.module for node in imports for alias in node.names}
    assert seen == {name: f"{package.__name__}.{home}" for name, home in package._homes.items()}


@pytest.mark.parametrize("first", ["import fullsphere.model.remap", "from fullsphere.model.remap import tiles", ""])
def test_a_function_with_the_name_of_its_module_is_the_function(first: str) -> None:
    code = f"{first}\nfrom fullsphere.model import remap\nfrom fullsphere.model.remap import TILE_PX"
    assert after(code, "(type(remap).__name__, TILE_PX)") == ("function", 512)


def test_modules_are_found_as_ever() -> None:
    from fullsphere.model import kernels

    assert kernels is sys.modules["fullsphere.model.kernels"]


def test_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        fullsphere.model.nonsense  # type: ignore[attr-defined]  # noqa: B018
    with pytest.raises(ImportError):
        from fullsphere.model import nonsense  # type: ignore[attr-defined]  # noqa: F401
