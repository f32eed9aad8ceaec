"""Settings of the live nodes beside those of their engines; here and not in `nodes`, as parameter files hold both."""

from __future__ import annotations

from dataclasses import dataclass

from stab_ros.core.settings import Checked, setting
from stab_ros.georeferencing.level_doubts import LEVEL_TIMEOUT_S


@dataclass(frozen=True)
class ManagedSettings(Checked):
    """Settings of every node."""

    autostart: bool = setting(
        True, "Whether the node configures and activates itself; false: it waits for a lifecycle manager, unconfigured")


@dataclass(frozen=True)
class TrackerSettings(Checked):
    """Settings of the tracker node."""

    queue_depth: int = setting(
        1, "Depth of the input queue; 1: the newest frame wins; 0: every frame is kept, RELIABLE", 0, 1)
    image_transport: str = setting(
        "raw", "Transport of the input: raw for image_raw, compressed for image_raw/compressed",
        choices=("raw", "compressed"))
    wait_for_subscribers: int = setting(
        0, "Number of subscribers to homography to wait for before taking images", 0, 1000)
    stale_s: float = setting(
        2.0, "Time in seconds without an image, while free to take one, before the state is STALE", 0.05, 3600.0)
    answer_start: str = setting(
        "late", "What becomes of the frames of a start: late answers them together when it is over, at_once answers "
        "each as it comes, LOST as the start is under way, and drop does not answer them",
        choices=("late", "at_once", "drop"))
    reference_path: str = setting(
        "", "Path of an .mcap file in which the reference is saved, and from which it is restored at the next start; "
        '"": every start makes a new reference')
    reference_frame: str = setting(
        "", 'frame_id of image_stabilized, its compressed images and its camera_info; "": that of the camera\'s images')
    idle: str = setting(
        "track", "While nobody listens to any output: track, so that the reference is followed without a gap; or "
        "sleep, without taking images, and continue with the same reference once somebody listens",
        choices=("track", "sleep"))


COMPRESSED_PREFIX = "image_stabilized.compressed."  # as image_transport names the parameters of a topic


@dataclass(frozen=True)
class CompressedSettings(Checked):
    """Settings of image_stabilized/compressed; all but the rate as compressed_image_transport has them."""

    format: str = setting(
        "jpeg", "Codec of images of 8 bit; those of 16 bit are always PNG, and of 32-bit floats TIFF",
        choices=("jpeg", "png"))
    jpeg_quality: int = setting(95, "Quality of JPEG", 1, 100)
    png_level: int = setting(3, "Compression level of PNG; a higher one takes longer and makes smaller images", 0, 9)
    rate: float = setting(
        0.0, "Images per second of header time that are compressed at most; 0: all of them", 0.0, 1000.0)


@dataclass(frozen=True)
class EvaluatorSettings(Checked):
    """Settings of the evaluator node."""

    window_s: float = setting(
        60.0, "Length in seconds of the time window of the statistics on /diagnostics", 1.0, 86400.0)
    alarm_s: float = setting(
        3.0, "Time in seconds for which /diagnostics shows a problem of a frame", 1.0, 3600.0)
    stale_s: float = setting(
        1.0, "Time in seconds without an image, while free to take one, before the stream counts as stopped", 0.05,
        3600.0)
    backlog_mb: float = setting(
        512.0, "Memory in MB for gray images that wait to be measured; above half of it RMSE and velocity field are "
        "skipped, above all of it the oldest frame", 0.1, 1e6)
    wait_for_subscribers: int = setting(
        0, "Number of subscribers to ~/metrics to wait for before taking images", 0, 1000)


@dataclass(frozen=True)
class PlacingSettings(Checked):
    """Settings of the nodes that place images on the water."""

    input: str = setting(
        "image_raw", "Images to georeference: image_raw, as taken, or image_stabilized, of the tracker",
        choices=("image_raw", "image_stabilized"))
    image_transport: str = setting(
        "raw", "Transport of the input: raw, or compressed for the topic with /compressed behind its name",
        choices=("raw", "compressed"))
    queue_depth: int = setting(
        1, "Depth of the input queue; 1: the newest frame wins; 0: every frame is kept, RELIABLE", 0, 1)
    use_camera_info: bool = setting(
        True, "Whether camera_info tells the calibration, for which images then wait, unless there is a camera_file "
        "(for 5 s, if nobody publishes it and gsd_m or known_distance tells the scale of dynamic_stabilization "
        "without ground_above_wse_m); false: without a camera_file the camera is not calibrated")
    use_homographies: bool = setting(
        False, "Whether to take homographies also for an orientation that does without them, to check that the camera "
        "is still")
    attitude: str = setting(
        "auto", "Topic of the attitude: gimbal, imu, or auto for gimbal if somebody publishes it at first, else imu",
        choices=("auto", "gimbal", "imu"))
    water_level_type: str = setting(
        "auto", "Type of water_level: std_msgs/Float64, geometry_msgs/PointStamped, or auto for that of its publisher",
        choices=("auto", "Float64", "PointStamped"))
    wait_s: float = setting(
        12.0, "Time in seconds, while free to take messages, that frames wait in vain for homographies or samples of "
        "a sensor, before they are placed without; a start of the tracker that pauses takes 10 s", 0.05, 3600.0)
    stale_s: float = setting(
        2.0, "Time in seconds without an image, while free to take one, before the state is STALE", 0.05, 3600.0)
    backlog_mb: float = setting(
        1024.0, "Memory in MB for images that wait for their homographies; above it the oldest is placed without", 0.1,
        1e6)
    wait_for_subscribers: int = setting(
        0, "Number of subscribers to ortho_info to wait for before taking images", 0, 1000)
    water_level_timeout_s: float = setting(
        LEVEL_TIMEOUT_S, "Age in seconds of the last water_level above which /diagnostics warns of it: the scale may "
        "be wrong", 1.0, 1e6)


@dataclass(frozen=True)
class GeoreferenceSettings(PlacingSettings):
    """Settings of the georeference node."""

    publish_tf: bool = setting(
        False, "Whether to publish on /tf where the frame of the images is in the map; only if nobody else tells, as a "
        "frame has one parent: robot_state_publisher or a static transform usually places that of a camera")


@dataclass(frozen=True)
class VelocimetrySettings(PlacingSettings):
    """Settings of the velocimetry node: it takes the inputs of the georeference node."""

    input: str = setting(
        "image_raw", "Images to measure in: image_raw, as taken, or image_stabilized, of the tracker",
        choices=("image_raw", "image_stabilized"))
    wait_for_subscribers: int = setting(
        0, "Number of subscribers to velocity to wait for before taking images", 0, 1000)


@dataclass(frozen=True)
class DischargeSettings(Checked):
    """Settings of the discharge node."""

    water_level_type: str = setting(
        "auto", "Type of water_level: std_msgs/Float64, geometry_msgs/PointStamped, or auto for that of its publisher",
        choices=("auto", "Float64", "PointStamped"))
    stale_s: float = setting(
        10.0, "Time in seconds without velocities, while free to take them, before the state is STALE", 0.05, 3600.0)
    wait_for_subscribers: int = setting(
        0, "Number of subscribers to discharge to wait for before taking velocities", 0, 1000)


@dataclass(frozen=True)
class PipelineSettings(Checked):
    """Settings of the pipeline, which holds several nodes in one process."""

    nodes: str = setting(
        "[tracker, velocimetry]", "Nodes of the process, a list of tracker, georeference, velocimetry, discharge and "
        "player")
    wait_for_nodes: int = setting(
        0, "Number of nodes of the process that must be ready for images before any is taken or played; 0: all that "
        "take images, where the player is among the nodes, else one; as many as take them, where a recording is played "
        "by another process and none is to be lost", 0, 3)
