"""The public API: every name of `stab_ros.__all__` can be imported, is typed and is documented."""

from __future__ import annotations

import ast
import dataclasses
import inspect
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from enum import Enum
from pathlib import Path
from typing import Any

import pytest

import stab_ros
from stab_ros.core.errors import StabRosError

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "api.md"
HEAVY = ("cv2", "numba", "numpy", "rclpy", "rosbags", "matplotlib")
TYPE_ALIASES = {"Homography", "Image"}
DOCUMENTED = sorted({*stab_ros.__all__} - TYPE_ALIASES - {"__version__"})


def imported_for_type_checkers() -> list[str]:
    tree = ast.parse(Path(stab_ros.__file__).read_text(encoding="utf-8"))
    (block,) = (node for node in tree.body if isinstance(node, ast.If) and isinstance(node.test, ast.Name))
    return [alias.name for node in block.body if isinstance(node, ast.ImportFrom) for alias in node.names]


def test_importing_the_package_loads_no_heavy_library() -> None:
    words = [sys.executable, "-c", "import stab_ros, sys; print(*sys.modules)"]
    loaded = subprocess.run(words, capture_output=True, text=True, check=True).stdout.split()
    assert not {*HEAVY} & {*loaded}


@pytest.mark.parametrize("name", stab_ros.__all__)
def test_name_can_be_imported_and_stands_on_the_page(name: str) -> None:
    assert getattr(stab_ros, name) is not None
    assert name in dir(stab_ros)
    assert f"`{name}`" in PAGE.read_text(encoding="utf-8")


def test_type_checkers_see_the_same_names() -> None:
    assert sorted([*imported_for_type_checkers(), "__version__"]) == sorted(stab_ros.__all__)
    assert (Path(stab_ros.__file__).parent / "py.typed").exists()


def test_an_unknown_name_is_an_import_error() -> None:
    words = [sys.executable, "-c", "from stab_ros import Stabiliser"]
    failed = subprocess.run(words, capture_output=True, text=True, check=False)
    assert "cannot import name 'Stabiliser' from 'stab_ros'" in failed.stderr


@pytest.mark.thorough
@pytest.mark.slow
def test_snippets_of_the_page_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "bags").symlink_to(ROOT / "bags")
    monkeypatch.chdir(tmp_path)
    snippets = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    assert len(snippets) >= 7
    names: dict[str, Any] = {}
    for snippet in snippets:
        exec(snippet, names)


# docstrings, in Google style


def public_members(cls: type) -> Iterator[tuple[str, Callable[..., Any]]]:
    """Name and function of the methods and properties that a class defines itself."""
    for name, member in vars(cls).items():
        if name.startswith("_"):
            continue
        if isinstance(member, property):
            yield name, member.fget or property
        elif inspect.isfunction(function := inspect.unwrap(getattr(member, "__func__", member))):
            yield name, function


def functions() -> Iterator[tuple[str, Callable[..., Any]]]:
    """Every public function and method with its qualified name."""
    for name in DOCUMENTED:
        value = getattr(stab_ros, name)
        if inspect.isclass(value):
            yield from ((f"{name}.{member}", function) for member, function in public_members(value))
        else:
            yield name, inspect.unwrap(value)


def section(doc: str, title: str) -> str:
    """The indented text below `title:`; "" where there is no such section."""
    found = re.search(rf"^{title}:\n((?:    .*\n|\n)+)", doc + "\n", re.MULTILINE)
    return found[1] if found else ""


def fields_of(cls: type) -> list[str]:
    """What a class is made of: the fields of a dataclass, else the arguments of its constructor."""
    if dataclasses.is_dataclass(cls):  # a setting carries its own text
        return [one.name for one in dataclasses.fields(cls) if "range" not in one.metadata]
    return [name for name in inspect.signature(cls).parameters if name not in ("args", "kwargs")]


CLASSES = [name for name in DOCUMENTED if inspect.isclass(getattr(stab_ros, name))]
FUNCTIONS = dict(functions())


@pytest.mark.parametrize("name", CLASSES)
def test_class_is_documented(name: str) -> None:
    cls = getattr(stab_ros, name)
    doc = inspect.cleandoc(cls.__doc__ or "")
    assert doc
    if issubclass(cls, (StabRosError, Enum)) or getattr(cls, "_is_protocol", False):
        return
    described = section(doc, "Attributes") + section(doc, "Args") + section(inspect.getdoc(cls.__init__) or "", "Args")
    missing = [field for field in fields_of(cls) if not re.search(rf"^    {field}: ", described, re.MULTILINE)]
    assert not missing


@pytest.mark.parametrize("name", FUNCTIONS)
def test_function_is_documented(name: str) -> None:
    function = FUNCTIONS[name]
    doc = inspect.getdoc(function) or ""
    assert doc
    signature = inspect.signature(function)
    arguments = [one for one in signature.parameters if one not in ("self", "cls")]
    missing = [one for one in arguments if not re.search(rf"^    {one}: ", section(doc, "Args"), re.MULTILINE)]
    assert not missing
    if arguments and signature.return_annotation not in ("None", None):
        assert section(doc, "Returns") or section(doc, "Yields")
