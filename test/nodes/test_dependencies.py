"""package.xml, and what the code imports from ROS."""

from __future__ import annotations

import ast
import xml.etree.ElementTree as ET
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
ROS_SUFFIXES = ("_msgs", "_srvs", "_interfaces", "launch", "launch_ros", "rclpy")


def imported_packages(file: Path) -> set[str]:
    """The top-level names of all imports of a module."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found.update(alias.name.partition(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module.partition(".")[0])
    return found


def test_package_xml_names_every_ros_package_that_is_imported() -> None:
    files = [*(ROOT / "stab_ros").rglob("*.py"), *(ROOT / "launch").glob("*.py")]
    imported = {name for file in files for name in imported_packages(file) if name.endswith(ROS_SUFFIXES)}
    declared = {element.text for element in ET.parse(ROOT / "package.xml").iter("exec_depend")}
    assert {"rclpy", "std_msgs", "launch_ros"} <= imported <= declared
