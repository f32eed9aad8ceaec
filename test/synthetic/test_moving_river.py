"""Flights over moving rivers: what drifts does so by the velocity field, what does not drift stays."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
import pytest

from stab_ros.core.errors import InputError
from stab_ros.core.geometry import apply
from stab_ros.core.types import FloatArray, Image
from stab_ros.synthetic.camera_path import Gust, Motion, Pose
from stab_ros.synthetic.flight import Flight
from stab_ros.synthetic.moving_river import RiverFlight
from stab_ros.synthetic.river import SceneSettings, preset
from stab_ros.synthetic.river_flows import flow_of
from stab_ros.synthetic.surface import DISTURBED, G_M_S2, SurfaceSettings
from stab_ros.synthetic.velocity_fields import Uniform, VelocityField

SIZE = (320, 180)
BLANK = SurfaceSettings(texture=0.0, particles_per_m2=0.0)
HOVER = Motion(Pose(), 0.1)


def clean(scene: SceneSettings) -> SceneSettings:
    """A still camera without noise and brightness changes."""
    return replace(scene, motion=HOVER, noise_levels=0.0, brightness=0.0, duration_s=0.5)


def flooded(scene: SceneSettings) -> SceneSettings:
    """Water everywhere."""
    return replace(clean(scene), stream=replace(scene.stream, width=9.0), islands=(), control_points=())


pytestmark = pytest.mark.slow  # each flight takes a second to be made

KOLUBARA, ALPINE, BASENTO = (preset(name) for name in ("kolubara", "alpine", "basento"))


def shift(before: Image, after: Image) -> FloatArray:
    """How far `after` lies to the right of and below `before`, px, by the phases of their cross spectrum.

    Kuglin and Hines (1975); the slope of the phase is fitted to what changes slowly (Stone et al. 2001). The window of
    `after` follows what was found, so that both show the same part of the pattern.
    """
    found = np.zeros(2)
    for _ in range(4):
        found = found + _phase_slope(before, after, found)
    return found


def _phase_slope(before: Image, after: Image, so_far: FloatArray) -> FloatArray:
    rows, columns = before.shape
    fy, fx = np.meshgrid(np.fft.fftfreq(rows), np.fft.fftfreq(columns), indexing="ij")
    a, b = (np.fft.fft2((image - image.mean()) * np.outer(hann(rows, y), hann(columns, x)))
            for image, (x, y) in ((before.astype(float), np.zeros(2)), (after.astype(float), so_far)))
    cross = np.conj(a) * b * np.exp(2j * np.pi * (fx * so_far[0] + fy * so_far[1]))
    slow = (np.hypot(fx, fy) < 0.14) & (np.hypot(fx, fy) > 0.02)
    weight = np.sqrt(np.abs(cross[slow]))
    design = -2 * np.pi * np.column_stack([fx[slow], fy[slow]]) * weight[:, None]
    return np.asarray(np.linalg.lstsq(design, np.angle(cross[slow]) * weight, rcond=None)[0])


def hann(n: int, shifted_px: float) -> FloatArray:
    """Hann's window (n,), moved, and narrow enough to be within the picture after that."""
    t = (np.arange(n) - (n - 1) / 2 - shifted_px) / (n / 2 - 1.5)
    return np.where(np.abs(t) < 1, 0.5 + 0.5 * np.cos(np.pi * t), 0)


def drift(flight: RiverFlight, index: int, whole_px: tuple[int, int], window: tuple[slice, slice]) -> FloatArray:
    """Measured displacement in a window from frame `index` to the next, px, near whole pixels."""
    before, after = (flight[k].image for k in (index, index + 1))
    return shift(before[window], np.roll(after, (-whole_px[1], -whole_px[0]), (0, 1))[window]) + whole_px


@pytest.mark.parametrize(("x_px", "y_px"), [(3.37, 0.0), (0.52, -1.81)])
def test_texture_moves_with_a_uniform_flow(x_px: float, y_px: float) -> None:
    scene = flooded(BASENTO)
    per_px = scene.ground_m[0] / SIZE[0] * scene.fps
    surface = replace(BLANK, texture=12.0, texture_life_s=25.0)
    flight = RiverFlight(scene, Uniform(x_px * per_px, -y_px * per_px), surface, SIZE, 12, seed=3)
    whole = round(x_px), round(y_px)
    found = [drift(flight, k, whole, np.s_[8:-8, 8:-8]) for k in range(0, 11, 2)]
    assert np.abs(np.array(found) - (x_px, y_px)).max() < 0.01


def errors_in_shear(seed: int) -> FloatArray:
    """Errors (5, 2), px, of the displacement in 5 strips along the river, mean of 7 frames, in a parabolic flow."""
    scene = replace(clean(BASENTO), stream=replace(BASENTO.stream, centre=0.5, width=0.9, bend=0.0), control_points=())
    flight = RiverFlight(scene, surface=replace(BLANK, texture=12.0), size=SIZE, frames=8, seed=seed)
    errors = []
    for share in (-0.7, -0.3, 0.0, 0.4, 0.7):
        row = round((0.5 - share * 0.45) * SIZE[1])
        north_m = (SIZE[1] / 2 - 0.5 - np.arange(row - 12, row + 12)) * flight.gsd_m
        velocity = flight.velocity_m_s(np.column_stack([np.zeros(24), north_m]), flight.stamp_ns(0))[:, 0]
        truth = np.average(velocity, weights=hann(24, 0.0) ** 2) / scene.fps / flight.gsd_m
        found = [drift(flight, k, (0, 0), np.s_[row - 12:row + 12, 10:-10]) for k in range(7)]
        errors.append(np.mean(found, axis=0) - (truth, 0))
    return np.array(errors)


def test_texture_moves_with_the_water_around_it() -> None:
    # of 0.28 to 0.56 px each frame; the rest is that patches are renewed as fast as shear tears them
    assert np.abs(errors_in_shear(5)).max() < 0.02


@pytest.mark.thorough
def test_renewal_of_the_texture_has_no_direction() -> None:
    errors = np.array([errors_in_shear(seed) for seed in range(12)])
    assert np.abs(errors.mean(axis=(0, 1))).max() < 0.003
    assert np.abs(errors.mean(axis=0)).max() < 0.012


def centroids(image: Image, near_px: FloatArray) -> FloatArray:
    """Centres (N, 2) of bright spots by the moments of what exceeds the water, within 5 px."""
    found = []
    for x, y in near_px:
        left, top = round(x) - 5, round(y) - 5
        part = image[top:top + 11, left:left + 11].astype(float) - 78
        v, u = np.mgrid[top:top + 11, left:left + 11]
        found.append(((u * part).sum() / part.sum(), (v * part).sum() / part.sum()))
    return np.array(found)


@pytest.mark.parametrize("kind", ["parabolic", "eddy", "unsteady"])
def test_particles_are_where_the_field_carried_them(kind: str) -> None:
    scene = replace(flooded(BASENTO), motion=BASENTO.motion)
    surface = replace(BLANK, particles_per_m2=0.7, particle_level=150.0, particle_px=(3.5, 4.5))
    flight = RiverFlight(scene, flow_of(BASENTO, kind), surface, SIZE, 20, seed=2)
    start, end = flight.particles_m(flight.stamp_ns(0)), flight.particles_m(flight.stamp_ns(19))
    _, i, j = np.intersect1d(start[:, 3], end[:, 3], return_indices=True)
    drifted = flight.drifted_m(start[i, :2], flight.stamp_ns(0), flight.stamp_ns(19))
    np.testing.assert_allclose(end[j, :2], drifted, atol=1e-4)
    map_H_image, image = flight.map_H_image(19), flight[19].image
    seen = apply(np.linalg.inv(map_H_image), drifted)
    gaps = np.linalg.norm(apply(np.linalg.inv(map_H_image), end[:, :2])[:, None] - seen, axis=2)
    alone = (np.sort(gaps, axis=0)[1] > 13) & (end[j, 2] > 30)
    inside = np.all((seen > 8) & (seen < np.array(SIZE) - 9), axis=1) & alone
    assert inside.sum() >= 10
    errors = centroids(image, seen[inside]) - seen[inside]
    assert np.abs(errors).max() < 0.06  # grey levels are whole numbers
    assert np.abs(errors.mean(axis=0)).max() < 0.015
    moved = np.linalg.norm(drifted - start[i, :2], axis=1)[inside] / flight.gsd_m
    assert moved.max() > 5


def test_bed_and_glint_stay_while_the_water_flows() -> None:
    surface = replace(BLANK, bed=1.0, glint=60.0, clear_m=2.0)
    flight = RiverFlight(clean(KOLUBARA), Uniform(1.0), surface, SIZE, 6, seed=1)
    np.testing.assert_array_equal(flight[0].image, flight[5].image)
    plain = RiverFlight(clean(KOLUBARA), Uniform(1.0), BLANK, SIZE, 1, seed=1)[0].image.astype(int)
    assert (flight[0].image - plain)[flight.water].std() > 5


def test_the_bed_moves_with_the_ground_and_the_glint_with_the_camera_turned() -> None:
    gust = Gust(0.0, 1 / KOLUBARA.fps, Pose(x_m=4 * KOLUBARA.ground_m[0] / SIZE[0]))
    shifted = replace(flooded(KOLUBARA), motion=replace(HOVER, gusts=(gust,)))
    bed = RiverFlight(shifted, Uniform(0.7), replace(BLANK, bed=1.0, clear_m=50.0), SIZE, 2)
    assert shift(bed[0].image[:, 20:-20], np.roll(bed[1].image, 4, axis=1)[:, 20:-20]) == pytest.approx(0, abs=0.01)
    glint = RiverFlight(shifted, Uniform(0.7), replace(BLANK, glint=60.0), SIZE, 2)
    np.testing.assert_array_equal(glint[0].image, glint[1].image)
    turned = replace(shifted, motion=replace(HOVER, gusts=(Gust(0.0, 1 / KOLUBARA.fps, Pose(pitch_deg=2.0)),)))
    a, b = (shot.image for shot in RiverFlight(turned, Uniform(0.7), replace(BLANK, glint=60.0), SIZE, 2))
    expected = 0.67 * SIZE[0] * np.radians(2.0)
    assert shift(a, np.roll(b, -round(expected), axis=0))[1] + round(expected) == pytest.approx(expected, abs=1.5)


def test_the_sun_is_mirrored_where_reflection_demands_it() -> None:
    surface = replace(BLANK, glint=60.0, sun_zenith_deg=10.0, sun_azimuth_deg=0.0)
    image = RiverFlight(flooded(KOLUBARA), Uniform(0.1), surface, SIZE, 1)[0].image
    smooth = cv2.GaussianBlur(image.astype(np.float32), (0, 0), 12)
    _, column = np.unravel_index(int(smooth.argmax()), smooth.shape)
    # the sun stands in the east, and so does its reflection: at height tan(10 deg) from below the camera
    assert column == pytest.approx(SIZE[0] / 2 + 0.67 * SIZE[0] * np.tan(np.radians(10)), abs=8)


def test_wind_waves_run_with_their_own_speed_over_the_water() -> None:
    scene, current = flooded(BASENTO), 0.3
    surface = replace(BLANK, waves=20.0, wave_m=0.7, wind_deg=180.0)
    flight = RiverFlight(scene, Uniform(current), surface, SIZE, 2, seed=4)
    gsd_m = flight.gsd_m
    window = np.outer(np.hanning(SIZE[1]), np.hanning(SIZE[0]))
    a, b = (np.fft.fft2((shot.image - 78.0) * window) for shot in flight)
    kx = 2 * np.pi * np.fft.fftfreq(SIZE[0], gsd_m)
    ky = -2 * np.pi * np.fft.fftfreq(SIZE[1], gsd_m)
    rows, columns = np.unravel_index(np.argsort(np.abs(a), axis=None)[-12:], a.shape)
    upstream = kx[columns] < 0  # of each pair k and -k, that along which the waves run
    k = np.hypot(kx[columns], ky[rows])[upstream]
    advance = -np.angle(b * np.conj(a))[rows, columns][upstream] * scene.fps
    np.testing.assert_allclose(advance, np.sqrt(G_M_S2 * k) + current * kx[columns][upstream], rtol=0.06)


def test_standing_waves_stand() -> None:
    flight = RiverFlight(flooded(ALPINE), Uniform(2.0), replace(BLANK, standing_waves=12.0), SIZE, 4)
    np.testing.assert_array_equal(flight[0].image, flight[3].image)
    assert np.ptp(flight[0].image) > 12


@pytest.mark.parametrize("field", [Uniform(0.7, 0.2), flow_of(BASENTO, "eddy"), flow_of(BASENTO)])
def test_density_stays_even(field: VelocityField) -> None:
    scene = flooded(BASENTO)
    flight = RiverFlight(scene, field, replace(BLANK, particles_per_m2=30.0), SIZE, 1, seed=6)
    width, height = (0.9 * side for side in scene.ground_m)
    counts = []
    for time_s in (0.0, 3.3, 7.1, 20.0, 63.7):
        east, north, bright, _ = flight.particles_m(flight.start_ns + round(time_s * 1e9)).T
        counts.append(np.histogram2d(east, north, bins=(6, 4), weights=bright,
                                     range=[[-width / 2, width / 2], [-height / 2, height / 2]])[0])
    share = np.array(counts) / (30.0 * width * height / 24 * 100.0 * 0.7)
    assert np.abs(share.mean(axis=(1, 2)) - 1).max() < 0.04
    assert np.abs(share.mean(axis=0) - 1).max() < 0.12
    assert share.std() < 0.14  # of particles strewn at random: 0.17


@pytest.mark.parametrize("per_m2", [0.5, 8.0])
def test_seeding_is_as_dense_as_asked_for(per_m2: float) -> None:
    flight = RiverFlight(flooded(BASENTO), Uniform(0.3), replace(BLANK, particles_per_m2=per_m2), SIZE, 1)
    east, north, bright, _ = flight.particles_m(flight.stamp_ns(0)).T
    inside = (np.abs(east) < 4.5) & (np.abs(north) < 2.5)
    assert (bright[inside] > 0).sum() / 45 == pytest.approx(2 * per_m2, rel=0.25)


@pytest.mark.thorough
def test_texture_is_as_strong_as_asked_for_and_everywhere() -> None:
    flight = RiverFlight(flooded(ALPINE), flow_of(ALPINE), replace(BLANK, texture=10.0), SIZE, 3)
    blocks = flight[2].image.astype(float).reshape(6, 30, 8, 40).swapaxes(1, 2).std(axis=(2, 3))
    assert blocks.mean() == pytest.approx(10, rel=0.25)
    assert blocks.min() > 4


def test_frames_do_not_depend_on_the_order_they_are_asked_for() -> None:
    a, b = (RiverFlight(BASENTO, flow_of(BASENTO, "unsteady"), DISTURBED, SIZE, 9, seed=4) for _ in range(2))
    late, early = a[8], a[1]
    np.testing.assert_array_equal(b[1].image, early.image)
    np.testing.assert_array_equal(b[8].image, late.image)


def test_places_in_the_map_are_exact() -> None:
    flight = RiverFlight(ALPINE, size=SIZE, frames=5)
    shot = flight[4]
    pixels = apply(np.linalg.inv(shot.ref_H_cur), flight.control_points_px)
    np.testing.assert_allclose(apply(shot.map_H_image, pixels), flight.control_points_map_m[:, :2], atol=1e-9)
    np.testing.assert_allclose(flight.view(4).project(flight.control_points_map_m), pixels, atol=1e-6)


def test_ground_is_that_of_a_plain_flight() -> None:
    plain, moving = Flight(KOLUBARA, SIZE, 3, seed=7), RiverFlight(KOLUBARA, size=SIZE, frames=3, seed=7)
    np.testing.assert_array_equal(plain.water, moving.water)
    dry = cv2.dilate(plain.water.astype(np.uint8), np.ones((25, 25))) == 0
    np.testing.assert_array_equal(plain[0].image[dry], moving[0].image[dry])


def test_the_shore_is_where_it_is_seen() -> None:
    flight = RiverFlight(ALPINE, size=SIZE, frames=1)
    v, u = np.mgrid[0:SIZE[1], 0:SIZE[0]].reshape(2, -1)
    distance = flight.shore_distance_m(apply(flight.map_H_image(0), np.column_stack([u, v]).astype(float)))
    seen = flight.water.ravel()
    assert distance[~seen].max() < 0
    assert distance[seen].min() > -2.5 * flight.gsd_m


def test_colour_pictures_show_the_same_river() -> None:
    grey, colour = (RiverFlight(BASENTO, size=SIZE, frames=1, color=color)[0].image for color in (False, True))
    assert colour.shape == (SIZE[1], SIZE[0], 3)
    assert np.corrcoef(cv2.cvtColor(colour, cv2.COLOR_BGR2GRAY).ravel(), grey.ravel())[0, 1] > 0.95


def test_a_vector_has_the_mean_velocity_of_its_way() -> None:
    flight = RiverFlight(BASENTO, flow_of(BASENTO, "eddy"), BLANK, SIZE, 30)
    points, (start, end) = np.array([[0.0, 0.0], [1.0, -1.0]]), (flight.stamp_ns(0), flight.stamp_ns(24))
    found = flight.mean_velocity_m_s(points, start, end)
    np.testing.assert_allclose(found * (end - start) * 1e-9, flight.drifted_m(points, start, end) - points)


@pytest.mark.parametrize("wrong", [
    lambda: SurfaceSettings(texture=-1.0), lambda: SurfaceSettings(texture_px=(0.0, 20.0)),
    lambda: SurfaceSettings(bed=1.5), lambda: SurfaceSettings(particle_px=(8.0, 2.0)),
    lambda: SurfaceSettings(wave_m=0.0),
])
def test_impossible_surfaces_are_refused(wrong: Callable[[], SurfaceSettings]) -> None:
    with pytest.raises(InputError, match="must"):
        wrong()
