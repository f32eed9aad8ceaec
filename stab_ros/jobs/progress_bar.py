"""Progress bars: only on a terminal, removed at the end."""

from __future__ import annotations

import shutil
from typing import Any

from tqdm import tqdm


def make_bar(unit: str, **options: Any) -> tqdm[None]:
    """A bar that counts items of the kind `unit`. options: those of tqdm."""
    columns, lines = shutil.get_terminal_size()  # tqdm shows nothing on a terminal of size 0
    return tqdm(unit=f" {unit}", ncols=min(100, columns), nrows=lines, disable=None, leave=False, **options)
