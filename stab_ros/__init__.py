"""Image stabilisation for river measurement from drones: every frame is mapped to one reference frame.

The names below are the public API; docs/api.md describes them with examples. Each is imported from its module on first
use (PEP 562), so that `import stab_ros` loads neither OpenCV nor Numba.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from stab_ros.core.version import __version__

if TYPE_CHECKING:
    from stab_ros.core.errors import ConfigError, InputError, MessageError, StabRosError, WorkError
    from stab_ros.core.geometry import rms_distance
    from stab_ros.core.region import Area, Region
    from stab_ros.core.types import Frame, Homography, Image, LostReason, ResetReason, Stabilized, State, Track
    from stab_ros.evaluation.evaluator import Arrival, Evaluator
    from stab_ros.evaluation.frame_metrics import FrameMetrics
    from stab_ros.evaluation.settings import EvaluatorConfig
    from stab_ros.imaging.camera import Camera
    from stab_ros.imaging.warp import warp
    from stab_ros.io.homographies import HomographyRow, HomographyWriter, read_homographies
    from stab_ros.io.points import read_points
    from stab_ros.io.regions import read_area
    from stab_ros.io.source import Clock, Picture, Source, open_source
    from stab_ros.io.static_maps import read_static_map
    from stab_ros.parameters.engines import make_evaluator, make_stabilizer
    from stab_ros.parameters.file import read_config
    from stab_ros.tracking.settings import StabilizerConfig
    from stab_ros.tracking.stabilizer import Stabilizer
    from stab_ros.tracking.static_map import StaticMap

__all__ = [
    "Area",
    "Arrival",
    "Camera",
    "Clock",
    "ConfigError",
    "Evaluator",
    "EvaluatorConfig",
    "Frame",
    "FrameMetrics",
    "Homography",
    "HomographyRow",
    "HomographyWriter",
    "Image",
    "InputError",
    "LostReason",
    "MessageError",
    "Picture",
    "Region",
    "ResetReason",
    "Source",
    "StabRosError",
    "Stabilized",
    "Stabilizer",
    "StabilizerConfig",
    "State",
    "StaticMap",
    "Track",
    "WorkError",
    "__version__",
    "make_evaluator",
    "make_stabilizer",
    "open_source",
    "read_area",
    "read_config",
    "read_homographies",
    "read_points",
    "read_static_map",
    "rms_distance",
    "warp",
]

_NAMES = {
    "core.errors": ("ConfigError", "InputError", "MessageError", "StabRosError", "WorkError"),
    "core.geometry": ("rms_distance",),
    "core.region": ("Area", "Region"),
    "core.types": ("Frame", "Homography", "Image", "LostReason", "ResetReason", "Stabilized", "State", "Track"),
    "evaluation.evaluator": ("Arrival", "Evaluator"),
    "evaluation.frame_metrics": ("FrameMetrics",),
    "evaluation.settings": ("EvaluatorConfig",),
    "imaging.camera": ("Camera",),
    "imaging.warp": ("warp",),
    "io.homographies": ("HomographyRow", "HomographyWriter", "read_homographies"),
    "io.points": ("read_points",),
    "io.regions": ("read_area",),
    "io.source": ("Clock", "Picture", "Source", "open_source"),
    "io.static_maps": ("read_static_map",),
    "parameters.engines": ("make_evaluator", "make_stabilizer"),
    "parameters.file": ("read_config",),
    "tracking.settings": ("StabilizerConfig",),
    "tracking.stabilizer": ("Stabilizer",),
    "tracking.static_map": ("StaticMap",),
}
_MODULE_OF = {name: f"{__name__}.{module}" for module, names in _NAMES.items() for name in names}

if not TYPE_CHECKING:  # a type checker would take any name for one of ours

    def __getattr__(name: str) -> Any:
        """Imports a public name on first use."""
        module = _MODULE_OF.get(name)
        if module is None:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        value = getattr(importlib.import_module(module), name)
        globals()[name] = value  # found without this function from now on
        return value


def __dir__() -> list[str]:
    """What `dir` and an interactive shell complete: the public API."""
    return sorted(__all__)
