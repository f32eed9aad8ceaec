"""What the water of a moving river looks like: settings, and the waves and the sun's reflection that do not drift.

Strengths are standard deviations or amplitudes in grey levels; 0 switches a part off.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.core.types import FloatArray
from stab_ros.synthetic.drifters import Region

G_M_S2 = 9.81
_WAVES, _TRAINS = 10, 10
_SHORTEST_PX = 5.0  # shorter waves would be aliased


@dataclass(frozen=True)
class SurfaceSettings:
    """Appearance of the water.

    Attributes:
        texture: strength of the colours and ripples that drift with the water, as small patches.
        texture_px: radii of the patches of its finer and of its coarser part.
        texture_life_s: longest life of a patch; None: as long as water takes for 0.4 of what is seen, at most 40 s.
            Where the flow strains patches, they live as long as they are recognised.
        foam: brightness of foam that drifts in streaks with the coarser part.
        particles_per_m2: density of floating particles; None: that of the scene.
        particle_level: their brightness; each has 0.4 to 1 of it.
        particle_px: diameters of the smallest and the largest; small ones are more frequent.
        particle_life_s: from the appearance of a particle to its end.
        waves: strength of wind waves, which run over the flow with their own speed.
        wave_m: mean wavelength of the wind waves.
        wind_deg: where they run to, anticlockwise from the east.
        standing_waves: strength of waves that stand behind obstacles.
        glint: strength of the sun's reflection, fixed to the direction of sun and camera.
        sun_zenith_deg: of the sun.
        sun_azimuth_deg: of the sun, anticlockwise from the east.
        bed: share of the bed that shines through where there is no depth, 0 to 1.
        clear_m: depth at which 1 / e of it is left.

    Raises:
        InputError: a negative value, a share above 1, or a smallest size above the largest.
    """

    texture: float = 9.0
    texture_px: tuple[float, float] = (9.0, 26.0)
    texture_life_s: float | None = None
    foam: float = 0.0
    particles_per_m2: float | None = None
    particle_level: float = 100.0
    particle_px: tuple[float, float] = (2.0, 8.0)
    particle_life_s: float = 6.0
    waves: float = 0.0
    wave_m: float = 0.8
    wind_deg: float = 130.0
    standing_waves: float = 0.0
    glint: float = 0.0
    sun_zenith_deg: float = 20.0
    sun_azimuth_deg: float = 60.0
    bed: float = 0.0
    clear_m: float = 0.5

    def __post_init__(self) -> None:
        for f in fields(self):
            value = getattr(self, f.name)
            if not f.name.endswith("_deg") and value is not None and np.min(value) < 0:
                raise InputError(f"{f.name} of {value}, it must not be negative")
        for name in ("texture_px", "texture_life_s", "particle_px", "particle_life_s", "wave_m", "clear_m"):
            if getattr(self, name) is not None and np.min(getattr(self, name)) == 0:
                raise InputError(f"{name} of {getattr(self, name)}, it must be positive")
        if self.particle_px[0] > self.particle_px[1] or self.bed > 1:
            raise InputError(f"particle_px of {self.particle_px} and bed of {self.bed}, they must be ascending and at "
                             "most 1")


DISTURBED = SurfaceSettings(foam=14.0, waves=4.0, standing_waves=14.0, glint=70.0, bed=0.9, clear_m=0.6)
PRESETS = {"calm": SurfaceSettings(), "disturbed": DISTURBED}


def wind_waves(settings: SurfaceSettings, gsd_m: float, current_m_s: FloatArray, seed: int) -> FloatArray:
    """Waves (n, 5) on deep water: wave numbers to the east and to the north, rad/m, frequency, rad/s, phase, amplitude.

    The frequency over ground is sqrt(g k) + k . current (Lamb 1932, section 229): the crests run with their own speed
    relative to the water. current_m_s: (2,) mean velocity of the water.
    """
    if settings.waves == 0:
        return np.zeros((0, 5))
    rng = np.random.default_rng([seed, 60])
    length = np.maximum(settings.wave_m * rng.uniform(0.6, 1.5, _WAVES), _SHORTEST_PX * gsd_m)
    angle = math.radians(settings.wind_deg) + rng.normal(0, 0.35, _WAVES)
    k = 2 * math.pi / length
    number = k[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    frequency = np.sqrt(G_M_S2 * k) + number @ current_m_s
    amplitude = np.full(_WAVES, settings.waves * math.sqrt(2 / _WAVES))
    return np.column_stack([number, frequency, rng.uniform(0, 2 * math.pi, _WAVES), amplitude])


def standing_waves(settings: SurfaceSettings, gsd_m: float, region: Region, seed: int) -> FloatArray:
    """Trains of waves (n, 6) that stand: centre, m, wave number to the east and to the north, rad/m, radius, amplitude.

    Obstacles lie anywhere. A wave stands where its own speed is that of the water; here its length is not tied to it.
    """
    if settings.standing_waves == 0:
        return np.zeros((0, 6))
    rng = np.random.default_rng([seed, 61])
    low, high = np.array(region.low_m), np.array(region.high_m)
    length = gsd_m * rng.uniform(9, 16, _TRAINS)
    angle = rng.normal(0, 0.25, _TRAINS)
    number = 2 * math.pi / length[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    amplitude = np.full(_TRAINS, settings.standing_waves)
    return np.column_stack([low + rng.random((_TRAINS, 2)) * (high - low), number, 2.2 * length, amplitude])


def mirror_direction(settings: SurfaceSettings) -> FloatArray:
    """Direction (3,), east, north, up, from the camera to where calm water mirrors the sun."""
    zenith, azimuth = math.radians(settings.sun_zenith_deg), math.radians(settings.sun_azimuth_deg)
    return np.array([math.sin(zenith) * math.cos(azimuth), math.sin(zenith) * math.sin(azimuth), -math.cos(zenith)])
