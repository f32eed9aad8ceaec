"""The import graph of a checkout as text: `python docs/make_import_graph.py [CHECKOUT]`.

A row for each package of `stab_ros`, from the top layer to the bottom one; a column says how many imports go from the
package of the row to its own. An entry left of the dots goes upwards. The graph and the cycles are those that grimp
finds; the root, which only re-exports the public API, is left out.
"""

from __future__ import annotations

import sys
from collections import Counter
from graphlib import TopologicalSorter
from pathlib import Path

import grimp

ROOT = "stab_ros"
Edges = Counter[tuple[str, str]]  # importer, imported: how many imports of modules


def read_graph(checkout: Path) -> grimp.ImportGraph:
    """The imports between the modules of a checkout."""
    sys.path.insert(0, str(checkout))
    graph = grimp.build_graph(ROOT, cache_dir=None)
    for imported in graph.find_modules_directly_imported_by(ROOT):
        graph.remove_import(importer=ROOT, imported=imported)
    return graph


def between(imports: set[tuple[str, str]]) -> Edges:
    """Imports of modules, counted by the packages they go between; the root counts as `(root)`."""
    pairs = ((_package(importer), _package(imported)) for importer, imported in imports)
    return Counter(pair for pair in pairs if pair[0] != pair[1])


def _package(module: str) -> str:
    return module.split(".")[1] if "." in module else "(root)"


def ordered(edges: Edges, upward: Edges, packages: set[str]) -> list[str]:
    """Packages from the top layer to the bottom one, where the `upward` edges are left out of account."""
    importers: dict[str, set[str]] = {package: set() for package in packages}
    for importer, imported in edges - upward:
        importers[imported].add(importer)
    sorter = TopologicalSorter({package: sorted(importers[package]) for package in sorted(packages)})
    return [*sorter.static_order()]


def cycles_in_packages(graph: grimp.ImportGraph) -> list[tuple[str, str]]:
    """Imports that close a cycle between modules of one package, as grimp nominates them."""
    packages = [module for module in sorted(graph.modules) if module != ROOT and graph.find_children(module)]
    return [one for package in packages for one in sorted(graph.nominate_cycle_breakers(package))]


def text(graph: grimp.ImportGraph) -> str:
    """The whole answer."""
    imports = {(importer, imported) for importer in graph.modules
               for imported in graph.find_modules_directly_imported_by(importer)}
    edges, upward = between(imports), between(graph.nominate_cycle_breakers(ROOT))
    packages = ordered(edges, upward, {*map(_package, graph.modules)} - ({"(root)"} - {name for _, name in edges}))
    lines = [f"{len(graph.modules)} modules, {len(imports)} imports between them", "", *_matrix(packages, edges), "",
             f"imports that close a cycle between packages: {upward.total()}",
             *(f"  {importer} -> {imported}: {count}" for (importer, imported), count in sorted(upward.items()))]
    inside = cycles_in_packages(graph)
    return "\n".join([*lines, f"imports that close a cycle inside a package: {len(inside)}",
                      *(f"  {importer} -> {imported}" for importer, imported in inside)])


def _matrix(packages: list[str], edges: Edges) -> list[str]:
    width = max(map(len, packages))
    head = " " * width + "".join(f"{number:>4}" for number in range(1, len(packages) + 1))
    return [head, *(f"{importer:<{width}}" + "".join(_cell(edges, importer, imported) for imported in packages)
                    + f"   {number}" for number, importer in enumerate(packages, 1))]


def _cell(edges: Edges, importer: str, imported: str) -> str:
    if importer == imported:
        return "   ."
    return f"{edges[importer, imported] or '':>4}"


if __name__ == "__main__":
    print(text(read_graph(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parents[1])))
