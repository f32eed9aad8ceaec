"""Boards marked in a rendered picture, with relief and a lens, place the water all over it."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from rendered_survey import RenderedSurvey

from stab_ros.georeferencing.camera_fit import fit_camera, fit_pose
from stab_ros.georeferencing.camera_problem import Unknowns
from stab_ros.synthetic.survey_scenes import RATIONAL

WITHIN_M = 0.02


@cache
def lensed() -> RenderedSurvey:
    return RenderedSurvey("nadir", RATIONAL)


@pytest.mark.thorough
def test_a_calibrated_camera_places_the_water_from_46_m() -> None:
    survey, points = lensed(), lensed().control_points(marked=True)
    assert np.abs(points.image_px - survey.control_points(marked=False).image_px).max() < 0.035
    assert survey.errors_m(fit_pose(points, survey.view.camera).view).max() < 0.2 * WITHIN_M
    by_focal = fit_camera(points, survey.size, camera=survey.view.camera)
    assert survey.errors_m(by_focal.view).max() < 0.2 * WITHIN_M


@pytest.mark.thorough
def test_what_one_coefficient_leaves_of_a_lens_shows_where_no_point_is() -> None:
    """Exact pixels: the error is that of the camera's model, at the border of the picture."""
    survey = lensed()
    fit = fit_camera(survey.control_points(marked=False), survey.size, Unknowns(k1=True))
    off = survey.errors_m(fit.view)
    assert np.median(off) < WITHIN_M < off.max()
    outer = np.abs(survey.water_px[:, 0] / survey.size[0] - 0.5) > 0.4
    assert outer[np.argmax(off)]
