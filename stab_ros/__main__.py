"""`python -m stab_ros` is `stab-ros`."""

import sys

from stab_ros.cli import main

sys.exit(main())
