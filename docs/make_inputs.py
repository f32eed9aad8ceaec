"""Prints docs/inputs.md from the tables by which inputs are read.

python docs/make_inputs.py > docs/inputs.md
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from stab_ros.core.types import CHANNELS, Frame
from stab_ros.io.coded_message import CDR_DEFINITIONS, PROTOBUF_FIELDS
from stab_ros.io.encodings import DECODED
from stab_ros.io.image_message import IMAGE_TYPES
from stab_ros.io.image_names import IMAGE_SUFFIXES, UNREAD_SUFFIXES
from stab_ros.io.image_topic import TO_DO
from stab_ros.io.rosbag2_folder import PART_SUFFIXES
from stab_ros.io.telemetry import KINDS
from stab_ros.io.telemetry_csv import QUANTITIES
from stab_ros.io.video import VIDEO_SUFFIXES
from stab_ros.io.video_decoder import DECODERS

_PAGE = """# Inputs

**Answers:** which files, encodings, containers and codecs are read, what is said where they are not, and how to \
convert those.
**For:** users. This page is made by `python docs/make_inputs.py > docs/inputs.md`.

`stab-ros info INPUT` tells what an input holds, and what is odd about it.

## Recordings

| what | how it is read |
|---|---|
| {bags} and folders of them | rosbag2, MCAP or sqlite3; messages or files compressed by zstd; MCAP chunks with zstd, \
lz4 or none; CDR of either byte order, XCDR2 of final types |
| a split recording | in the order of time. Parts that are missing, damaged or not listed in `metadata.yaml` are \
named; without `metadata.yaml` all parts are taken. A `metadata.yaml` of another program makes no bag |
| `.bag`, and MCAP with messages of ROS 1 | converted to CDR, with the types of Jazzy |
| attachments and metadata of an MCAP | `stabilize`, `convert` and `recover` copy them byte for byte; `info` lists \
them |
| a damaged recording | see [below](#damaged-recordings) |

A file that is compressed as a whole is unpacked into the folder for temporary files, and may take half of the space \
that is free there.

### Damaged recordings

What is lost is said, with the place.

| what | what is read | what saves it |
|---|---|---|
| an MCAP that is damaged or cut off | every chunk whose CRC is right, and of the chunk within which the file ends \
each message before that; of lz4 and zstd, which unpack by blocks, often some less | `stab-ros recover BROKEN.mcap \
FIXED.mcap` writes a whole file of what can be read |
| a `.bag` that is cut off, a `.bag.active` that was not closed | nothing, as the index at its end is missing (a whole \
`.bag.active` is read as a `.bag`) | `rosbag reindex` of ROS 1 |
| a `.db3` that is damaged or cut off | nothing, or the messages before the damage where SQLite can still count them | \
`sqlite3 DAMAGED.db3 ".recover" \\| sqlite3 whole.db3` |

Where the program `sqlite3` was built without `.recover` (Debian 12: "SQL logic error"), this saves what lies before \
the damage, of which the last message may be damaged itself:

    sqlite3 DAMAGED.db3 .dump | sed 's/^ROLLBACK.*/COMMIT;/' | sqlite3 whole.db3

### Images in a recording

| type of the topic | encoding of its messages |
|---|---|
{types}

Coded video ({codecs}) is decoded from the first key frame on. Frames before it, and after a packet that is damaged \
or missing until the
next key frame, are LOST. Each message is one frame, with its own stamp; stamps that go on steadily although \
B-frames reorder the pictures, and log times, are
given to frames in the order in which they are shown. With a PyAV older than 16, a missing packet \
of H.265 goes unnoticed.
Packets of VP9 have no numbers, so a missing one shows as smear until the next key frame. A packet that was cut short \
is noticed in H.264; the
decoders of H.265 and VP9 take one in five for whole (cuts of one picture of 60 places), and its picture is smeared \
until the next key frame. The live \
tracker takes no coded video.

A recording without such a topic is refused with the list of its topics. Video of other plugins:

{republish}

### Encodings of sensor_msgs/Image

| `encoding` | the frame is | `image_stabilized` leaves as |
|---|---|---|
{encodings}

More than 8 bits are reduced for the tracker alone: the range of values is that of the reference, from the 0.1 to the \
99.9 percentile, with room
for darker and brighter frames. Zeros, and what is not finite, count as no data. Constant areas (bars,
borders, overlays) are left out, and so are the outermost 2 % where they lie further off than three times the span of \
the others (stuck pixels). Not read:

| encoding | what to do |
|---|---|
| packed or not in whole bytes (`mono10`, `mono12p`, `bayer_rggb12`) | let the driver publish Mono16, BayerRG16 or \
Mono8 |
| planar YUV (`nv12`, `nv21`, `i420`) | let the driver publish bgr8 or yuv422_yuy2, or convert it by a node |
| a coded picture in an Image (`jpeg`, `h264`) | publish it as sensor_msgs/CompressedImage |
| `64FC1`, signed integers | convert it to 32FC1 or 16UC1 |

### sensor_msgs/CompressedImage

JPEG, PNG, TIFF and WebP, with 8 or 16 bits; `compressedDepth` as PNG (16UC1, and 32FC1 with its quantisation). \
`format` tells coded video
and `compressedDepth`; else the content counts: grey stays mono8 or mono16, colour becomes bgr8 or bgr16. A JPEG that \
is cut short is LOST.

## Videos

Containers: {videos}.

Codecs: what the FFmpeg of PyAV decodes: H.264, H.265, AV1, VP9, MPEG-2, ProRes, MJPEG, GIF and many more, with 8 to \
16 bits. Frames become
bgr8 (grey ones mono8), as a player shows them but for the shape of their pixels: turned and flipped as the file says, \
by multiples of 90 degrees (any
other angle is left and said), fields of interlaced video filled in (bwdif), colour by the file's matrix and range. \
Pixels that are not square,
as of anamorphic lenses and standard-definition video, stay as stored, and that is said: tracking does not mind, but \
with one focal length, or
one scale, lengths across and along the picture differ by the factor that is named. \
`-vf "scale=2*round(iw*sar/2):ih,setsar=1"` makes them square.
Grey of more than 8 bits becomes mono16. Of several video streams the largest is read, and that is said; covers are \
left out. For any other codec:

    ffmpeg -i IN -c:v libx264 -crf 12 OUT.mp4

**Time.** Frames are stamped 1 s + their time of presentation. Where that follows the nominal rate as closely as the \
clock of the file can say, it is
exactly 1 s + frame / rate. `--fps` sets a constant rate in its place; \
where the times of the file say another one, both are said. Images that are exact copies of the one before are told \
with their share, in bags and folders, too: their stamps are not those of what they show. Pictures without a \
container hold no times: raw H.264, H.265 and
MPEG (`.h264`, `.h265`, `.hevc`, at times `.m4v`, `.mpg`) and Motion JPEG (`.mjpeg`, `.mjpg`). The rate that the codec \
names counts, else 25 frames/s, and that is
said; give `--fps`. AVI with B-frames has a rate, and no times.

A video that is cut short is read up to its last whole frame, and that is said; a frame that is torn is left out. It \
shows by

- a file that is shorter than its headers say (MKV, WebM, AVI unless written into a pipe, WMV, `.ts`), or has no mark \
of the end (GIF, Ogg)
- a duration of which a tenth and five frames lack (MP4, MOV, MXF, FLV and all others that announce one)
- a torn frame: of Y4M, FLV, JPEG without its end marker, and where the decoder stumbles over the last packet (raw \
H.264, H.265 and MPEG, `.ts`, `.mpg`)

It cannot be known where raw video, Motion JPEG, Y4M or `.mpg` ends between two frames. Decoders let some torn frames \
pass, above all that of H.265: of
60 cuts most at 96x64, 17 at 384x256, and one of 40 at 1280x720. Up to 300 frames from the last key frame on are \
looked at, of 4K 60: where there \
are more, or within the first 32 after such a group, a torn frame is read as it is, and that is not said. \
With B-frames a few of the last frames may lack, \
and without times the stamps run on over them.

An mp4 without its index (`moov`) \
cannot be read: its camera
was switched off while it recorded; tools such as untrunc repair it.

PyAV's wheels bundle FFmpeg (LGPL) with the encoders x264 and x265 (GPL), which are not used here. Under apt, \
`python3-av` uses the FFmpeg of the system.

## Folders of images

| | |
|---|---|
| read | {images}; portable maps (PBM, PGM, PPM) in binary and as text |
| not read, but named | {unread} |
| order | by the numbers in the names, `frame2` before `frame10`; said where the alphabet has another order. Where the \
numbers look as if a camera's counter began again (`IMG_9999`, then `IMG_0001`), or EXIF times contradict the order, a \
warning names the images; they must be renamed |
| left out | hidden files, as a Mac's `._IMG_1.JPG`; folders; files that are no images; images without a number \
beside more with one, as `average.png` beside `frame_0001.png`: said |
| TIFF | page by page, strips or tiles, BigTIFF too, and ImageJ's stacks above 4 GB; pages \
of another size are previews and left out |
| orientation (EXIF, tag of TIFF) | all are turned as the first image says, and that is said |
| time | 1 s + frame / `--fps` (25 if not given). Where the times of EXIF say another rate, a warning names it |
| animations (APNG, WebP) | refused, with the command that takes them apart |
| sizes | all images must have one size; grey, colour and alpha may alternate |

## Positions and attitudes

`stab-ros telemetry FLIGHT OUTPUT.mcap` makes a bag of them that the georeferencing takes: sensor_msgs/NavSatFix on \
`fix`, the gimbal as
geometry_msgs/QuaternionStamped on `gimbal`, the drone as sensor_msgs/Imu on `imu`, all in east, north and up \
(REP-103), below `--namespace`.

| file | what it is | read from it | its times |
|---|---|---|---|
{telemetry}

Of several files, `telemetry PPK.pos FLIGHT.srt OUTPUT.mcap`, positions are taken from the first that tells them, and \
attitudes likewise.
Subtitles inside a video: `ffmpeg -i FLIGHT.MP4 -map 0:s:0 FLIGHT.srt`.
Text may be UTF-8, UTF-16 or of an old code page. Numbers may have decimal commas where those do not part columns.

**Clock.** Stamps are those of the video's frames, 1 s + the time since the first one, where the file belongs to a \
video or counts from a start: for
subtitles and tables of seconds. With `--fps` the time codes, whole milliseconds, become those of the frames. Dates \
give stamps in UTC; `--start
DATE`, when the first frame was taken, turns them into those of the video. `--clock` chooses the other way, \
`--time-zone` is that of dates that name
none, and `--offset-s` is added.

**Heights** are as the file has them, and what they count from is for you to know: a NavSatFix has them above the \
ellipsoid, DJI mostly writes them
above the sea or the place of take-off. `--home-height M` takes M plus the height above the place of take-off.

**Angles.** DJI's yaw is clockwise from north, its pitch -90 at nadir, its roll to the right. Tables use the same.

**Faults.** Of a value that is repeated until the receiver has a new one, each is written once; where the drone \
stands, one in as many places. Left
out and said: blocks and lines that are broken, positions of zero before the first fix, moments that come twice. \
Mended and said: latitudes beyond 90
degrees that are longitudes (`--swap` where both are possible), positions in radians, moments out of order. Steps of \
more than a metre, as of DJI's
first drones, are warned of.

### Columns of a table

The first line names the columns, in any order and case, as `height_m`, `Height (m)` or `height [m]`; others are \
ignored. Needed are a time, and
latitude and longitude or the angles or quaternion of an attitude. A time without a unit is taken by its size: \
seconds since the first frame, or s,
ms, us or ns since 1970.

| quantity | names | units, the first where none is named |
|---|---|---|
{columns}

## Times of a recording

The stamp of an image is that of its header. Images that were logged up to eight places late are put in the order of \
their stamps, and it is said.
Where the camera's clock was set back they stay in the order of the log: their stamps fall among those before, and all \
later ones stay behind.
Where header stamps contradict the log by a factor of three or more, are zero, go back or jump ahead, `stabilize`, \
`evaluate`, `compare` and `info` warn;
`--time log` then takes the log time for the stamp, in `H.csv` and in the messages that are written for the image. \
Other topics stay as they are.
Bursts in the log, drift and a constant offset of the camera's clock are no contradiction.

## When a new reference begins

Another size or depth is another camera. Each new reference is a warning with frame and reason, and counted in \
`reset_counter`, with
`reset_reason`, in `H.csv` and `~/track`.
"""


def _row(*cells: str) -> str:
    return f"| {' | '.join(cells)} |"


def _names(names: Iterable[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)


def _types() -> str:
    rows = [(name, "CDR") for name in (*IMAGE_TYPES, *CDR_DEFINITIONS)]
    return "\n".join(_row(f"`{name}`", encoding) for name, encoding in
                     (*rows, *((name, "protobuf") for name in PROTOBUF_FIELDS)))


def _codec(decoder: str) -> str:
    """What FFmpeg's decoder decodes, in the usual words."""
    return {"h264": "H.264", "hevc": "H.265", "libdav1d": "AV1"}.get(decoder, decoder.upper())


def _encodings() -> str:
    return "\n".join(_row(_names(name for name in DECODED if DECODED[name] == frame), frame, _leaves_as(frame))
                     for frame in CHANNELS if frame in DECODED.values())


def _leaves_as(encoding: str) -> str:
    """What a frame of an encoding is once it is warped."""
    dtypes = {"mono16": np.uint16, "bgr16": np.uint16, "32FC1": np.float32}
    channels = CHANNELS[encoding]
    shape = (8, 8) if channels == 1 else (8, 8, channels)
    return Frame(np.zeros(shape, dtypes.get(encoding, np.uint8)), encoding, 0).warped_encoding


def _telemetry() -> str:
    return "\n".join(_row(f"`{suffix}`", kind.name, kind.holds, kind.times) for suffix, kind in KINDS.items())


def _columns() -> str:
    return "\n".join(_row(name.replace("_", " "), _names(quantity.names), _names(quantity.units))
                     for name, quantity in QUANTITIES.items())


if __name__ == "__main__":
    print(_PAGE.format(
        bags=_names(PART_SUFFIXES), types=_types(), codecs=", ".join(dict.fromkeys(_codec(name) for name in \
DECODERS.values())),
        republish="\n".join(f"- `{name}`: {advice}" for name, advice in TO_DO.items()), encodings=_encodings(),
        telemetry=_telemetry(), columns=_columns(), videos=_names(VIDEO_SUFFIXES),
        images=_names(IMAGE_SUFFIXES), unread=_names(UNREAD_SUFFIXES)), end="")
