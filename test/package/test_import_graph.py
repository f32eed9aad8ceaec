"""Imports go one way, and nothing private is imported from elsewhere: the contracts stand in pyproject.toml."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import grimp
import pytest
from importlinter.cli import EXIT_STATUS_SUCCESS, lint_imports

PYPROJECT = Path(__file__).parents[2] / "pyproject.toml"


def test_contracts_of_the_import_graph_are_kept(capfd: pytest.CaptureFixture[str]) -> None:
    status = lint_imports(str(PYPROJECT), no_cache=True, is_debug_mode=True, no_logo=True)
    assert status == EXIT_STATUS_SUCCESS, capfd.readouterr().out


def test_no_module_imports_a_package_that_it_is_part_of() -> None:
    """Such a circle lies between parent and child, where the contract on cycles does not look."""
    graph = grimp.build_graph("stab_ros", cache_dir=None)
    circles = [(module, imported) for module in graph.modules
               for imported in graph.find_modules_directly_imported_by(module) if module.startswith(f"{imported}.")]
    assert circles == []


def test_nodes_on_board_start_without_scipy() -> None:
    """It takes a fifth of the time of their start."""
    nodes = "stab_ros.nodes.tracker_node, stab_ros.nodes.evaluator_node"
    code = f"import sys, {nodes}; sys.exit('scipy.special' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)
