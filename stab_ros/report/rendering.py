"""Renders a template to `index.html`, for both kinds of report."""

from __future__ import annotations

import json
from importlib.resources import files
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup

from stab_ros.core.errors import WorkError
from stab_ros.core.version import __version__
from stab_ros.evaluation.summary import Json
from stab_ros.io.outputs import completed

_NAME = "index.html"


def rendered(template: str, **values: Any) -> str:
    """The page; a template variable without a value is an error."""
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True,
                                     lstrip_blocks=True, loader=jinja2.FunctionLoader(own_file))
    return environment.get_template(template).render(version=__version__, style=Markup(own_file("style.css")), **values)


def write_page(text: str, folder: Path) -> Path:
    """Raises InputError where the folder cannot be written into, WorkError where the disk is full."""
    path = folder / _NAME
    with completed(path) as partial:
        try:
            partial.write_text(text, encoding="utf-8", errors="replace")  # names of files may hold any bytes
        except OSError as error:
            raise WorkError(f"{path}: {error.strerror}") from error
    return path


def embedded(tree: Json) -> Markup:
    """JSON as the content of a script element, escaped so that it cannot end the element."""
    text: Any = json.dumps(tree, allow_nan=False)
    return Markup(text.replace("<", "\\u003c").replace("&", "\\u0026"))


def own_file(name: str) -> str:
    """The text of a file of this package."""
    return files(__package__).joinpath(name).read_text(encoding="utf-8")
