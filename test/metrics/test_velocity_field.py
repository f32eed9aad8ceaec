"""The residual velocity field: known residuals, opposite vectors, masks, outliers, and the mean over time."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from truth import IDENTITY, flat, picture, similarity, translation

from stab_ros.core.geometry import apply
from stab_ros.core.types import BoolArray, FloatArray, Gray
from stab_ros.metrics.velocity_field import Field, RegionVelocity, VelocityField, mean_field
from stab_ros.synthetic.flight import Flight, preset

SIZE = (640, 480)
ANYWHERE: BoolArray = np.ones(SIZE[::-1], bool)
RESIDUALS = ((0.05, 20), (0.2, 160), (0.5, 275), (1.0, 90), (2.0, 215), (4.0, 330))  # px, degrees


@cache
def velocity_field(noise: float = 0.0) -> VelocityField:
    return VelocityField(picture(IDENTITY, SIZE, noise=noise), ANYWHERE, 4, 3)


def moved(u: float, v: float, noise: float = 0.0, gain: float = 1.0) -> Gray:
    return picture(translation(-u, -v), SIZE, noise=noise, gain=gain)


def means(field: Field) -> FloatArray:
    """(regions, 3): u, v and magnitude."""
    return np.array([(r.u_px, r.v_px, r.magnitude_px) for r in field.regions])


@pytest.mark.parametrize(("length_px", "degrees"), RESIDUALS)
@pytest.mark.parametrize(("noise", "tolerance_px"), [(0.0, 0.002), (2.0, 0.02)])
def test_every_region_recovers_a_known_residual(length_px: float, degrees: float, noise: float,
                                                tolerance_px: float) -> None:
    u, v = length_px * np.cos(np.radians(degrees)), length_px * np.sin(np.radians(degrees))
    field = velocity_field(noise).measure(moved(u, v, noise), ANYWHERE)
    assert np.abs(means(field) - (u, v, length_px)).max() < tolerance_px
    assert all(region.vectors == 9 for region in field.regions)


def test_a_brightness_change_is_no_motion() -> None:
    field = velocity_field().measure(moved(0, 0, gain=1.05), ANYWHERE)
    assert np.abs(means(field)).max() < 0.002


def test_what_moves_off_the_plane_is_no_ground() -> None:
    """Water in the right half, one frame later: its look is still the same."""
    current = np.hstack([moved(0.5, 0)[:, :320], moved(3, 0)[:, 320:]])
    unknown, known = (velocity_field().measure(current, ANYWHERE, plane) for plane in (None, translation(-0.5, 0)))
    assert np.nanmax(means(unknown)) > 2.9
    left, right = (np.array([side(r.x_px, 320) for r in known.regions]) for side in (np.less, np.greater))
    assert means(known)[left] == pytest.approx(np.tile([0.5, 0, 0.5], (6, 1)), abs=0.1)
    assert all(region.vectors <= 3 for region, wet in zip(known.regions, right, strict=True) if wet)
    assert np.nanmax(means(known)) < 0.6


def test_opposite_vectors_cancel_in_the_mean_but_not_in_the_magnitude() -> None:
    allowed = np.zeros_like(ANYWHERE)
    allowed[150:330, 60:200] = allowed[150:330, 440:580] = True
    current = np.hstack([moved(2, 0)[:, :320], moved(-2, 0)[:, 320:]])
    field = VelocityField(picture(IDENTITY, SIZE, noise=0), allowed, 1, 1).measure(current, ANYWHERE)
    (region,) = field.regions
    left = field.centres_px[:, 0] < 320
    assert left.sum() == (~left).sum() == region.vectors / 2
    assert (region.u_px, region.v_px) == pytest.approx((0, 0), abs=0.002)
    assert region.magnitude_px == pytest.approx(2, abs=0.002)


def test_regions_are_numbered_row_by_row_and_have_their_own_vectors() -> None:
    current = moved(0, 0)
    current[160:320, 320:480] = moved(0.7, -0.4)[160:320, 320:480]  # the region 6 of 4 x 3
    field = velocity_field().measure(current, ANYWHERE)
    assert [(r.region, r.x_px, r.y_px) for r in field.regions] == [
        (4 * row + column, 79.5 + 160 * column, 79.5 + 160 * row) for row in range(3) for column in range(4)]
    inside = np.all(np.abs(field.centres_px - (399.5, 239.5)) <= 48, axis=1)  # areas wholly in what moved
    assert inside.any()
    assert np.abs(field.shifts_px[inside] - (0.7, -0.4)).max() < 0.005
    assert np.abs(means(field)[[0, 3, 8, 11]]).max() < 0.005


def test_the_means_are_those_of_the_vectors() -> None:
    H = similarity(0.3, 1.003, 0.4, -0.7, SIZE)
    field = velocity_field(1.0).measure(picture(H, SIZE, noise=1.0), ANYWHERE)
    truth = apply(np.linalg.inv(H), field.centres_px) - field.centres_px
    assert np.nanmax(np.abs(field.shifts_px - truth)) < 0.06
    assert np.abs(np.nanmean(field.shifts_px - truth, axis=0)).max() < 0.005
    own = (field.centres_px // 160) @ (1, 4)  # areas have their centre in their region
    for region in field.regions:
        vectors = field.shifts_px[own == region.region]
        assert (region.u_px, region.v_px) == pytest.approx(vectors.mean(axis=0))
        assert region.magnitude_px == pytest.approx(np.sqrt((vectors**2).sum(axis=1)).mean())


def test_raw_video_is_measured_too() -> None:
    H = similarity(1.0, 1.01, 22, -20, SIZE)
    field = velocity_field(1.0).measure(picture(H, SIZE, noise=1.0), ANYWHERE)
    truth = apply(np.linalg.inv(H), field.centres_px) - field.centres_px
    assert np.hypot(*truth.T).max() > 30
    assert np.isfinite(field.shifts_px[:, 0]).mean() > 0.8
    assert np.nanmax(np.abs(field.shifts_px - truth)) < 0.2


def test_areas_lie_wholly_where_they_are_allowed() -> None:
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    allowed = np.abs(y - 240 - 80 * np.sin(x / 90)) > 70  # beside a winding river
    river = VelocityField(picture(IDENTITY, SIZE, noise=0), allowed, 4, 3)
    field = river.measure(moved(0.3, 0.1), ANYWHERE)
    assert len(field.centres_px) > 20
    for column, row in field.centres_px.astype(int):
        assert allowed[row - 32 : row + 32, column - 32 : column + 32].all()
    assert np.isfinite(field.shifts_px).all()
    nowhere = VelocityField(moved(0, 0), np.zeros_like(ANYWHERE), 2, 2).measure(moved(0, 0), ANYWHERE)
    assert nowhere.centres_px.shape == (0, 2)
    assert np.isnan(means(nowhere)).all()
    assert [region.vectors for region in nowhere.regions] == [0, 0, 0, 0]


def test_areas_do_not_overlap_by_more_than_half() -> None:
    centres = velocity_field().measure(moved(0, 0), ANYWHERE).centres_px
    distance = np.abs(centres[:, None] - centres).max(axis=2) + 1000 * np.eye(len(centres))
    assert distance.min() >= 32


def test_areas_cut_by_the_invalid_part_do_not_count() -> None:
    valid, current = ANYWHERE.copy(), moved(1.3, 0)
    valid[:, :100], current[:, :100] = False, 0
    field, whole = velocity_field().measure(current, valid), velocity_field().measure(moved(1.3, 0), ANYWHERE)
    inside = field.centres_px[:, 0] - 32 >= 100
    np.testing.assert_array_equal(np.isfinite(field.shifts_px[:, 0]), inside)
    np.testing.assert_array_equal(field.shifts_px[inside], whole.shifts_px[inside])
    own = (field.centres_px // 160) @ (1, 4)
    assert [region.vectors for region in field.regions] == [(own[inside] == region).sum() for region in range(12)]


def test_areas_without_texture_do_not_count() -> None:
    def half(gray: Gray, other: Gray) -> Gray:
        return np.hstack([gray[:, :285], other[:, 285:]])

    reference, current = half(moved(0, 0), flat(90, size=SIZE)), half(moved(0.2, 0), flat(91, size=SIZE))
    textured, _, bare = VelocityField(reference, ANYWHERE, 3, 1).measure(current, ANYWHERE).regions
    assert textured.u_px == pytest.approx(0.2, abs=0.005)
    assert bare.vectors == 0
    assert np.isnan([bare.u_px, bare.v_px, bare.magnitude_px]).all()


def test_a_single_area_that_moves_on_its_own_is_left_out() -> None:
    """The normalised median test: a stone that was kicked, not a part of the field."""
    x, y = velocity_field().measure(moved(0, 0), ANYWHERE).centres_px[58].astype(int)
    current = moved(0.3, 0)
    current[y - 32 : y + 32, x - 32 : x + 32] = moved(3.3, 2)[y - 32 : y + 32, x - 32 : x + 32]
    field = velocity_field().measure(current, ANYWHERE)
    assert np.isnan(field.shifts_px[58]).all()
    kept = np.isfinite(field.shifts_px[:, 0])
    assert kept.sum() > 95
    assert np.abs(np.median(field.shifts_px[kept], axis=0) - (0.3, 0)).max() < 0.002


@pytest.mark.parametrize("size", [(64, 64), (97, 65), (33, 20), (200, 120)])
def test_small_pictures_and_many_regions(size: tuple[int, int]) -> None:
    reference, valid = picture(IDENTITY, size, noise=0), np.ones(size[::-1], bool)
    for columns, rows in ((1, 1), (4, 3), (50, 50)):
        field = VelocityField(reference, valid, columns, rows).measure(
            picture(translation(-0.5, 0.25), size, noise=0), valid)
        assert len(field.regions) == columns * rows
        assert np.nanmax(np.abs(field.shifts_px - (0.5, -0.25)), initial=0.0) < 0.02
        assert sum(region.vectors for region in field.regions) == np.isfinite(field.shifts_px[:, 0]).sum()


def test_a_flight_over_a_river_beside_its_water() -> None:
    flight = Flight(preset("alpine"), size=(640, 360), frames=12, seed=5)
    first, valid = flight[0], np.ones((360, 640), bool)
    banks = VelocityField(first.image, ~first.water, 4, 3)
    for index in (1, 6, 11):
        shot = flight[index]
        field = banks.measure(shot.image, valid)
        error = field.shifts_px - (apply(np.linalg.inv(shot.ref_H_cur), field.centres_px) - field.centres_px)
        assert np.isfinite(error).mean() > 0.8
        assert np.nanmedian(np.abs(error)) < 0.03


def test_the_mean_over_time_by_hand() -> None:
    centres = np.array([[10.0, 10.0], [20.0, 10.0], [30.0, 10.0], [15.0, 20.0]])
    nothing, region = [np.nan, np.nan], np.array([0, 0, 1, 0])
    over_time = [np.array(vectors) for vectors in (
        [[1.0, 0.0], [3.0, 4.0], [9.0, 9.0], [8.0, 0.0]], [[-2.0, 1.0], nothing, nothing, nothing],
        [[4.0, 2.0], [5.0, 0.0], nothing, nothing])]
    empty = (RegionVelocity(0, 15.0, 10.0, np.nan, np.nan, np.nan, 0),
             RegionVelocity(1, 30.0, 10.0, np.nan, np.nan, np.nan, 0))
    mean = mean_field([Field(centres, vectors, region, empty) for vectors in over_time])
    np.testing.assert_array_equal(mean.centres_px, centres)
    np.testing.assert_allclose(mean.shifts_px, [[1.0, 1.0], [4.0, 2.0], nothing, nothing])
    static, water = mean.regions
    assert (static.region, static.x_px, static.y_px, static.vectors) == (0, 15.0, 10.0, 5)
    assert static.u_px == pytest.approx((1 + 3 - 2 + 4 + 5) / 5), "not the area that was found once in three pictures"
    assert static.v_px == pytest.approx((0 + 4 + 1 + 2 + 0) / 5)
    assert static.magnitude_px == pytest.approx((1 + 5 + 5**0.5 + 20**0.5 + 5) / 5)
    assert water.vectors == 0, "found once in three pictures: water"
    assert np.isnan([water.u_px, water.v_px, water.magnitude_px]).all()
    assert np.isfinite(over_time[0]).all(), "what was measured is left as it was"


def test_the_mean_of_one_field_is_that_field() -> None:
    field = velocity_field().measure(moved(0.4, 0.1), ANYWHERE)
    mean = mean_field([field])
    np.testing.assert_array_equal(mean.shifts_px, field.shifts_px)
    np.testing.assert_allclose(means(mean), means(field), rtol=1e-12)


def test_misuse_is_an_error() -> None:
    with pytest.raises(ValueError, match="mask"):
        VelocityField(moved(0, 0), ANYWHERE[1:], 2, 2)
    with pytest.raises(ValueError, match="at least one"):
        VelocityField(moved(0, 0), ANYWHERE, 0, 2)
    with pytest.raises(ValueError, match="as the reference"):
        velocity_field().measure(moved(0, 0)[1:], ANYWHERE)
    with pytest.raises(ValueError, match="some"):
        mean_field([])
    with pytest.raises(ValueError, match=r"must be \(n, 2\)"):
        Field(np.zeros((3, 2)), np.zeros((2, 2)), np.zeros(3, np.int64), ())
