"""Random flights, and each frame of which the tracker says what is not so: `python bench/lies/run.py --help`."""

import sys
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
    from lies.search import main

    sys.exit(main())
