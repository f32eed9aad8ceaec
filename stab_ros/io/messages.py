"""Every ROS message we read or write, as CDR bytes, under one roof; each message has a module of its own."""

from __future__ import annotations

from stab_ros.io.camera_message import read_camera, read_size
from stab_ros.io.cdr import (
    CAMERA_INFO,
    COMPRESSED_IMAGE,
    DIAGNOSTIC_ARRAY,
    FLOAT64,
    IMAGE,
    SECOND_NS,
    Header,
    header_of,
    read_stamp,
    typestore,
)
from stab_ros.io.diagnostics_message import ERROR, OK, WARN, diagnostics_cdr, read_values
from stab_ros.io.homography_message import homography_cdr, read_homography
from stab_ros.io.image_message import IMAGE_TYPES, blank_image_cdr, image_cdr, read_image, static_map_cdr
from stab_ros.io.metrics_message import float64_cdr, metrics_cdr
from stab_ros.io.track_message import track_cdr

__all__ = [
    "CAMERA_INFO", "COMPRESSED_IMAGE", "DIAGNOSTIC_ARRAY", "ERROR", "FLOAT64", "IMAGE", "IMAGE_TYPES", "OK",
    "SECOND_NS", "WARN", "Header", "blank_image_cdr", "diagnostics_cdr", "float64_cdr", "header_of", "homography_cdr",
    "image_cdr", "metrics_cdr", "read_camera", "read_homography", "read_image", "read_size", "read_stamp",
    "read_values", "static_map_cdr", "track_cdr", "typestore",
]
