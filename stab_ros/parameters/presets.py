"""Presets: the tools of the papers, each as a method and the parameter values of its paper.

Values are those of Table A1 of Ljubicic et al. 2021 (its Kolubara column; `_alpine` and `_basento` carry the others
where they differ), of section 3 of Zhang et al. 2023 and of section 2.1 of Perks 2020. Values that a paper does not
give are the defaults of the tool, or those of its published source. The numbers of points apply where the user gives
none.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from stab_ros.core.settings import Value

# Least squares uses all points; the threshold only decides which of them count as inliers. The residuals of an affine
# or similarity model reach 1.2 px.
_LEAST_SQUARES: Mapping[str, Value] = {"estimator": "least_squares", "threshold": 3.0, "reference": "fixed"}
_MANUAL: Mapping[str, Value] = {**_LEAST_SQUARES, "min_inliers": 4}

_FFT_CUAS: Mapping[str, Value] = {
    **_MANUAL, "max_sigma": 3.0, "method": "fft", "model": "affine", "fft.points": 4, "fft.layout": "corners",
    "fft.passes": "32,16", "fft.steps": "16,8", "fft.follow": True, "fft.second_look": False,
}
_FFT_DCH: Mapping[str, Value] = {
    **_MANUAL, "method": "fft", "model": "projective", "fft.points": 4, "fft.layout": "corners", "fft.passes": "128",
    "fft.steps": "64", "fft.follow": False, "fft.second_look": False,
}
_SSIMS: Mapping[str, Value] = {
    **_MANUAL, "method": "ssim", "model": "projective", "ssim.points": 4, "ssim.layout": "corners", "ssim.area": 11,
    "ssim.search": 21, "ssim.subpixel": 3, "ssim.update_kernels": False, "ssim.second_look": False,
}
_KLT_IV: Mapping[str, Value] = {
    **_LEAST_SQUARES, "method": "klt", "model": "similarity", "klt.selection": "quadrants", "klt.share": 0.1,
    "klt.min_quality": 0.01, "klt.passes": "21", "klt.levels": 5, "klt.max_bidirectional": 1.0,
}
_VISION_FAST: Mapping[str, Value] = {
    "method": "fast_freak", "model": "similarity", "estimator": "ransac", "threshold": 1.5, "reference": "fixed",
    "fast_freak.quality": 0.1, "fast_freak.intensity": 0.2, "fast_freak.uniform": 0.5, "fast_freak.ratio": 0.6,
    "fast_freak.max_distance": 0.1, "fast_freak.subpixel": False,
}
_FLOWVELO_AKAZE: Mapping[str, Value] = {
    "method": "akaze", "model": "projective", "estimator": "ransac", "threshold": 3.0, "reference": "fixed",
    "akaze.threshold": 0.005, "akaze.ratio": 0.8,
}
_ED_RANSAC: Mapping[str, Value] = {
    "method": "sift", "model": "projective", "estimator": "ed_ransac", "ransac_threshold": 3.0, "threshold": 0.2,
    "reference": "adjacent", "sift.ratio": 0.8, "sift.contrast": 0.04, "sift.edge": 10.0, "sift.layers": 3,
    "sift.sigma": 1.6,
}
_BLENDER_MANUAL: Mapping[str, Value] = {
    **_MANUAL, "method": "region", "model": "projective", "region.points": 4, "region.layout": "corners",
    "region.area": 11, "region.search": 21, "region.motion": "translation_rotation_scale",
    "region.min_correlation": 0.75, "region.blur": 0.9, "region.iterations": 20, "region.second_look": False,
}
_BLENDER_8: Mapping[str, Value] = {"region.points": 8, "region.layout": "even"}
_BASENTO_AREAS: Mapping[str, Value] = {"region.area": 21, "region.search": 41}

_OF_THE_PAPERS: Mapping[str, Mapping[str, Value]] = {
    "fft_cuas": _FFT_CUAS,
    "fft_cuas_alpine": {**_FFT_CUAS, "fft.points": 8, "fft.layout": "even"},
    "fft_cuas_basento": {**_FFT_CUAS, "model": "projective", "fft.points": 14, "fft.layout": "even",
                         "fft.passes": "64,32", "fft.steps": "32,16"},
    "fft_dch": _FFT_DCH,
    "ssims": _SSIMS,
    "ssims_alpine": {**_SSIMS, "ssim.points": 5, "ssim.layout": "even"},
    "ssims_basento": {**_SSIMS, "ssim.points": 8, "ssim.layout": "even", "ssim.area": 21, "ssim.search": 41},
    "klt_iv": _KLT_IV,
    "klt_iv_basento": {**_KLT_IV, "klt.passes": "21,5"},
    "vision_fast": _VISION_FAST,
    "flowvelo_akaze": _FLOWVELO_AKAZE,
    "flowvelo_akaze_alpine": {**_FLOWVELO_AKAZE, "akaze.threshold": 0.02},
    "ed_ransac": _ED_RANSAC,
    "blender_manual": _BLENDER_MANUAL,
    "blender_manual_alpine": {**_BLENDER_MANUAL, **_BLENDER_8},
    "blender_manual_basento": {**_BLENDER_MANUAL, **_BLENDER_8, **_BASENTO_AREAS},
    "blender_auto": {**_BLENDER_MANUAL, "estimator": "ransac", "region.points": 1000, "region.layout": "even",
                     "region.min_distance": 120.0, "region.margin": 16, **_BASENTO_AREAS},
}
# name -> parameter -> value; "method" is one of METHODS, explicit parameters override the others. The tools of the
# papers register each frame as it arrives, so none of them has a start-up buffer.
PRESETS: Mapping[str, Mapping[str, Value]] = MappingProxyType(
    {name: {"start_s": 0.0, **values} for name, values in _OF_THE_PAPERS.items()})
