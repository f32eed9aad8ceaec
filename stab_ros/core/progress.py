"""How long work reports its progress."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

# called after every item with how many are done, and of how many (None: not known)
Progress: TypeAlias = Callable[[int, int | None], None]
