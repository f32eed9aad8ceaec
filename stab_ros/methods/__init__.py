"""The stabilization methods: one file and one entry of `METHODS` each."""

from __future__ import annotations

from stab_ros.methods.akaze import Akaze
from stab_ros.methods.base import Method
from stab_ros.methods.direct import Direct
from stab_ros.methods.ecc import Ecc
from stab_ros.methods.fast_freak import FastFreak
from stab_ros.methods.fft import Fft
from stab_ros.methods.klt import Klt
from stab_ros.methods.region import RegionMethod
from stab_ros.methods.sar_sift import SarSift
from stab_ros.methods.sift import Sift
from stab_ros.methods.ssim import Ssim

METHODS: dict[str, type[Method]] = {
    "direct": Direct,
    "klt": Klt,
    "fft": Fft,
    "ssim": Ssim,
    "region": RegionMethod,
    "fast_freak": FastFreak,
    "akaze": Akaze,
    "sift": Sift,
    "sar_sift": SarSift,
    "ecc": Ecc,
}
