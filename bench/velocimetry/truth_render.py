"""Time to render synthetic rivers: python bench/velocimetry/truth_render.py [--size 1920x1080] [--frames 5].

Processor time of one thread, so that other work on the machine hardly matters.
"""

from __future__ import annotations

import argparse
import time

from stab_ros.synthetic.moving_river import RiverFlight
from stab_ros.synthetic.river import SCENES
from stab_ros.synthetic.river_flows import FLOWS, flow_of
from stab_ros.synthetic.surface import PRESETS


def main() -> None:
    """Prints a row for each scene, flow and surface."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--size", default="1920x1080")
    parser.add_argument("--frames", type=int, default=5)
    parser.add_argument("--flow", choices=FLOWS, default="parabolic")
    options = parser.parse_args()
    width, height = map(int, options.size.split("x"))
    print("| scene | flow | surface | set-up, s | first frame, s | next frames, s |")
    print("|---|---|---|---|---|---|")
    for name, scene in SCENES.items():
        for look, surface in PRESETS.items():
            started = time.process_time()
            flight = RiverFlight(scene, flow_of(scene, options.flow), surface, (width, height), options.frames + 1)
            made = time.process_time()
            flight[0]
            first = time.process_time()
            for index in range(1, options.frames + 1):
                flight[index]
            each = (time.process_time() - first) / options.frames
            print(f"| {name} | {options.flow} | {look} | {made - started:.1f} | {first - made:.1f} | {each:.2f} |")


if __name__ == "__main__":
    main()
