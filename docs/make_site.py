"""Builds the docs site into site/, without network access: python docs/make_site.py.

MkDocs reads one folder; our pages are in the root, docs/ and bench/. This script copies them to build/pages with their
paths, so their relative links stay valid, and MkDocs checks every link and anchor. Formulae and diagrams would need
scripts from a CDN. Formulae therefore become MathML, and diagrams the SVG files of docs/diagrams/.
"""

from __future__ import annotations

import hashlib
import html
import re
import shutil
import subprocess
import sys
from importlib import import_module
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGES = ROOT / "build/pages"
SITE = ROOT / "site"
DIAGRAMS = ROOT / "docs/diagrams"
_COLLECTED = ("*.md", "LICENSE", "package.xml", "docs/**/*.md", "docs/**/*.png", "docs/images/*.svg", "docs/*.py",
              "bench/*.md", "bench/results/*.md", "examples/*", "examples/cpp/*", "config/sros2/policy.xml")
_INLINE = re.compile(r'<span class="arithmatex">\\\((.+?)\\\)</span>', re.DOTALL)
_BLOCK = re.compile(r'<div class="arithmatex">\\\[(.+?)\\\]</div>', re.DOTALL)
_DIAGRAM = re.compile(r'<pre class="mermaid"><code>(.+?)</code></pre>', re.DOTALL)


def main() -> int:
    """Returns the exit code of MkDocs: not 0 if a link or an anchor is broken."""
    _collect()
    mkdocs = [sys.executable, "-m", "mkdocs", "build", "--clean", "--config-file", str(ROOT / "mkdocs.yml")]
    code = subprocess.run(mkdocs, check=False).returncode
    if not code:
        for page in SITE.rglob("*.html"):
            page.write_text(_drawn(page.read_text(encoding="utf-8")), encoding="utf-8")
        print(f"docs      {SITE / 'index.html'}")
    return code


def diagram_file(diagram: str) -> Path:
    """The SVG file of a mermaid diagram; its name is a hash of the diagram's text."""
    return DIAGRAMS / f"{hashlib.sha256(diagram.strip().encode()).hexdigest()[:16]}.svg"


def _collect() -> None:
    shutil.rmtree(PAGES, ignore_errors=True)
    for pattern in _COLLECTED:
        for file in filter(Path.is_file, ROOT.glob(pattern)):
            copy = PAGES / file.relative_to(ROOT)
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file, copy)


def _drawn(page: str) -> str:
    """The page with MathML and SVG in place of TeX and mermaid."""
    page = _INLINE.sub(lambda tex: _mathml(tex[1], "inline"), page)
    page = _BLOCK.sub(lambda tex: _mathml(tex[1], "block"), page)
    return _DIAGRAM.sub(lambda diagram: _svg(html.unescape(diagram[1])), page)


def _mathml(tex: str, display: str) -> str:
    # Imported by name, since the type check runs without the extra "docs".
    return str(import_module("latex2mathml.converter").convert(html.unescape(tex), display=display))


def _svg(diagram: str) -> str:
    file = diagram_file(diagram)
    if not file.exists():
        sys.exit(f"{file}: no drawing of the diagram that begins with {diagram.split(maxsplit=4)[:4]}; "
                 "run python docs/draw_diagrams.py, which needs npm and Chromium")
    return f'<div style="background: white">{file.read_text(encoding="utf-8")}</div>'


if __name__ == "__main__":
    sys.exit(main())
