"""Draws docs/images/synthetic_rivers.png: frames of synthetic rivers with their true velocities.

python docs/draw_rivers.py
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from PIL import Image as PilImage

from stab_ros.core.geometry import apply
from stab_ros.core.types import Image
from stab_ros.synthetic.moving_river import RiverFlight
from stab_ros.synthetic.river import preset
from stab_ros.synthetic.river_flows import flow_of
from stab_ros.synthetic.surface import DISTURBED, SurfaceSettings

PICTURE = Path(__file__).parent / "images/synthetic_rivers.png"
SIZE = (448, 252)
SPACING_PX, LONGEST_PX = 28, 30
_PANELS = (
    ("kolubara", "asymmetric", replace(SurfaceSettings(), particles_per_m2=1.0)),
    ("alpine", "parabolic", DISTURBED),
    ("basento", "eddy", replace(DISTURBED, waves=0.0, glint=0.0, particles_per_m2=8.0)),
    ("kolubara", "parabolic", replace(SurfaceSettings(), bed=1.0, clear_m=4.0, glint=90.0, standing_waves=10.0)),
)


def main() -> None:
    """Draws four flows, the second and third with arrows."""
    panels = [_panel(*what, arrows=k in {1, 2}) for k, what in enumerate(_PANELS)]
    picture = np.vstack([np.hstack(panels[:2]), np.hstack(panels[2:])])
    coloured = PilImage.fromarray(np.ascontiguousarray(picture[..., ::-1]))
    coloured.quantize(128).save(PICTURE, optimize=True)


def _panel(scene: str, kind: str, surface: SurfaceSettings, arrows: bool) -> Image:
    flight = RiverFlight(preset(scene), flow_of(preset(scene), kind), surface, SIZE, 1, seed=1, color=True)
    image = flight[0].image.copy()
    if arrows:
        _draw_arrows(flight, image)
    return image


def _draw_arrows(flight: RiverFlight, image: Image) -> None:
    u, v = np.meshgrid(np.arange(10, SIZE[0], SPACING_PX), np.arange(10, SIZE[1], SPACING_PX))
    pixels = np.column_stack([u.ravel(), v.ravel()]).astype(float)
    places = apply(flight.map_H_image(0), pixels)
    wet = flight.shore_distance_m(places) > 0
    velocity = flight.velocity_m_s(places, flight.stamp_ns(0))
    seconds = LONGEST_PX * flight.gsd_m / np.hypot(*velocity[wet].T).max()
    ends = apply(np.linalg.inv(flight.map_H_image(0)), places + seconds * velocity)
    for start, end in zip(pixels[wet], ends[wet], strict=True):
        tail, tip = ((round(float(x)), round(float(y))) for x, y in (start, end))
        cv2.arrowedLine(image, tail, tip, (60, 220, 255), 1, cv2.LINE_AA, tipLength=0.3)


if __name__ == "__main__":
    main()
