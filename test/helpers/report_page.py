"""The HTML report as a browser reads it."""

from __future__ import annotations

import base64
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from stab_ros.core.types import Image


class Page(HTMLParser):
    """What a browser would make of it."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.source = path.read_text(encoding="utf-8")
        self.images: list[dict[str, str | None]] = []
        self.numbers: list[tuple[str, str]] = []  # JSON pointer and text
        self.links: list[str] = []
        self.ids: list[str] = []
        self.text = ""
        self.unnumbered = ""  # the text without the numbers that name their place
        self.scripts: dict[str, str] = {}
        self._stack: list[tuple[str, dict[str, str | None]]] = []
        self.feed(self.source)
        assert not self._stack, "every element is closed"

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        of = dict(attrs)
        self.ids += [of["id"] or ""] if "id" in of else []
        self.links += [value or "" for name, value in attrs if name in ("src", "href", "action", "data")]
        if tag == "img":
            self.images.append(of)
        if tag not in ("img", "meta", "link", "input", "br", "wbr"):
            self._stack.append((tag, of))

    def handle_endtag(self, tag: str) -> None:
        assert self._stack.pop()[0] == tag

    def handle_data(self, data: str) -> None:
        tag, of = self._stack[-1] if self._stack else ("", {})
        if tag == "script":
            self.scripts[of.get("id") or ""] = data
        elif tag != "style":
            self.text += " " + data
            pointer = of.get("data-pointer")
            if pointer is not None:
                self.numbers.append((pointer, data))
            self.unnumbered += " " + ("" if pointer is not None else data)


def looked_up(tree: Any, pointer: str) -> Any:
    """RFC 6901."""
    for step in pointer.split("/")[1:]:
        name = step.replace("~1", "/").replace("~0", "~")
        tree = tree[int(name)] if isinstance(tree, list) else tree[name]
    return tree


def decoded(uri: str) -> Image:
    content = base64.b64decode(uri.partition("base64,")[2])
    return np.asarray(cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR))
