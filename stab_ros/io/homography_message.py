"""The message on `homography`: a CameraInfo with H = P[:, :3] R K^-1; K, R and P are zero while lost.

image_proc's rectify node, given these messages as camera_info, stabilises the stream.
"""

from __future__ import annotations

from typing import TypeAlias, cast

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys.stores import ros2_jazzy as ros

from stab_ros.core.errors import MessageError
from stab_ros.core.types import FloatArray, Homography, Track
from stab_ros.imaging.camera import Camera
from stab_ros.io.cdr import CAMERA_INFO, Header, deserialize, header_message, serialize, to_ns

_Doubles: TypeAlias = NDArray[np.float64]
# image_proc passes frames through unchanged if D is all zero; this is zero to every computation, but not to it
_ALMOST_ZERO = 1e-300


def homography_cdr(track: Track, header: Header, size: tuple[int, int], camera: Camera | None = None) -> bytes:
    """CameraInfo of `track`. size: of the reference (width, height). camera: whose K and D it carries."""
    return rectification_cdr(track.ref_H_cur, header, size, camera)


def rectification_cdr(target_H_image: Homography | None, header: Header, size: tuple[int, int],
                      camera: Camera | None = None) -> bytes:
    """CameraInfo by which image_proc maps an image with this homography; None: it is not known.

    size: width and height of the result. camera: whose K and D it carries.
    """
    d, model = np.zeros(5), "plumb_bob"
    if camera is not None and len(camera.D):
        d, model = camera.D.astype(np.float64), camera.model  # astype copies
    if not d.any():
        d[0] = _ALMOST_ZERO
    k, r, p = _rectification(target_H_image, np.eye(3) if camera is None else camera.K)
    message = ros.sensor_msgs__msg__CameraInfo(
        header=header_message(header), height=size[1], width=size[0], distortion_model=model, d=d, k=k.ravel(),
        r=r.ravel(), p=p.ravel(), binning_x=0, binning_y=0,
        roi=ros.sensor_msgs__msg__RegionOfInterest(x_offset=0, y_offset=0, height=0, width=0, do_rectify=False))
    return serialize(message, CAMERA_INFO)


def _rectification(ref_H_cur: Homography | None, K: FloatArray) -> tuple[_Doubles, _Doubles, _Doubles]:
    """K, R = K^-1 H K and P = [K|0] of a CameraInfo."""
    P = np.zeros((3, 4))
    if ref_H_cur is None:
        return np.zeros((3, 3)), np.zeros((3, 3)), P
    if not np.isfinite(ref_H_cur).all():
        raise ValueError("a homography with NaN or infinity must not leave the engine")
    P[:, :3] = K
    return np.asarray(K, np.float64), np.asarray(np.linalg.solve(K, ref_H_cur @ K), np.float64), P


def read_homography(cdr: bytes | memoryview) -> tuple[int, Homography | None]:
    """Stamp in ns and H, normalised to h22 = 1 (None while lost), of a `homography` message.

    Raises:
        MessageError: damaged, or K, R and P make no homography.
    """
    message = cast(ros.sensor_msgs__msg__CameraInfo, deserialize(cdr, CAMERA_INFO))
    K, R, P = message.k.reshape(3, 3), message.r.reshape(3, 3), message.p.reshape(3, 4)
    stamp_ns = to_ns(message.header.stamp)
    if not (K.any() or R.any() or P.any()):
        return stamp_ns, None
    return stamp_ns, _homography(K, R, P)


def _homography(K: FloatArray, R: FloatArray, P: FloatArray) -> Homography:
    """P[:, :3] R K^-1, normalised."""
    finite = np.isfinite([*K.flat, *R.flat, *P.flat]).all()
    with np.errstate(all="ignore"):
        inverse = _inverse(K) if finite else None
        if inverse is None:
            raise MessageError("homography: K, R and P must be finite and K invertible, or all three zero (lost)")
        H = P[:, :3] @ R @ inverse
        H /= H[2, 2]
    if not np.isfinite(H).all() or _inverse(H) is None:
        raise MessageError("homography: P[:, :3] R K^-1 cannot be inverted or normalised to h22 = 1")
    return H


def _inverse(K: FloatArray) -> FloatArray | None:
    """None if K is singular; even a matrix of full rank may be too close to it."""
    try:
        return np.linalg.inv(K) if np.linalg.matrix_rank(K) == 3 else None
    except np.linalg.LinAlgError:
        return None
