"""Whether `sigma_px` and the covariance are true: errors against them, over many kinds of sequences."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np
from effort import Effort
from tables import Section, Table, number
from tqdm import tqdm

from stab_ros.core.geometry import apply, jacobian, rms_distance
from stab_ros.core.settings import Value
from stab_ros.core.types import FloatArray, Frame, Gray
from stab_ros.parameters.engines import make_stabilizer
from stab_ros.synthetic.flight import Flight, preset

PLOT = Path(__file__).resolve().parents[1] / "docs" / "uncertainty.png"
STILLS = Path(__file__).resolve().parents[2] / "shared" / "data" / "stills"
SMALL, HD, UHD = (960, 540), (1920, 1080), (4096, 2160)
_CHI2_2_95 = 5.991

Spoil = Callable[[Gray], Gray]


@dataclass(frozen=True)
class ErrorSample:
    """One flight. spoil: what is done to every picture but the first. half: that is excluded, 0 upper, 1 lower."""

    name: str
    preset: str = "kolubara"
    size: tuple[int, int] = SMALL
    seed: int = 1
    noise: float = 2.0
    spoil: Spoil | None = None
    values: Mapping[str, Value] = field(default_factory=dict)
    half: int | None = None
    still: str = ""

    @property
    def kind(self) -> str:
        """What is done to it."""
        if self.spoil is not None:
            return "blurred frames" if self.spoil in (_soft, _moved) else "fog and JPEG"
        if self.half is not None or self.values:
            return "few patches"
        return "small or without noise" if self.size[0] < SMALL[0] or self.noise == 0 else "usual"


def _fog(picture: Gray) -> Gray:
    """A third of the contrast, under the noise of the sensor."""
    noise = np.random.default_rng(int(picture[:8].sum())).normal(0, 2, picture.shape)
    return np.asarray(np.clip(picture / 3.0 + 120 + noise, 0, 255), np.uint8)


def _jpeg(picture: Gray) -> Gray:
    return np.asarray(cv2.imdecode(cv2.imencode(".jpg", picture, (cv2.IMWRITE_JPEG_QUALITY, 85))[1], 0), np.uint8)


def _soft(picture: Gray) -> Gray:
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), 2.0), np.uint8)


def _moved(picture: Gray) -> Gray:
    return np.asarray(cv2.blur(picture, (9, 1)), np.uint8)


SEQUENCES = (
    *(ErrorSample(f"{name}, seed {seed}", name, seed=seed) for name in ("kolubara", "alpine", "basento")
      for seed in (1, 2, 3)),
    *(ErrorSample(f"{name}, 480x270", name, (480, 270), 11) for name in ("kolubara", "alpine")),
    *(ErrorSample(f"{name}, 1920x1080", name, HD, 4) for name in ("kolubara", "alpine", "basento")),
    ErrorSample("kolubara, 4096x2160", size=UHD, seed=5),
    *(ErrorSample(f"{name}, noise {noise:g}", name, noise=noise, seed=6) for name in ("kolubara", "alpine")
      for noise in (0.0, 6.0)),
    *(ErrorSample(f"{name}, {what}", name, spoil=spoil, seed=7) for name in ("kolubara", "alpine") for what, spoil in
      (("fog", _fog), ("JPEG 85", _jpeg), ("soft", _soft), ("motion blur 9 px", _moved))),
    *(ErrorSample(f"{name}, 100 patches", name, seed=8, values={"direct.patches": 100, "start_s": 0.0})
      for name in ("kolubara", "alpine", "basento")),
    *(ErrorSample(f"{name}, one bank", name, seed=9, half=half)
      for name, half in (("kolubara", 0), ("kolubara", 1), ("alpine", 1), ("basento", 1))),
    *(ErrorSample(f"{still} as banks", name, seed=10, still=still)
      for name, still in (("kolubara", "IMG_9354.jpg"), ("basento", "DJI_0025.JPG"))),
)


@dataclass(frozen=True, eq=False)
class UncertaintyCourse:
    """One run: error and sigma of every tracked frame, px, and how far out the corners are, chi-square."""

    name: str
    error_px: FloatArray
    sigma_px: FloatArray
    corner_chi2: FloatArray
    lost: int

    @property
    def ratio(self) -> FloatArray:
        return np.asarray(self.error_px / self.sigma_px)

    @property
    def within_two(self) -> float:
        return float(np.mean(self.ratio <= 2))

    @property
    def corners(self) -> float:
        """Share of the corners inside their own 95 % ellipse."""
        return float(np.mean(self.corner_chi2 <= _CHI2_2_95))


def fly(one: ErrorSample, frames: int) -> UncertaintyCourse:
    """Tracks one sequence."""
    flight = flight_of(one, frames)
    stabilizer = make_stabilizer({**one.values, **area_of(one)})
    errors, sigmas, corners, lost = [], [], [], 0
    tracks = [track for frame in frames_of(one, flight) for track in stabilizer.answers(frame)]
    for track in [*tracks, *stabilizer.finish()]:
        true = flight.ref_H_cur(track.index)
        if track.index == 0:
            continue
        if track.ref_H_cur is None or track.covariance is None or track.sigma_px is None:
            lost += 1
            continue
        errors.append(rms_distance(track.ref_H_cur, true, one.size))
        sigmas.append(track.sigma_px)
        corners.append(_corner_chi2(track.ref_H_cur, true, track.covariance, one.size))
    return UncertaintyCourse(one.name, np.array(errors), np.array(sigmas), np.array(corners), lost)


def flight_of(one: ErrorSample, frames: int) -> Flight:
    """Its scene and camera."""
    still = cv2.imread(str(STILLS / one.still), cv2.IMREAD_GRAYSCALE) if one.still else None
    scene, banks = replace(preset(one.preset), noise_levels=one.noise), None if still is None else np.asarray(still)
    return Flight(scene, size=one.size, frames=frames, seed=one.seed, still=banks)


def frames_of(one: ErrorSample, flight: Flight) -> Iterator[Frame]:
    """Its frames, spoilt as it says."""
    for shot in tqdm(flight, one.name, disable=None, leave=False):
        image = shot.image if one.spoil is None or shot.index == 0 else one.spoil(shot.image)
        yield Frame(image, "mono8", shot.stamp_ns)


def area_of(one: ErrorSample) -> dict[str, Value]:
    """The parameters that leave out its half."""
    if one.half is None:
        return {}
    (width, height), middle = one.size, one.size[1] // 2
    top, bottom = (0, middle) if one.half == 0 else (middle, height)
    return {"exclude": f"[[[0, {top}], [{width}, {top}], [{width}, {bottom}], [0, {bottom}]]]"}


def _corner_chi2(found: FloatArray, true: FloatArray, covariance: FloatArray, size: tuple[int, int]) -> FloatArray:
    """(4,) e^T C^-1 e of each corner of the frame."""
    width, height = size
    corners = np.array([[0, 0], [width - 1, 0], [0, height - 1], [width - 1, height - 1.0]])
    off, J = apply(found, corners) - apply(true, corners), jacobian(found, corners)
    inverse = np.linalg.inv(np.einsum("nij,jk,nlk->nil", J, covariance, J))
    return np.asarray(np.einsum("ni,nij,nj->n", off, inverse, off))


def measure(effort: Effort) -> Section:
    """The table of coverage."""
    sequences = [one for one in SEQUENCES if not one.still or (STILLS / one.still).exists()]
    courses = [fly(one, effort.flight) for one in (sequences if effort.plots else sequences[:4])]
    if effort.plots:
        plot(courses, PLOT)
    head = ("sequence", "error, px", "sigma, px", "error / sigma, median", "within 2 sigma, %", "corners in 95 %, %",
            "lost")
    everything = _together(courses)
    rows = [_row(one) for one in (*courses, everything)]
    data = {one.name: {"error_px": float(np.median(one.error_px)), "sigma_px": float(np.median(one.sigma_px)),
                       "ratio": float(np.median(one.ratio)), "within_two_sigma": one.within_two,
                       "corners": one.corners, "lost": one.lost} for one in (*courses, everything)}
    note = f"Default settings unless named; {effort.flight} frames each, {SMALL[0]}x{SMALL[1]} unless named; medians."
    return Section("Uncertainty", [Table("Coverage", head, rows, note)], data)


def _together(courses: Sequence[UncertaintyCourse]) -> UncertaintyCourse:
    return UncertaintyCourse("all", np.concatenate([one.error_px for one in courses]),
                  np.concatenate([one.sigma_px for one in courses]),
                  np.concatenate([one.corner_chi2 for one in courses]), sum(one.lost for one in courses))


def _row(one: UncertaintyCourse) -> tuple[str, ...]:
    return (one.name, number(float(np.median(one.error_px)), 4), number(float(np.median(one.sigma_px)), 4),
            number(float(np.median(one.ratio)), 2), number(100 * one.within_two, 0), number(100 * one.corners, 0),
            str(one.lost))


def plot(courses: Sequence[UncertaintyCourse], path: Path) -> None:
    """Error against sigma of every frame, and the share of frames within so many sigmas."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, (left, right) = pyplot.subplots(1, 2, figsize=(10, 4.6), dpi=110)
    for one in courses:
        left.loglog(one.sigma_px, one.error_px, ".", ms=3, alpha=0.6)
    span = np.array([min(one.sigma_px.min() for one in courses), max(one.sigma_px.max() for one in courses)])
    for factor, style in ((1, "-"), (2, "--")):
        left.loglog(span, factor * span, style, color="black", lw=1, label=f"error = {factor} sigma")
    left.set(xlabel="sigma_px", ylabel="error, px")
    left.legend(fontsize=8)
    ratios = np.sort(np.concatenate([one.ratio for one in courses]))
    right.plot(ratios, np.linspace(0, 100, len(ratios)), color="#1f6fb4")
    right.axvline(2, color="black", ls="--", lw=1)
    right.axhline(95, color="black", ls=":", lw=1)
    right.set(xlim=(0, 4), ylim=(0, 100), xlabel="error / sigma", ylabel="frames below, %")
    figure.tight_layout()
    figure.savefig(path)
    pyplot.close(figure)
