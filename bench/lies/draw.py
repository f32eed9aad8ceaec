"""What a flight is made of, drawn from a seed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

TEXTURES = ("gravel", "grass", "crowns", "fields", "city", "sand", "photo")
WATERS = ("none", "rigid", "evolving", "glitter")
MOTIONS = ("hover", "drift", "gusts", "cut", "fixed")
ENCODINGS = ("raw", "jpeg", "mpeg4", "blocks")
WEATHERS = ("clear", "rain", "fog")
FAULTS = (
    "none", "osd", "hot_pixels", "fixed_pattern", "dirt", "bars", "soft_bars", "vignette", "flakes", "garbage_first",
    "garbage_early", "frozen_previous", "frozen_reference", "late_overlay", "fixed_camera", "jello",
    "legs", "repeated",
)
KINDS = (*FAULTS, *MOTIONS, *TEXTURES, *ENCODINGS[1:], *WEATHERS[1:])
_INGREDIENT = {kind: name for name, kinds in (("fault", FAULTS), ("motion", MOTIONS), ("texture", TEXTURES),
                                               ("encoding", ENCODINGS), ("weather", WEATHERS)) for kind in kinds}
_FRAMES = 12  # at least: several faults come after some of them
_SIZES = ((320, 240), (480, 270), (640, 360), (640, 480), (960, 540), (1280, 720), (1920, 1080))
_SIZE_ODDS = (0.12, 0.18, 0.3, 0.12, 0.17, 0.09, 0.02)
_STILL = ("frozen_previous", "frozen_reference")  # a codec freezes what moves slowly and has little noise


@dataclass(frozen=True)
class Recipe:
    """A flight before it is rendered; the same recipe gives the same pictures.

    Attributes:
        seed: of all that is random in it.
        size: width and height, px.
        frames: number of frames, 25 a second.
        texture, variant: of the ground; one of `TEXTURES`.
        water: one of `WATERS`.
        banks: 1 or 2, where there is water.
        water_share: share of the picture, 0 to 0.7.
        water_px: speed of the water, px a frame.
        motion: one of `MOTIONS`.
        fault: one of `FAULTS`.
        encoding: one of `ENCODINGS`.
        quality: of `jpeg`, 50 to 95.
        step: of the quantiser of `blocks`, grey levels.
        contrast: of the ground, times that of its texture.
        noise: standard deviation, grey levels.
        jello_px: amplitude of the rows' swing.
        blur_px: standard deviation of the lens' blur.
        exposure: relative amplitude of its changes.
        weather: one of `WEATHERS`.

    Raises:
        ValueError: too few frames, or too much water.
    """

    seed: int
    size: tuple[int, int]
    frames: int
    texture: str
    variant: int
    water: str
    banks: int
    water_share: float
    water_px: float
    motion: str
    fault: str
    encoding: str
    quality: int
    step: int
    contrast: float
    noise: float
    jello_px: float
    blur_px: float
    exposure: float
    weather: str

    def __post_init__(self) -> None:
        if self.frames < _FRAMES or not 0 <= self.water_share <= 0.7:
            raise ValueError(f"{self.frames} frames with {self.water_share:.0%} of water are no flight")

    @property
    def kinds(self) -> tuple[str, ...]:
        """The kinds that the flight counts for."""
        own = (self.fault, self.motion, self.texture, self.encoding, self.weather)
        return tuple(kind for kind in own if kind in KINDS)

    def __str__(self) -> str:
        water = "no water" if self.water == "none" else (
            f"{self.water} water {self.water_share:.0%} {self.water_px:.1f} px, {self.banks} bank")
        strength = {"jpeg": f" {self.quality}", "blocks": f" {self.step}"}.get(self.encoding, "")
        return (f"{self.size[0]}x{self.size[1]} {self.texture}, {water}, {self.motion}, {self.fault}, "
                f"{self.encoding}{strength}, noise {self.noise:.1f}, "
                f"jello {self.jello_px:.2f}, blur {self.blur_px:.1f}, exposure {self.exposure:.2f}, {self.weather}")


def draw(seed: int, frames: int = 60, kind: str = "", sizes: Sequence[tuple[int, int]] = ()) -> Recipe:
    """The flight of a seed.

    Args:
        seed: number of the flight.
        frames: number of frames.
        kind: one of `KINDS`, which the flight is to be of; none: any.
        sizes: sizes of the picture to draw from; none: all.

    Returns:
        The recipe.

    Raises:
        ValueError: there is no such kind.
    """
    if kind and kind not in KINDS:
        raise ValueError(f"kind {kind!r} is not one of {', '.join(KINDS)}")
    rng = np.random.default_rng([seed, 7])
    recipe = _possible(_of_kind(_any(rng, seed, frames, sizes), kind), rng)
    if kind and kind not in recipe.kinds:  # its fault forbids that
        return _possible(_of_kind(replace(recipe, fault="none"), kind), rng)
    return recipe


def _any(rng: np.random.Generator, seed: int, frames: int, sizes: Sequence[tuple[int, int]]) -> Recipe:
    size = _SIZES[int(rng.choice(len(_SIZES), p=_SIZE_ODDS))]
    water = str(rng.choice(WATERS, p=(0.2, 0.3, 0.3, 0.2)))
    encoding = str(rng.choice(ENCODINGS, p=(0.3, 0.35, 0.15, 0.2)))
    fault = str(rng.choice(FAULTS, p=_weighted(FAULTS, {"none": 3.0})))
    return Recipe(
        seed=seed, size=sizes[seed % len(sizes)] if sizes else size, frames=frames,
        texture=str(rng.choice(TEXTURES)), variant=int(rng.integers(6)), water=water, banks=int(rng.integers(1, 3)),
        water_share=0.0 if water == "none" else rng.uniform(0.1, 0.7),
        water_px=float(np.exp(rng.uniform(np.log(0.3), np.log(12)))),
        motion=str(rng.choice(MOTIONS[:4], p=(0.35, 0.3, 0.2, 0.15))), fault=fault, encoding=encoding,
        quality=int(rng.integers(50, 96)), step=int(rng.integers(6, 30)),
        contrast=rng.uniform(0.35, 1.1), noise=rng.uniform(0, 8) * rng.uniform(0, 1),
        jello_px=rng.uniform(0, 0.3) if rng.random() < 0.1 else 0.0, blur_px=rng.uniform(0, 1.2),
        exposure=rng.uniform(0.02, 0.25) if rng.random() < 0.25 else 0.0,
        weather=str(rng.choice(WEATHERS, p=(0.8, 0.1, 0.1))))


def _weighted(names: Sequence[str], odds: dict[str, float]) -> list[float]:
    weights = [odds.get(name, 1.0) for name in names]
    return [weight / sum(weights) for weight in weights]


def _of_kind(recipe: Recipe, kind: str) -> Recipe:
    """The recipe with the one ingredient that makes it of this kind."""
    if kind == "fixed":
        return replace(recipe, fault="fixed_camera")
    return Recipe(**{**vars(recipe), **({_INGREDIENT[kind]: kind} if kind else {})})


def _possible(recipe: Recipe, rng: np.random.Generator) -> Recipe:
    """Other ingredients changed so that the fault is what it says, and the ground can be told from the water."""
    fault = recipe.fault
    if fault == "fixed_camera":
        recipe = replace(recipe, motion="fixed")
        recipe = replace(recipe, water="evolving", water_share=0.4) if recipe.water == "none" else recipe
    if fault == "jello":
        recipe = replace(recipe, jello_px=rng.uniform(0.2, 1.0))
    if fault == "bars":
        recipe = replace(recipe, encoding="raw")
    if fault == "soft_bars":
        recipe = replace(recipe, encoding="jpeg", quality=int(rng.integers(60, 93)))
    if fault in _STILL:
        recipe = replace(recipe, motion=recipe.motion if recipe.motion == "drift" else "hover", encoding="raw",
                         noise=recipe.noise / 6, weather="clear", exposure=0.0)
    if recipe.water == "rigid":  # beyond this, nothing but the banks' shape tells which of two planes is the ground
        recipe = replace(recipe, water_share=min(recipe.water_share, 0.45 if recipe.banks == 1 else 0.6))
    return recipe
