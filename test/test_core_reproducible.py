"""The same frames give the same bits in every process: in one that compiles the kernels, in one that finds them."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

TRACK_ONE_FRAME = """
from truth import frame, picture, projective
from stab_ros.io.engine import make_stabilizer
stabilizer = make_stabilizer({})
stabilizer.track(frame(picture()))
track = stabilizer.track(frame(picture(projective()), 1))
print(*(x.hex() for x in [*track.ref_H_cur.ravel().tolist(), track.sigma_px, track.rmse_px]))
"""


def test_compiled_now_or_found_compiled(tmp_path: Path) -> None:
    here = Path(__file__).parent
    path = os.pathsep.join([str(here), *sys.path])
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path), "PYTHONPATH": path}
    words = [sys.executable, "-c", TRACK_ONE_FRAME]
    said = [subprocess.run(words, env=environment, cwd=here, stdout=subprocess.PIPE, text=True, timeout=300, check=True)
            .stdout.split() for _ in range(2)]
    assert len(said[0]) == 11
    assert said[0] == said[1]
