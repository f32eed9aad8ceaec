"""Sound inputs of every reader, small, for the fuzzer to damage; `python fuzz_seeds.py FOLDER` writes them all.

Made in a process of its own, as the libraries that write them need memory that the readers do not.
"""

from __future__ import annotations

import json
import struct
import sys
from collections.abc import Callable, Iterator
from functools import partial
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "helpers"))

import cv2
import numpy as np
import tifffile
from bag_makers import (
    EXTRAS,
    FLIGHT,
    JAZZY,
    NOETIC,
    START_NS,
    STRING,
    by_mcap,
    by_mcap_ros1,
    ros1_messages,
    with_extras,
)
from coded_video import (
    FFMPEG_PACKET,
    STORE,
    Packet,
    compressed_video,
    encoded_images,
    ffmpeg_packet,
    proto,
    proto_time,
)
from mcap.writer import CompressionType
from PIL import Image as Pillow
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from stab_ros.core.types import LostReason, State, Track
from stab_ros.imaging.window import Window
from stab_ros.io.cdr import (
    CAMERA_INFO,
    COMPRESSED_IMAGE,
    FLOAT64,
    IMAGE,
    IMU,
    NAV_SAT_FIX,
    POINT_STAMPED,
    QUATERNION_STAMPED,
    TF_MESSAGE,
    Header,
)
from stab_ros.io.coded_message import CDR_DEFINITIONS
from stab_ros.io.encodings import DECODED
from stab_ros.io.track_message import track_cdr
from stab_ros.io.velocity_message import velocity_cdr
from stab_ros.velocimetry.vectors import Vectors

_TIME = JAZZY.types["builtin_interfaces/msg/Time"](sec=1_700_000_000, nanosec=123)
_HEADER = JAZZY.types["std_msgs/msg/Header"](stamp=_TIME, frame_id="cam")
_RAW = "foxglove_msgs/msg/RawImage"
_RAW_STORE: Any = get_typestore(Stores.ROS2_JAZZY)
_RAW_STORE.register(get_types_from_msg(CDR_DEFINITIONS[_RAW], _RAW))
_SIZE = (4, 6)  # height, width of the pictures


def images() -> Iterator[bytes]:
    for encoding in DECODED:
        bits = 32 if encoding == "32FC1" else 16 if "16" in encoding else 8
        channels = 2 if encoding.startswith(("yu", "uy")) else {"b": 3, "r": 3}.get(encoding[0], 1)
        channels = 4 if encoding.startswith(("bgra", "rgba")) or encoding == "8UC4" else channels
        channels = 3 if encoding == "8UC3" else 1 if encoding.startswith("bayer") else channels
        step = _SIZE[1] * channels * bits // 8
        for big_endian, padding in ((0, 0), (1, 4)):
            data = np.arange(_SIZE[0] * (step + padding), dtype=np.uint16).astype(np.uint8)
            message = JAZZY.types[IMAGE](_HEADER, *_SIZE, encoding, big_endian, step + padding, data)
            yield bytes(JAZZY.serialize_cdr(message, IMAGE, little_endian=not big_endian))


def _picture(channels: int = 3, bits: int = 8) -> np.ndarray:
    rng = np.random.default_rng(1)
    return rng.integers(0, 2**bits - 1, (*_SIZE, channels), np.uint16).astype(np.uint8 if bits == 8 else np.uint16)


def _encoded(suffix: str, picture: np.ndarray, *options: int) -> bytes:
    return bytes(cv2.imencode(suffix, picture, options)[1])


def jpeg_files() -> Iterator[bytes]:
    for channels in (1, 3):
        yield _encoded(".jpg", _picture(channels))
    yield _encoded(".jpg", _picture(), cv2.IMWRITE_JPEG_PROGRESSIVE, 1)
    yield _encoded(".jpg", _picture(), cv2.IMWRITE_JPEG_RST_INTERVAL, 1, cv2.IMWRITE_JPEG_OPTIMIZE, 1)


def png_files() -> Iterator[bytes]:
    for channels in (1, 3, 4):
        for bits in (8, 16):
            yield _encoded(".png", _picture(channels, bits))
    yield _encoded(".png", _picture(1) & 128, cv2.IMWRITE_PNG_BILEVEL, 1)


def tiff_and_webp_files() -> Iterator[bytes]:
    for compression in (1, 5, 8, 32773):
        for bits in (8, 16):
            yield _encoded(".tiff", _picture(3, bits), cv2.IMWRITE_TIFF_COMPRESSION, compression)
    for quality in (60, 101):
        for channels in (3, 4):
            yield _encoded(".webp", _picture(channels), cv2.IMWRITE_WEBP_QUALITY, quality)


def compressed_depths() -> Iterator[bytes]:
    png = _encoded(".png", _picture(1, 16))
    yield _compressed(bytes(12) + png, "16UC1; compressedDepth png")
    yield _compressed(struct.pack("<iff", 0, 10100.0, -335.0) + png, "32FC1; compressedDepth png")


def tiff_files() -> Iterator[bytes]:
    """Two pages in strips, tiles or both byte orders, and BigTIFF."""
    grey = np.stack([_picture(1), _picture(1, 16).astype(np.uint8)]).reshape(2, *_SIZE)
    variants: tuple[dict[str, Any], ...] = (
        {}, {"byteorder": ">"}, {"bigtiff": True}, {"rowsperstrip": 1}, {"compression": "zlib"})
    for options in variants:
        file = BytesIO()
        tifffile.imwrite(file, grey, photometric="minisblack", **options)
        yield file.getvalue()
    file = BytesIO()
    tifffile.imwrite(file, np.zeros((2, 16, 32), np.uint8), photometric="minisblack", tile=(16, 16))
    yield file.getvalue()


def photos() -> Iterator[bytes]:
    """Images with orientation and capture time, and an animation."""
    exif = Pillow.Exif()
    exif[0x0112] = 6
    exif.get_ifd(0x8769).update({0x9003: "2023:05:04 10:15:00", 0x9291: "04"})
    image = Pillow.fromarray(_picture(3))
    for kind in ("JPEG", "PNG", "TIFF", "WEBP"):
        file = BytesIO()
        image.save(file, kind, exif=exif)
        yield file.getvalue()
    file = BytesIO()
    image.save(file, "PNG", save_all=True, append_images=[image.rotate(180)])
    yield file.getvalue()


def _compressed(data: bytes, message_format: str = "png") -> bytes:
    message = JAZZY.types[COMPRESSED_IMAGE](_HEADER, message_format, np.frombuffer(data, np.uint8))
    return bytes(JAZZY.serialize_cdr(message, COMPRESSED_IMAGE))


def compressed_images() -> Iterator[bytes]:
    yield from map(_compressed, (*jpeg_files(), *png_files()))


def compressed_tiff_and_webp() -> Iterator[bytes]:
    yield from map(_compressed, tiff_and_webp_files())


def coded_messages() -> Iterator[bytes]:
    """After the number of their type in CODED."""
    packet, data = Packet(0, b"0123"), np.frombuffer(b"0123", np.uint8)
    made = [compressed_video("h264")(packet, START_NS), compressed_video("png")(packet, START_NS),
            bytes(_RAW_STORE.serialize_cdr(_RAW_STORE.types[_RAW](_TIME, "cam", 2, 2, "mono8", 2, data), _RAW)),
            ffmpeg_packet("libx264")(packet, START_NS)]
    made += [proto((1, proto_time(START_NS)), (2, b"cam"), (3, b"0123"), (4, b"h264")),
             proto((1, proto_time(START_NS)), (4, b"cam"), (2, next(png_files())), (3, b"png")),
             proto((1, proto_time(START_NS)), (2, 2), (3, 2), (4, b"mono8"), (5, 2), (6, b"0123"), (7, b"cam"))]
    for number, message in enumerate(made):
        yield bytes([number]) + message


def definitions() -> Iterator[bytes]:
    for text in CDR_DEFINITIONS.values():
        yield text.encode()
    yield STORE.generate_msgdef(FFMPEG_PACKET, ros_version=2)[0].encode()


def coded_videos() -> Iterator[bytes]:
    """After the number of their format in VIDEO."""
    rng = np.random.default_rng(1)
    picture = rng.integers(0, 255, (60, 84, 3), np.uint8)
    shown = [np.ascontiguousarray(picture[i : i + 48, i : i + 64]) for i in range(7)]
    for number, encoder, options in (
            (0, "libx264", {}), (0, "libx264", {"bf": "2", "preset": "medium"}), (1, "libx265", {}),
            (2, "libvpx-vp9", {}), (3, "libsvtav1", {})):
        yield bytes([number]) + b"".join(len(packet.data).to_bytes(2, "little") + packet.data
                                         for packet in encoded_images(shown, encoder, **options))


def camera_infos() -> Iterator[bytes]:
    """Cameras and, as P makes them such, homographies."""
    roi = JAZZY.types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
    K = np.array([400.0, 0, 240, 0, 400, 135, 0, 0, 1])
    P = np.array([400.0, 0, 240, 0, 0, 400, 135, 0, 0, 0, 1, 0])
    for model, d in (("plumb_bob", 5), ("rational_polynomial", 8), ("equidistant", 4), ("plumb_bob", 0)):
        message = JAZZY.types[CAMERA_INFO](
            _HEADER, 270, 480, model, np.full(d, 0.01), K, np.eye(3).ravel(), P, 0, 0, roi)
        for little_endian in (True, False):
            cdr = bytes(JAZZY.serialize_cdr(message, CAMERA_INFO, little_endian=little_endian))
            yield from (cdr, bytes((0, cdr[1] + 6)) + cdr[2:])  # and as XCDR2
    lost = JAZZY.types[CAMERA_INFO](_HEADER, 270, 480, "", np.zeros(0), K * 0, K * 0, P * 0, 0, 0, roi)
    yield bytes(JAZZY.serialize_cdr(lost, CAMERA_INFO))


def _written(name: str, write: Callable[[Path], object]) -> bytes:
    with TemporaryDirectory() as folder:
        path = Path(folder) / name
        write(path)
        return path.read_bytes()


def mcap_files() -> Iterator[bytes]:
    """Without CRCs too, so that damage gets past them."""
    short = [message for message in FLIGHT if message.topic == "/notes"]
    variants: tuple[dict[str, Any], ...] = (
        {}, {"enable_crcs": False}, {"enable_crcs": False, "use_chunking": False},
        {"enable_crcs": False, "use_summary_offsets": False, "use_statistics": False})
    for options in variants:
        for compression in (CompressionType.NONE, CompressionType.LZ4, CompressionType.ZSTD):
            whole = _written("a.mcap", partial(by_mcap, messages=short[:6], chunk_size=120, compression=compression,
                                               **options))
            yield whole
        yield whole[: len(whole) * 2 // 3]  # without an index
    with TemporaryDirectory() as folder:
        plain = by_mcap(Path(folder) / "a.mcap", short[:2])
        yield _written("a.mcap", lambda path: with_extras(plain, path, EXTRAS[:3], enable_crcs=False))


def ros1_mcap_files() -> Iterator[bytes]:
    yield _written("a.mcap", partial(by_mcap_ros1, chunk_size=120, enable_crcs=False))


def db3_files() -> Iterator[bytes]:
    with TemporaryDirectory() as folder:
        with Writer2(Path(folder) / "bag", version=9) as writer:
            connection = writer.add_connection("/notes", STRING, typestore=JAZZY)
            for message in FLIGHT[1:10:2]:
                writer.write(connection, message.log_time_ns, message.data)
        yield (Path(folder) / "bag" / "bag.db3").read_bytes()


def bag_files() -> Iterator[bytes]:
    for compression in (None, Writer1.CompressionFormat.BZ2, Writer1.CompressionFormat.LZ4):
        yield _written("a.bag", partial(_write_ros1, compression=compression))


def _write_ros1(path: Path, compression: Any) -> None:
    writer = Writer1(path)
    if compression:
        writer.set_compression(compression)
    with writer:
        for topic, msgtype, message in ros1_messages()[:1]:
            connection = writer.add_connection(topic, msgtype, typestore=NOETIC)
            for number in range(3):
                writer.write(connection, START_NS + number, NOETIC.serialize_ros1(message, msgtype))


def fixes() -> Iterator[bytes]:
    status = JAZZY.types["sensor_msgs/msg/NavSatStatus"](status=2, service=1)
    yield bytes(JAZZY.serialize_cdr(JAZZY.types[NAV_SAT_FIX](
        header=_HEADER, status=status, latitude=55.1, longitude=-1.5, altitude=93.4,
        position_covariance=np.diag([1.0, 4, 9]).ravel(), position_covariance_type=3), NAV_SAT_FIX))


def attitudes() -> Iterator[bytes]:
    """After the number of their type in ATTITUDE_TYPES."""
    q = JAZZY.types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.6, z=0.0, w=0.8)
    zero = JAZZY.types["geometry_msgs/msg/Vector3"](x=0.0, y=0.0, z=0.0)
    covariance = np.diag([1.0, 4, 9]).ravel()
    imu = JAZZY.types[IMU](header=_HEADER, orientation=q, orientation_covariance=covariance, angular_velocity=zero,
                           angular_velocity_covariance=covariance, linear_acceleration=zero,
                           linear_acceleration_covariance=covariance)
    yield b"\0" + bytes(JAZZY.serialize_cdr(imu, IMU))
    stamped = JAZZY.types[QUATERNION_STAMPED](header=_HEADER, quaternion=q)
    yield b"\1" + bytes(JAZZY.serialize_cdr(stamped, QUATERNION_STAMPED))


def water_levels() -> Iterator[bytes]:
    """After the number of their type in WATER_LEVEL_TYPES."""
    yield b"\0" + bytes(JAZZY.serialize_cdr(JAZZY.types[FLOAT64](data=12.5), FLOAT64))
    point = JAZZY.types["geometry_msgs/msg/Point"](x=0.0, y=0.0, z=12.5)
    yield b"\1" + bytes(JAZZY.serialize_cdr(JAZZY.types[POINT_STAMPED](header=_HEADER, point=point), POINT_STAMPED))


def transforms() -> Iterator[bytes]:
    types = JAZZY.types
    place = types["geometry_msgs/msg/Transform"](
        translation=types["geometry_msgs/msg/Vector3"](x=1.0, y=2.0, z=46.0),
        rotation=types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.6, z=0.0, w=0.8))
    stamped = [types["geometry_msgs/msg/TransformStamped"](header=_HEADER, child_frame_id=name, transform=place)
               for name in ("base_link", "cam")]
    yield bytes(JAZZY.serialize_cdr(types[TF_MESSAGE](transforms=stamped), TF_MESSAGE))


def subtitles() -> Iterator[bytes]:
    block = ("{}\n00:00:0{},040 --> 00:00:09,000\n<font size=\"28\">FrameCnt : 1, DiffTime : 40ms\n2022-08-07 "
             "12:00:0{},774,808\n[iso : 100] [latitude: 55.{}10009] [longtitude : -1.670001] "
             "[rel_alt: 1.300 abs_alt: 93.401] [gb_yaw: -142.5 gb_pitch: -88.7 gb_roll: 0.0] </font>\n\n")
    yield "".join(block.format(n, n, n, n // 2) for n in range(1, 7)).encode("utf-8-sig")
    phantom = ("1\r\n00:00:00,000 --> 00:00:01,000\r\nF/5.6, SS 400, GPS (-58.851745, -34.237922, 15), HOME (-58.84, "
               "-34.23, 7.60m), H 85.80m, F.PRY (2.7°, -7.0°, 110.1°), G.PRY (-24.4°, 0.0°, 110.4°)\r\n")
    yield phantom.encode("utf-16")
    yield (b"1\n00:00:01,000 --> 00:00:02,000\nHOME(149.0251,-20.2532) 2017.8.5 14:11:51\n"
           b"GPS(149.0251,-20.2533,16) Hb:1.9\n")
    yield b"1\n2022.06.21 16:06:17\nGPS(36.6146,-6.1120,0.0M) BAROMETER:8.4M\n"


def solutions() -> Iterator[bytes]:
    names = "Q  ns   sdn(m)   sde(m)   sdu(m)  sdne(m)  sdeu(m)  sdun(m) age(s)  ratio\n"
    yield ("% program   : rnx2rtkp ver.2.4.3\n%  GPST                  latitude(deg) longitude(deg)  height(m)   "
           f"{names}2026/01/14 21:17:29.000   32.064101442   34.800189222    94.8836   2   4   0.0880   0.1341   "
           "0.3388  -0.05  0.02  0.01  0.00    1.6\n2401 604799.875 32.064101443   34.800189222 94.8 1 9\n").encode()
    yield (b"%  UTC x-ecef(m) y-ecef(m) z-ecef(m) Q ns sdx(m) sdy(m) sdz(m) sdxy(m) sdyz(m) sdzx(m) age(s) ratio\n"
           b"2018/06/22 06:17:30.000 -4647152.8622 2562199.8251 -3526633.5232 5 5 31.7 35.8 11.3 -33.2 -18.2 17.1 0\n")
    yield (b"% JST,latitude(d'\"),longitude(d'\"),height(m),Q,ns\n"
           b"2020/08/25 12:03:00.0,-0 30 36.0,  8 15 0.0, 100.5,1,9\n")


def tables() -> Iterator[bytes]:
    yield (b"time,lat,lon,height_m,sde,sdn,sdu,qx,qy,qz,qw\n0.1,55.1,-1.5,93.4,1,1,2,0,0,0.6,0.8\n"
           b"0.2,55.1,-1.5,93.4,1,1,2,0,0,0,1\n")
    yield (b"time(millisecond);datetime(utc);latitude;longitude;altitude_above_seaLevel(feet);gimbal_heading(degrees);"
           b"gimbal_pitch(degrees)\r\n100;2024-05-05 23:59:59;55,1;-1,5;100,5;90;-90\r\n")
    yield b"date,time,lat,lon\n2024-05-05,23:59:59.5,55.1,2\n2024-05-06,00:00:00.5,55.1,2\n"
    yield b"time,lat,lon\n23:59:59.5,55.1,2\n00:00:00.5,55.1,2\n"


def points_tables() -> Iterator[bytes]:
    yield b"name,x,y\nV1,10,20.5\nleft bank,1e2,7\n"
    yield b'\xef\xbb\xbfy,x,name,note\r\n20.5,10,V1,"a, b"\r\n7, 100, "left\nbank",\r\n'


def point_lists() -> Iterator[bytes]:
    yield b"[[60, 50], [330, 60.4], [340.2, 240], [70, 230.7]]"


def polygons() -> Iterator[bytes]:
    square = [[100, 50], [300, 50], [300, 250], [100, 250]]
    yield json.dumps([square]).encode()
    yield json.dumps([square, [[0.5, 0.5], [9, 1e1], [-3, 20]]]).encode()


def homography_tables() -> Iterator[bytes]:
    header = "frame,stamp_ns,status,h00,h01,h02,h10,h11,h12,h20,h21,h22"
    yield (f"{header}\n0,1700000000000000000,TRACKING,1,0,0,0,1,0,0,0,1\n1,1700000000040000000,LOST,,,,,,,,,\n"
           "2,1700000000080000000,OK,1.01,-0.02,3.5,0.02,0.99,-2,1e-6,2e-6,1\n").encode()
    yield f'{header},matches\r\n0,1,"LOST",,,,,,,,,,7\r\n'.encode()


def velocity_tables() -> Iterator[bytes]:
    header = ("x_start_m,y_start_m,vx_m_s,vy_m_s,speed_m_s,x_end_m,y_end_m,dt_s,sigma_speed_m_s,var_vx,cov_vxvy,var_vy,"
              "start_ns,end_ns,track_id,shared_vx_0,shared_vy_0")
    yield f"{header}\n1,2,0.5,0,0.5,1.5,2,1,0.01,1e-4,0,1e-4,1000000000,2000000000,7,0.01,-0.02\n".encode()
    yield header.replace("_m", "_px").encode()


def velocities() -> Iterator[bytes]:
    v = Vectors(np.array([[1.0, 2]]), np.array([[1.5, 2]]), np.array([10**9]), np.array([2 * 10**9]),
                np.eye(2)[None] / 100, np.ones((1, 2, 2)) / 50, np.array([7]))
    yield velocity_cdr(v, 54.2, Header(2 * 10**9, "map"))
    yield velocity_cdr(v[:0], 0.0, Header(2 * 10**9, "map"))


def line_lists() -> Iterator[bytes]:
    yield b"[[[0, 0], [10.5, 2]], [[1, 2], [3, -4e1]]]"


def tracks() -> Iterator[bytes]:
    for track in (Track(State.LOST, 0, 10**9, 0, 2, lost_reason=LostReason.NO_TEXTURE),
                  Track(State.TRACKED, 1, 2 * 10**9, 0, 2, 50, 40, np.eye(3), np.eye(8) / 7, 0.2, 0.1)):
        yield track_cdr(track, Header(track.stamp_ns, "cam"), Window(-10, 20, (640, 480), 0.5))


def parameter_files() -> Iterator[bytes]:
    yield (b"/**:\n  ros__parameters:\n    method: klt\n    min_inliers: 12\n    direct: {patches: 300}\n"
           b"    output_roi: '0, 0, 100, 100'\n    use_camera_info: true\n")
    yield b"/cam:\n  tracker_node:\n    ros__parameters: {model: affine, min_inlier_share: 0.3, queue_depth: 2}\n"
    yield b"a: &x [1, 2]\nb: *x\n/**: {ros__parameters: {roi: !!str '[]', exclude: |\n   [[]]\n}}\n"


def output_rois() -> Iterator[bytes]:
    yield from (b"0, 0, 640, 480", b"[-10,-20, 1920,1080]", b"")


def metadata_files() -> Iterator[bytes]:
    yield (b"rosbag2_bagfile_information:\n  version: 9\n  storage_identifier: mcap\n"
           b"  relative_file_paths: [part.mcap]\n  compression_mode: ''\n  compression_format: ''\n")


def gcp_tables() -> Iterator[bytes]:
    yield b"name,x,y,X,Y,Z\nA,10.5,20,1.25,2.5,0.5\nB,1800,900.25,30,-40,1\n"
    yield b"name;x;y;lat;lon\nA;10,5;20;46,1;7,2\n"
    yield b'"X [meters]","Y [meters]","Z [meters]","X [px]","Y [px]"\n1.25,2.5,.5,11.5,21\n'
    yield b'flight.mp4,1,,,\nFrame,1,,,\n1,2,3,4,5\n,,,,\nFrame,00026,,,\n1,2,3,6,7\n'
    yield "name,x,y,X,Y,Z\nA,1,2,3,4,5\n".encode("utf-16")


def section_tables() -> Iterator[bytes]:
    yield b"X,Y,Z\n1.5,2,3\n2,3,2.5\n4,5,3.5\n"
    yield b"\xef\xbb\xbfchainage (ft);depth\n0;0\n1,5;2\n3;0\n"
    yield "Station\tZ/Depth\n0\t1\n2\t3\n".encode("utf-16")


def gauging_tables() -> Iterator[bytes]:
    yield b"stage_m,discharge_m3_s,sigma_m3_s,shared_sigma,source\n1.2,30.5,1.5,0.05,a.mcap\n1.6,60,3,0.05,b.mcap\n"


def gcp_features() -> Iterator[bytes]:
    yield (b'{"type":"FeatureCollection","crs":{"properties":{"name":"urn:ogc:def:crs:EPSG::2056"}},"features":['
           b'{"type":"Feature","properties":{"name":"A","x":1,"y":2.5},"geometry":{"type":"Point","coordinates":'
           b'[7.2,46.1,500]}}]}')


def camera_files() -> Iterator[bytes]:
    yield (b"image_width: 640\nimage_height: 480\ncamera_name: c\ncamera_matrix:\n  rows: 3\n  cols: 3\n"
           b"  data: [438.7, 0.0, 305.5, 0.0, 437.3, 243.7, 0.0, 0.0, 1.0]\ndistortion_model: plumb_bob\n"
           b"distortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [-0.36, 0.11, 0.001, 0.0005, 0.0]\n"
           b"pose: {position_m: [1.0, 2.0, 46.0], map_q_optical_xyzw: [0.0, 0.0, 0.0, 1.0]}\n"
           b"fitted: {parameters: [f_px], covariance: {rows: 1, cols: 1, data: [4.0]}}\ncrs: EPSG:2056\n"
           b"origin: {latitude_deg: 46.1, longitude_deg: 7.2, height_m: 0.0}\nwse_m: 455.2\n")


def _videos(*names: str) -> Iterator[bytes]:
    for name in names:
        yield (Path(__file__).resolve().parents[1] / "data" / "videos" / name).read_bytes()


SEEDS: dict[str, Callable[[], Iterator[bytes]]] = {
    "image": images, "stamp": images, "compressed": compressed_images, "tiff_webp": compressed_tiff_and_webp,
    "compressed_depth": compressed_depths, "png_with_crc": png_files, "jpeg": jpeg_files,
    "coded": coded_messages, "definition": definitions, "coded_video": coded_videos, "ros1_mcap": ros1_mcap_files,
    "camera": camera_infos, "homography": camera_infos, "track": tracks, "mcap": mcap_files, "db3": db3_files,
    "bag": bag_files,
    "tiff": tiff_files, "photo": photos,
    "metadata": metadata_files, "points": points_tables, "point_list": point_lists, "polygons": polygons,
    "polygon_file": polygons, "mask": png_files, "static_map": png_files, "homographies": homography_tables,
    "velocities": velocity_tables, "velocity": velocities, "lines": line_lists,
    "fix": fixes, "attitude": attitudes, "water_level": water_levels, "transforms": transforms,
    "srt": subtitles, "pos": solutions, "table": tables,
    "section": section_tables, "gaugings": gauging_tables,
    "gcps": gcp_tables, "geojson": gcp_features, "camera_file": camera_files,
    "parameters": parameter_files, "output_roi": output_rois,
    "mp4": partial(_videos, "plain.mp4", "edit_list.mp4", "rotated.mp4", "av1.mp4", "interlaced.mp4"),
    "avi": partial(_videos, "reordered.avi", "mjpeg.avi"), "mkv": partial(_videos, "vfr.mkv", "vp9.webm"),
}


def write_seeds(folder: Path) -> None:
    """As folder/NAME.seeds, every input after its length."""
    for name, make in SEEDS.items():
        packed = b"".join(struct.pack("<I", len(seed)) + seed for seed in make())
        (folder / f"{name}.seeds").write_bytes(packed)


def read_seeds(path: Path) -> list[bytes]:
    data, seeds, at = path.read_bytes(), [], 0
    while at < len(data):
        (length,) = struct.unpack_from("<I", data, at)
        seeds.append(data[at + 4 : at + 4 + length])
        at += 4 + length
    return seeds


if __name__ == "__main__":
    write_seeds(Path(sys.argv[1]))
