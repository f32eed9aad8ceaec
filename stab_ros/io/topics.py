"""The names of our topics, relative to the namespace of a camera; live and in recordings."""

from __future__ import annotations

# what a camera driver publishes
RAW_TOPIC = "image_raw"
RAW_COMPRESSED_TOPIC = "image_raw/compressed"
CAMERA_INFO_TOPIC = "camera_info"
# what sensors publish
FIX_TOPIC = "fix"
IMU_TOPIC = "imu"
GIMBAL_TOPIC = "gimbal"
WATER_LEVEL_TOPIC = "water_level"
# what the tracker publishes
HOMOGRAPHY_TOPIC = "homography"
STABILIZED_TOPIC = "image_stabilized"
TRACK_TOPIC = "track"
REFERENCE_IMAGE_TOPIC = "reference_image"
STATIC_MAP_TOPIC = "static_map"
DEBUG_IMAGE_TOPIC = "debug_image"
# what the evaluator publishes
METRICS_TOPIC = "metrics"
RMSE_TOPIC, RMSD_TOPIC, DISPLACEMENT_TOPIC = "rmse_px", "rmsd", "displacement_px"
# what georeferencing publishes
ORTHO_TOPIC, ORTHO_INFO_TOPIC = "image_ortho", "ortho_info"
POSE_TOPIC, MOTION_TOPIC = "pose", "motion"
ORIGIN_TOPIC, GCPS_TOPIC, STATUS_TOPIC = "origin", "gcps", "status"
# what velocimetry publishes
VELOCITY_TOPIC, VELOCITY_GRID_TOPIC = "velocity", "velocity_grid"
MARKERS_TOPIC, IMAGE_VELOCITY_TOPIC = "markers", "image_velocity"
# what discharge_node publishes
DISCHARGE_TOPIC = "discharge"
# the same in every namespace
DIAGNOSTICS_TOPIC = "/diagnostics"
CLOCK_TOPIC = "/clock"
TF_TOPIC, TF_STATIC_TOPIC = "/tf", "/tf_static"

TRACKER_NAME, EVALUATOR_NAME, GEOREFERENCE_NAME = "tracker_node", "evaluator_node", "georeference_node"
VELOCIMETRY_NAME = "velocimetry_node"
DEFAULT_NAMESPACE = "/camera"  # of a video or a folder of images


def topic_in(namespace: str, topic: str) -> str:
    """The topic of one camera: `/ns/homography` for `/ns` and `homography`."""
    return f"{namespace}/{topic}"


def private(topic: str) -> str:
    """The topic below its node's name: `~/track`."""
    return topic_in("~", topic)


def compressed_topic(topic: str) -> str:
    """The topic of image_transport with the compressed images of a topic."""
    return f"{topic}/compressed"
