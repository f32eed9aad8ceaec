"""What the code imports is what package.xml (for rosdep) and setup.py (for pip) declare, and nothing else is."""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from importlib.metadata import requires
from pathlib import Path
from typing import Any

import pytest
import yaml
from catkin_pkg.package import Package, parse_package

ROOT = Path(__file__).parents[2]
# keys of rosdistro's rosdep/python.yaml; where there is none for the module: of what brings it, or of our rosdep.yaml
KEYS = {
    "PIL": "python3-pil", "apsw": "python3-rosbags-pip", "av": "python3-av-pip", "backports": "python3-rosbags-pip",
    "catkin_pkg": "python3-catkin-pkg-modules", "cv2": "python3-opencv", "docutils": "python3-docutils",
    "grimp": "python3-import-linter-pip",
    "hypothesis": "python3-hypothesis", "importlinter": "python3-import-linter-pip", "jinja2": "python3-jinja2",
    "lz4": "mcap-ros2-support", "markupsafe": "python3-jinja2", "matplotlib": "python3-matplotlib",
    "mcap": "mcap-ros2-support", "numba": "python3-numba", "numpy": "python3-numpy", "pyproj": "python3-pyproj",
    "pytest": "python3-pytest", "rasterio": "python3-rasterio", "rosbags": "python3-rosbags-pip",
    "ruamel": "python3-ruamel.yaml", "scipy": "python3-scipy",
    "tifffile": "python3-tifffile", "tqdm": "python3-tqdm", "yaml": "python3-yaml", "zstandard": "mcap-ros2-support",
}
# `ros2 launch`, the part of `rosbags` of another package, and messages imported by name where installed
BY_THE_WAY = {"ros2launch", "python3-rosbags-image-pip", "tf2_msgs"}
DISTRIBUTIONS = {  # on PyPI, where they are not named as the module is
    "PIL": "pillow", "backports": "backports.zstd", "cv2": "opencv-contrib-python-headless",
    "importlinter": "import-linter", "ruamel": "ruamel.yaml", "yaml": "pyyaml", "catkin_pkg": "catkin-pkg",
}
MADE_BY_TESTS = {"river_msgs"}
WORDS = {"name", "version", "license", "maintainer", "maintainer_email", "url", "install_requires", "extras_require"}
TOOLS = {"mypy", "pre-commit", "pytest-xdist", "ruff", "scipy-stubs", "types-pyyaml", "types-tqdm"}


def imports_of(folder: str) -> set[str]:
    """The top modules that the files of a folder import, without those of Python and of the repository."""
    files = [*(ROOT / folder).rglob("*.py")]
    own = {"stab_ros"} | {path.stem for path in [*files, *(ROOT / "bench").rglob("*.py")]}
    own |= {path.name for path in [*ROOT.rglob("bench/*"), *ROOT.rglob("test/*")] if path.is_dir()}
    names = {name.partition(".")[0] for file in files for name in imported(ast.parse(file.read_text(encoding="utf-8")))}
    return names - own - {*sys.stdlib_module_names, "compression", "typing_extensions"} - MADE_BY_TESTS


def imported(tree: ast.AST) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            yield node.module


@pytest.fixture(scope="module")
def package() -> Package:
    return parse_package(str(ROOT / "package.xml"))


@pytest.fixture(scope="module")
def setup_words() -> dict[str, Any]:
    """What setup.py tells setuptools, where that depends on its own constants alone."""
    tree = ast.parse((ROOT / "setup.py").read_text(encoding="utf-8"))
    names = {one.targets[0].id: one.value for one in tree.body
             if isinstance(one, ast.Assign) and isinstance(one.targets[0], ast.Name)}
    (call,) = (one.value for one in tree.body if isinstance(one, ast.Expr) and isinstance(one.value, ast.Call))
    constants: dict[str, Any] = {}
    for name, value in names.items():
        constants[name] = evaluated(value, constants)
    return {one.arg: evaluated(one.value, constants) for one in call.keywords if one.arg in WORDS}


def evaluated(expression: ast.expr, names: dict[str, Any]) -> Any:
    return eval(compile(ast.Expression(expression), "setup.py", "eval"), {}, names)


def keys_of(modules: set[str]) -> set[str]:
    """ROS packages are keys by their own name."""
    return {KEYS.get(module, module) for module in modules}


def distributions(requirements: list[str]) -> set[str]:
    return {re.split(r"[\s<>=!~;\[]", one)[0].lower() for one in requirements}


def test_package_xml_is_as_catkin_pkg_demands_it(package: Package) -> None:
    found: list[str] = []
    package.validate(warnings=found)
    assert found == []
    assert package.get_build_type() == "ament_python"
    assert not re.search(r"@example\.(com|org|net)$", package.maintainers[0].email)
    assert [url.type for url in package.urls] == ["website"]


def test_rosdep_brings_what_the_code_imports(package: Package) -> None:
    run = {one.name for one in package.exec_depends}
    assert run == keys_of(imports_of("stab_ros") | imports_of("launch") | imports_of("examples")) | BY_THE_WAY


def test_rosdep_brings_what_the_tests_import(package: Package) -> None:
    run, test = ({one.name for one in depends} for depends in (package.exec_depends, package.test_depends))
    assert test == keys_of(imports_of("test")) - run


@pytest.mark.thorough
def test_pip_brings_what_the_code_imports(setup_words: dict[str, Any]) -> None:
    modules = imports_of("stab_ros") | imports_of("examples")
    known = {DISTRIBUTIONS.get(one, one.lower()) for one in modules & {*KEYS}} | {"rosbags-image"}
    of_ros = {"ros-jazzy-rclpy", "ros-jazzy-common-interfaces"}
    assert distributions(setup_words["install_requires"]) == known | of_ros
    of_launch_files = {"launch", "launch_ros"}  # which no wheel has: they come with `ros2 launch`
    assert modules - {*KEYS} - of_launch_files <= {
        "rclpy", "rcl_interfaces", "rosgraph_msgs", "diagnostic_msgs", "geometry_msgs", "lifecycle_msgs", "sensor_msgs",
        "std_msgs", "std_srvs", "visualization_msgs"}


@pytest.mark.thorough
def test_pip_brings_what_the_tests_import(setup_words: dict[str, Any]) -> None:
    run, test = (distributions(words) for words in (setup_words["install_requires"],
                                                    setup_words["extras_require"]["test"]))
    modules = {DISTRIBUTIONS.get(one, one.lower()) for one in imports_of("test") & {*KEYS}}
    assert modules - run == test - TOOLS


def test_package_xml_and_setup_py_say_the_same(package: Package, setup_words: dict[str, Any]) -> None:
    (maintainer,) = package.maintainers
    assert (package.name, package.version) == (setup_words["name"], setup_words["version"])
    assert (maintainer.name, maintainer.email) == (setup_words["maintainer"], setup_words["maintainer_email"])
    assert package.licenses == [setup_words["license"]]
    assert package.urls[0].url == setup_words["url"]


@pytest.mark.parametrize(("module", "bringer"), [
    ("apsw", "rosbags"), ("backports.zstd", "rosbags"), ("lz4", "rosbags"), ("lz4", "mcap"), ("zstandard", "mcap"),
    ("markupsafe", "jinja2")])
def test_what_has_no_key_is_brought_by_what_has_one(module: str, bringer: str) -> None:
    assert module in distributions(requires(bringer) or [])


def test_own_keys_are_used_and_have_a_rule_for_debian_and_ubuntu(package: Package) -> None:
    rules = yaml.safe_load((ROOT / "rosdep.yaml").read_text(encoding="utf-8"))
    declared = {one.name for one in [*package.exec_depends, *package.test_depends]}
    assert {*rules} <= declared
    assert all({*rule} == {"debian", "ubuntu"} for rule in rules.values())
