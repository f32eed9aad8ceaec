"""A rendered survey whose boards are marked in the picture: control points, and places of the water to hold out."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from board_picks import BORDER_PX, picked

from stab_ros.core.types import FloatArray, Gray
from stab_ros.georeferencing.control_points import ControlPoints
from stab_ros.imaging.view import View
from stab_ros.synthetic.survey_flight import SurveyFlight
from stab_ros.synthetic.survey_scenes import survey

CLICK_PX = 0.4  # by which the click that is refined lies beside the board


@dataclass(frozen=True, eq=False)
class RenderedSurvey:
    """Frame 0 of a flight. name: of the scene. lens: model and coefficients. size: of the picture, px."""

    name: str
    lens: tuple[str, tuple[float, ...]]
    size: tuple[int, int] = (1920, 1080)

    @cached_property
    def flight(self) -> SurveyFlight:
        return SurveyFlight(replace(survey(self.name), lens=self.lens), self.size, 1, seed=1)

    @cached_property
    def image(self) -> Gray:
        return np.asarray(self.flight.image(0), np.uint8)

    @property
    def view(self) -> View:
        """Exact camera and pose."""
        return self.flight.view(0)

    def control_points(self, marked: bool) -> ControlPoints:
        """Those that the picture shows; marked: their pixels by the picture, else exact."""
        flight, px = self.flight, self.flight.board_px(0)
        inner = (px > BORDER_PX) & (px < np.array(self.size) - 1 - BORDER_PX)
        chosen = np.flatnonzero(flight.is_control & inner.all(axis=1))
        pixels = np.array([picked(self.image, px[i] + CLICK_PX) if marked else px[i] for i in chosen])
        return ControlPoints(tuple(flight.board_names[i] for i in chosen), pixels, flight.board_m[chosen])

    @cached_property
    def water_px(self) -> FloatArray:
        """Pixels (n, 2) all over the picture that show water."""
        x, y = (np.linspace(40, n - 40, steps).round() for n, steps in zip(self.size, (13, 9), strict=True))
        pixels = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        column, row = pixels.astype(int).T
        return np.asarray(pixels[self.flight.water(0)[row, column]])

    def errors_m(self, view: View) -> FloatArray:
        """(n,) how far a view places the water of `water_px` from where it is."""
        off = view.to_plane(self.water_px, self.flight.wse_m) - self.view.to_plane(self.water_px, self.flight.wse_m)
        return np.asarray(np.linalg.norm(off, axis=1))
