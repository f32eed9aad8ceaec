"""Progress bars: on a terminal alone, gone when they are done."""

from __future__ import annotations

import shutil
from typing import Any

from tqdm import tqdm


def make_bar(unit: str, **options: Any) -> tqdm[None]:
    """A bar that counts so many `unit`; options: of tqdm."""
    columns, lines = shutil.get_terminal_size()  # where a terminal says 0, tqdm alone would show nothing
    return tqdm(unit=f" {unit}", ncols=min(100, columns), nrows=lines, disable=None, leave=False, **options)
