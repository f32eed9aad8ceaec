"""Draws the mermaid diagrams of all pages into docs/diagrams/, for the docs site: python docs/draw_diagrams.py.

Needed only when a diagram has changed: building the site uses the drawings. Takes mermaid from npm and draws with a
headless Chromium; the environment variable CHROMIUM names another command.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from make_site import DIAGRAMS, ROOT, diagram_file

MERMAID = "mermaid@11.17.2"
_FENCE = re.compile(r"^```mermaid\n(.+?)^```", re.DOTALL | re.MULTILINE)
_SVG = re.compile(r"<svg.+</svg>", re.DOTALL)
_PAGE = """<!doctype html><meta charset="utf-8"><body><pre class="mermaid">{diagram}</pre>
<script src="{script}"></script>
<script>mermaid.initialize({{startOnLoad: true, deterministicIds: true, deterministicIDSeed: "{seed}",
htmlLabels: false, theme: "neutral", flowchart: {{htmlLabels: false, useMaxWidth: true}}}});</script></body>"""


def main() -> None:
    """Draws what has no drawing yet, and removes the drawings of diagrams that are gone."""
    diagrams = {diagram_file(text): text for page in _pages() for text in _FENCE.findall(page)}
    DIAGRAMS.mkdir(exist_ok=True)
    for old in set(DIAGRAMS.glob("*.svg")) - set(diagrams):
        old.unlink()
    with tempfile.TemporaryDirectory() as folder:
        script = _mermaid(Path(folder))
        for file, text in diagrams.items():
            if not file.exists():
                file.write_text(_draw(text, file.stem, script, Path(folder)), encoding="utf-8")
                print(file.relative_to(ROOT))


def _pages() -> list[str]:
    return [page.read_text(encoding="utf-8") for page in (*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"))]


def _mermaid(folder: Path) -> Path:
    subprocess.run(["npm", "install", "--silent", "--ignore-scripts", "--prefix", folder, MERMAID], check=True)
    return folder / "node_modules/mermaid/dist/mermaid.min.js"


def _draw(diagram: str, seed: str, script: Path, folder: Path) -> str:
    page = folder / "page.html"
    text = diagram.replace("&", "&amp;").replace("<", "&lt;")
    page.write_text(_PAGE.format(diagram=text, script=script.as_uri(), seed=seed), encoding="utf-8")
    chromium = [os.environ.get("CHROMIUM", "chromium"), "--headless", "--no-sandbox", "--disable-gpu",
                "--virtual-time-budget=10000", "--dump-dom", page.as_uri()]
    drawn = _SVG.search(subprocess.run(chromium, check=True, capture_output=True, text=True).stdout)
    if drawn is None:
        sys.exit(f"mermaid draws nothing for:\n{diagram}")
    return drawn[0] + "\n"


if __name__ == "__main__":
    main()
