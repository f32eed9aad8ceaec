"""Every reader of what others send, as a function of bytes: it returns, raises a StabRosError of one line or has a bug.

What is a file to the reader becomes one in the working directory.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stab_ros.core.types import Frame
from stab_ros.imaging.window import Window
from stab_ros.io.attitude_message import ATTITUDE_TYPES, read_attitude
from stab_ros.io.bag import Message, Topic, open_bag
from stab_ros.io.camera_file import read_camera_file
from stab_ros.io.camera_message import read_camera
from stab_ros.io.cdr import COMPRESSED_IMAGE, IMAGE, Header, read_stamp
from stab_ros.io.coded_message import CDR_DEFINITIONS, FFMPEG_PACKET, PROTOBUF_FIELDS, CodedImage
from stab_ros.io.fix_message import read_fix
from stab_ros.io.gauging_file import read_gaugings
from stab_ros.io.gcp_file import read_gcps
from stab_ros.io.homographies import read_homographies
from stab_ros.io.homography_message import read_homography
from stab_ros.io.image_message import read_image
from stab_ros.io.image_metadata import TURNS, UPRIGHT, read_metadata
from stab_ros.io.image_topic import read_content, stamp_of
from stab_ros.io.lines import read_lines
from stab_ros.io.points import read_points, read_tracking_points
from stab_ros.io.regions import read_area
from stab_ros.io.section_file import read_section
from stab_ros.io.static_maps import read_static_map
from stab_ros.io.stored_image import stored_images
from stab_ros.io.tiff_pages import DamagedTiffError
from stab_ros.io.track_message import read_track
from stab_ros.io.transform_message import read_children
from stab_ros.io.velocity_csv import read_velocities
from stab_ros.io.velocity_message import read_velocity
from stab_ros.io.video import VideoFile
from stab_ros.io.video_pictures import VideoPictures
from stab_ros.io.water_level_message import WATER_LEVEL_TYPES, read_water_level
from stab_ros.jobs.telemetry import Telemetry, convert_telemetry
from stab_ros.parameters.file import read_config

Read = Callable[[bytes], object]


@dataclass(frozen=True)
class Target:
    """share: of all inputs, relative to those of the others. tokens: words of a text format."""

    read: Read
    share: int
    tokens: tuple[bytes, ...] = ()


def _image(msgtype: str) -> Read:
    def read(cdr: bytes) -> None:
        frame = read_image(cdr, msgtype)
        assert frame.image.flags.c_contiguous
        assert frame.image.flags.aligned
        assert frame.image.dtype in (np.uint8, np.uint16, np.float32)
        assert frame.size == frame.image.shape[1::-1]
        float(frame.image.sum(dtype=np.float64))  # every byte can be read

    return read


CODED = (*((name, "cdr") for name in CDR_DEFINITIONS), *((name, "protobuf") for name in PROTOBUF_FIELDS))
VIDEO = ("h264", "h265", "vp9", "av1")


def _coded(data: bytes) -> None:
    """A byte that chooses the type, and a message."""
    msgtype, encoding = CODED[data[0] % len(CODED) if data else 0]
    topic = Topic("/a", msgtype, 1, "", encoding=encoding, schema_encoding="")
    stamp_of(data[1:], topic)
    read_content(data[1:], topic)


def _definition(data: bytes) -> None:
    """A definition that does not fit its messages."""
    read_content(b"\0\1\0\0" + bytes(60), Topic("/a", FFMPEG_PACKET, 1, data.decode(errors="surrogateescape")))


def _coded_video(data: bytes) -> None:
    """A byte that chooses the format, and packets, each after two bytes that give its length."""
    video_format, at, sent = VIDEO[data[0] % len(VIDEO) if data else 0], 1, 0
    video, stamps_ns = VideoPictures(), []
    while at < len(data):
        end = at + 2 + int.from_bytes(data[at : at + 2], "little")
        packet = CodedImage(Header(sent), video_format, np.frombuffer(data[at + 2 : end], np.uint8))
        stamps_ns += [picture.stamp_ns for picture in video.take(Message("/a", sent, sent, b""), packet)]
        at, sent = end, sent + 1
    stamps_ns += [picture.stamp_ns for picture in video.finish()]
    assert sorted(stamps_ns) == list(range(sent))


def _png_with_crc(data: bytes) -> None:
    """The checksums are made right, so that damage reaches the decoder."""
    fixed, at = bytearray(data[:8]), 8
    while at + 8 <= len(data):
        (length,) = struct.unpack_from(">I", data, at)
        body = data[at + 4 : at + 8 + length]
        fixed += data[at : at + 4] + body + struct.pack(">I", zlib.crc32(body))
        at += 12 + length
    _file("input.png", lambda path: read_static_map({"static_map": path}))(bytes(fixed))


def _file(name: str, read: Callable[[str], object]) -> Read:
    def read_file(data: bytes) -> object:
        Path(name).write_bytes(data)
        return read(name)

    return read_file


def _bag(path: str) -> None:
    with open_bag(Path(path)) as reader:
        last_ns = 0
        for message in reader.messages():
            assert message.topic in reader.topics
            assert message.log_time_ns >= last_ns or not path.endswith(".mcap")
            last_ns = message.log_time_ns
        for extra in reader.extras():
            assert sum(map(len, extra.pieces())) == extra.index.length
        assert all(len(line.splitlines()) == 1 for line in reader.warnings), reader.warnings


def _video(path: str) -> None:
    with closing(VideoFile(Path(path), None)) as video:
        last_ns = 0
        for number, (stamp_ns, decoded) in enumerate(video.frames()):
            assert stamp_ns > last_ns
            assert isinstance(decoded, Frame)
            last_ns = stamp_ns
            if number > 50:
                break
        assert all(len(line.splitlines()) == 1 for line in video.warnings), video.warnings
        assert video.fps > 0


def _folder(data: bytes) -> None:
    Path("folder").mkdir(exist_ok=True)
    Path("folder/part.mcap").write_bytes(b"\x89MCAP0\r\n")
    Path("folder/metadata.yaml").write_bytes(data)
    _bag("folder")


def _tiff(path: str) -> None:
    """A page that is cut out is not much larger than its file, whatever that claims."""
    images, remark = stored_images(Path(path))
    assert len(remark.splitlines()) <= 1
    for image in images:
        with suppress(DamagedTiffError):
            assert len(image.read()) <= 4 * Path(path).stat().st_size + 64


def _metadata(path: str) -> None:
    found = read_metadata(Path(path))
    assert found.orientation in (UPRIGHT, *TURNS)
    assert found.pictures >= 1


def _fix(cdr: bytes) -> None:
    fix = read_fix(cdr)
    assert fix.fault or (abs(fix.latitude_deg) <= 90 and abs(fix.longitude_deg) <= 360)
    assert fix.covariance_m2 is None or np.isfinite(fix.covariance_m2).all()


def _attitude(data: bytes) -> None:
    """A byte that chooses the type, and a message."""
    attitude = read_attitude(data[1:], ATTITUDE_TYPES[data[0] % len(ATTITUDE_TYPES) if data else 0])
    assert attitude.fault or abs(np.linalg.norm(attitude.map_q_body) - 1) < 1e-12


def _water_level(data: bytes) -> None:
    """A byte that chooses the type, and a message."""
    level = read_water_level(data[1:], WATER_LEVEL_TYPES[data[0] % len(WATER_LEVEL_TYPES) if data else 0], 0)
    assert level.fault or np.isfinite(level.wse_m)


def _telemetry(path: str) -> None:
    """What is written can be read, and is said in whole lines."""
    done = convert_telemetry(Telemetry((Path(path),), Path("output.mcap"), force=True), lambda done, total: None)
    assert all(len(line.splitlines()) == 1 for line in (*done.notes, *done.warnings)), done
    with open_bag(Path("output.mcap")) as reader:
        assert sum(1 for _ in reader.messages()) == sum(done.counts.values())


def _text(read: Callable[[str], object]) -> Read:
    return lambda data: read(data.decode(errors="surrogateescape"))


_NUMBERS = (b"0", b"-1", b"nan", b"inf", b"1e999", b"9" * 30, b"1" * 5000, b"0x" + b"f" * 5000, b"1_0", b"", b"\x00",
            b"\xff", b"\xd9\xa3", b"-0", b".5")
_CSV = (*_NUMBERS, b",", b"\n", b"\r", b"\r\n\n", b'"', b'""', b"name", b"x", b"frame", b"status", b"LOST", b"," * 99)
_JSON = (*_NUMBERS, b"[", b"]", b"{", b"}", b"[[", b"]]", b"null", b"true", b'"a"', b"NaN", b"-Infinity", b"[" * 999,
         b"[" * 9999, b'{"a":' * 2000, b'"\\ud800"', b"[1,2],")
_YAML = (*_NUMBERS, b"&a ", b"*a", b"<<: *x", b"!!binary", b"!!timestamp x", b"!!bool x", b"!!int ''", b"!!float x",
         b"!!python/object:os.system ", b"!!set {a}", b"!!omap [a: 1]", b"2001-99-99", b"1:99:99", b"? ", b"- ", b": ",
         b"|\n ", b"---\n", b"%YAML 9.9\n", b"{", b"[" * 999, b"{a: " * 999, b"~", b"ros__parameters", b"/**",
         b"\n  ", b"\t", b"'", b'"\\x', b"# ", b"roi", b"min_inliers", b"0b_", b"0o9", b"=", b"\xc2\x85",
         b"\xe2\x80\xa8", b"[a, {b: c}]", b"qos_overrides.")

_SRT = (*_NUMBERS, b"[", b"]", b"(", b")", b"[latitude: ", b"[longtitude : ", b"GPS(", b"G.PRY (", b"\xb0", b",", b"\n",
        b" --> ", b"00:00:01,000 --> 00:00:02,000\n", b"99:99:99,999", b"2022-02-30 10:00:00,1,2",
        b"9999-12-31 24:60:60", b"0001-01-01 00:00:00", b"rel_alt: ", b"gb_yaw: ", b"N/A", b"\xff\xfe", b"\x00", b"1\n",
        b"M", b": ", b"=")
_POS = (*_NUMBERS, b"%", b"GPST", b"UTC", b"JST", b"latitude(deg)", b"latitude(d'\")", b"x-ecef(m)", b"height(m)", b",",
        b"\t", b"\n", b"Q", b"sdn(m)", b"2401 604800.0", b"9999/12/31 23:59:60.999", b"0001/01/01 00:00:00", b"Tokyo")
_TABLE = (*_CSV, b";", b"\t", b"time", b"latitude", b"lon", b"datetime(utc)", b"qx", b"(feet)", b"[rad]", b"_ms",
          b"23:59:59", b"00:00:00", b"2022-08-07T12:00:00+99:99", b"1e17", b"-1e17", b"9999-12-31 23:59:59", b"sep=;")
_GCPS = (*_CSV, b";", b"\t", b"X [meters]", b"X [px]", b"lat", b"lon", b"Frame", b"\xff\xfe", b"#", b"Y", b"1,5")
_SECTION = (*_CSV, b";", b"\t", b"chainage", b"depth", b"Z/Depth", b"Z", b"X", b"Y", b" (ft)", b"_m", b"1,5",
            b"\xff\xfe")
_GEOJSON = (*_JSON, b'"features"', b'"coordinates"', b'"properties"', b'"crs"', b"EPSG::", b'"Point"')
_CAMERA = (*_YAML, b"camera_matrix", b"data", b"pose", b"origin", b"fitted", b"covariance", b"equidistant")

TARGETS: dict[str, Target] = {
    "image": Target(_image(IMAGE), 150),
    "compressed": Target(_image(COMPRESSED_IMAGE), 40),
    "tiff_webp": Target(_image(COMPRESSED_IMAGE), 40),
    "compressed_depth": Target(_image(COMPRESSED_IMAGE), 20),
    "jpeg": Target(_file("input.jpg", lambda path: read_static_map({"static_map": path})), 20),
    "png_with_crc": Target(_png_with_crc, 40),
    "tiff": Target(_file("input.tif", _tiff), 40),
    "photo": Target(_file("input.jpg", _metadata), 20),
    "mask": Target(_file("mask.png", lambda path: read_area({"exclude": path})), 20),
    "static_map": Target(_file("map.png", lambda path: read_static_map({"static_map": path})), 20),
    "coded": Target(_coded, 40),
    "definition": Target(_definition, 5, (b"uint8", b"[]", b"[<=", b"]", b" ", b"\n", b"=", b"std_msgs/Header", b"#",
                                           b"MSG: ", b"=" * 80, b"wstring", b"string<=", b"99999999999", b"/")),
    "coded_video": Target(_coded_video, 30),
    "camera": Target(read_camera, 90),
    "homography": Target(read_homography, 70),
    "track": Target(read_track, 30, (*_NUMBERS, b" ", b"covariance", b"offset", b"scale", b"reset_counter")),
    "stamp": Target(read_stamp, 40),
    "fix": Target(_fix, 30),
    "attitude": Target(_attitude, 30),
    "water_level": Target(_water_level, 10),
    "transforms": Target(read_children, 10),
    "srt": Target(_file("input.srt", _telemetry), 40, _SRT),
    "pos": Target(_file("input.pos", _telemetry), 40, _POS),
    "table": Target(_file("input.csv", _telemetry), 40, _TABLE),
    "mcap": Target(_file("input.mcap", _bag), 180),
    "ros1_mcap": Target(_file("input.mcap", _bag), 5),
    "db3": Target(_file("input.db3", _bag), 30),
    "bag": Target(_file("input.bag", _bag), 30),
    "mp4": Target(_file("input.mp4", _video), 10),
    "avi": Target(_file("input.avi", _video), 10),
    "mkv": Target(_file("input.mkv", _video), 10),
    "metadata": Target(_folder, 15, (*_YAML, b"compression_mode", b"relative_file_paths", b"storage_identifier")),
    "points": Target(_file("points.csv", lambda path: read_points(Path(path))), 70, _CSV),
    "point_list": Target(_text(lambda text: read_tracking_points({"manual_points": text})), 40, _JSON),
    "polygons": Target(_text(lambda text: read_area({"roi": text})), 30, _JSON),
    "polygon_file": Target(_file("roi.json", lambda path: read_area({"roi": path})), 30, _JSON),
    "gcps": Target(_file("gcps.csv", lambda path: read_gcps(Path(path))), 50, _GCPS),
    "section": Target(_file("section.csv", lambda path: read_section(Path(path))), 50, _SECTION),
    "gaugings": Target(_file("R.csv", lambda path: read_gaugings(Path(path))), 30, _CSV),
    "geojson": Target(_file("gcps.geojson", lambda path: read_gcps(Path(path))), 30, _GEOJSON),
    "camera_file": Target(_file("camera.yaml", lambda path: read_camera_file(Path(path))), 30, _CAMERA),
    "homographies": Target(_file("H.csv", lambda path: read_homographies(Path(path))), 50, _CSV),
    "velocities": Target(_file("V.csv", lambda path: read_velocities(Path(path))), 50, _CSV),
    "velocity": Target(read_velocity, 50),
    "lines": Target(_text(lambda text: read_lines({"lines": text})), 20, _JSON),
    "parameters": Target(_file("p.yaml", lambda path: read_config(Path(path))), 50, _YAML),
    "output_roi": Target(_text(Window.of), 30, (*_NUMBERS, b",", b", ", b"[", b"]", b"-", b"999999", b"16384")),
}
