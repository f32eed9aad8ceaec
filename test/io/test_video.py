"""Videos as cameras, phones and drones write them; made by ffmpeg, `test/data/make_videos.sh`."""

from __future__ import annotations

import gc
import os
import shlex
from collections.abc import Iterable, Sequence
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest
from av.packet import Packet
from av.video.stream import VideoStream
from coded_video import shown_by_opencv

from stab_ros.core.errors import InputError
from stab_ros.core.types import Frame, Image
from stab_ros.io.frame_reader import stamp_ns
from stab_ros.io.video import VideoFile
from stab_ros.io.video_clock import Timing, VideoClock
from stab_ros.io.video_packets import Packets
from stab_ros.io.video_stream import choose_stream, open_container
from stab_ros.jobs.info import describe

VIDEOS = Path(__file__).resolve().parents[1] / "data" / "videos"
FRAMES = 12
GRID = [stamp_ns(number, 25.0) for number in range(FRAMES)]  # the contract's 1 s + frame/fps


def read(path: Path, fps: float | None = None) -> tuple[list[int], list[Image], list[str]]:
    """Stamps in ns, pictures, warnings."""
    video = VideoFile(path, fps)
    frames = [(stamp, decoded.image) for stamp, decoded in video.frames() if isinstance(decoded, Frame)]
    video.close()
    return [stamp for stamp, _ in frames], [image for _, image in frames], video.warnings


def write(path: Path, times_ms: Iterable[int], codec: str = "mpeg4", kind: str | None = None, **options: str) -> Path:
    """A video of noise with these times, by PyAV; kind: the container, if not that of the suffix."""
    with av.open(str(path), "w", format=kind) as container:
        stream = container.add_stream(codec, rate=25, options=options)
        assert isinstance(stream, VideoStream)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        if codec == "mpeg4":
            stream.codec_context.time_base = Fraction(1, 1000)
        for number, time_ms in enumerate(times_ms):
            picture = np.random.default_rng(number).integers(0, 255, (48, 64, 3), np.uint8)
            frame = av.VideoFrame.from_ndarray(picture, format="bgr24")
            frame.pts, frame.time_base = time_ms, Fraction(1, 1000)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


@pytest.mark.parametrize("name", ["plain.mp4", "av1.mp4", "hevc10.mp4", "vp9.webm", "prores.mov", "mjpeg.avi",
                                  "no_times.h264", "no_times.mjpeg", "no_times.m4v", "reordered.avi"])
def test_every_codec_gives_the_pictures_and_the_stamps_of_a_constant_rate(name: str) -> None:
    stamps, images, _ = read(VIDEOS / name)
    assert stamps == GRID
    for image, truth in zip(images, shown_by_opencv(VIDEOS / "source.mkv"), strict=True):
        assert np.abs(image.astype(int) - truth).mean() < 12  # coarse chroma at the edges of the test pattern


@pytest.mark.parametrize("name", ["source.mkv", "plain.mp4", "odd.mp4", "mjpeg.avi", "vp9.webm", "rotated.mp4"])
def test_pixels_are_those_of_opencv(name: str) -> None:
    _, images, _ = read(VIDEOS / name)
    for image, expected in zip(images, shown_by_opencv(VIDEOS / name), strict=True):
        assert image.shape == expected.shape
        assert np.array_equal(image, expected)


def test_a_variable_rate_keeps_its_times_and_its_mean() -> None:
    times_ms = [40 * number + 7 * (number % 3) for number in range(FRAMES)]
    stamps, _, _ = read(VIDEOS / "vfr.mkv")
    assert [(stamp - 10**9) // 10**6 for stamp in stamps] == times_ms
    assert VideoFile(VIDEOS / "vfr.mkv", None).fps == pytest.approx(1e3 * (FRAMES - 1) / times_ms[-1])
    assert read(VIDEOS / "vfr.mkv", fps=25)[0] == GRID
    assert "it names 25 frames/s, but its times vary: 26.0 to 47.0 ms" in describe(VIDEOS / "vfr.mkv")[0][1]


def test_dropped_frames_leave_a_gap(tmp_path: Path) -> None:
    path = write(tmp_path / "gap.mkv", [0, 33, 67, 200, 233])
    assert [round((stamp - 10**9) / 1e6) for stamp in read(path)[0]] == [0, 33, 67, 200, 233]


@pytest.mark.parametrize(("ticks", "expected_ms", "wrong", "missing"), [
    ([0, 40, 80], [0, 40, 80], 0, 0),
    ([500, 540, 580], [0, 40, 80], 0, 0),
    ([None, None, None], [0, 40, 80], 0, 3),
    ([0, None, 80], [0, 40, 80], 0, 1),
    ([0, 40, 40, 80, 120], [0, 40, 60, 80, 120], 1, 0),
    ([0, 80, 40, 120], [0, 80, 100, 120], 1, 0),
    ([0, 40, 5000, 0, 40], [0, 40, 5000, 5040, 5080], 1, 0),
])
def test_times_that_are_missing_repeat_or_go_back(ticks: list[int | None], expected_ms: list[int], wrong: int,
                                                  missing: int) -> None:
    clock = VideoClock(Timing(Fraction(25), Fraction(1, 1000)))
    assert [(clock.stamp_ns(pts) - 10**9) / 1e6 for pts in ticks] == expected_ms
    assert (clock.wrong, clock.missing) == (wrong, missing)


@pytest.mark.parametrize("fps", [Fraction(30000, 1001), Fraction(24), Fraction(60000, 1001), Fraction(240)])
def test_a_coarse_clock_does_not_blur_a_constant_rate(fps: Fraction) -> None:
    clock = VideoClock(Timing(fps, Fraction(1, 1000)))  # Matroska's milliseconds
    stamps = [clock.stamp_ns(round(1000 * number / fps) + 21) for number in range(1000)]
    assert stamps == [stamp_ns(number, float(fps)) for number in range(1000)]


@pytest.mark.parametrize("name", ["no_times.h264", "no_times.mjpeg", "no_times.m4v"])
def test_a_file_without_times_says_so(name: str) -> None:
    stamps, _, said = read(VIDEOS / name)
    assert stamps == GRID
    assert said == [f"{VIDEOS / name}: holds no times; frame n is stamped 1 s + n/25 s (--fps sets another rate)"]
    assert "no times in the file, 25 frames/s are assumed" in describe(VIDEOS / name)[0][1]
    assert read(VIDEOS / name, fps=60)[::2] == ([stamp_ns(number, 60.0) for number in range(FRAMES)], [])


def test_a_given_rate_that_is_not_that_of_the_times_is_said_with_both() -> None:
    timed = VIDEOS / "plain.mp4"
    assert read(timed, fps=25)[2] == read(timed)[2]
    (said,) = read(timed, fps=50)[2]
    assert said == (f"{timed}: its times say 25 frames/s, and 50 are taken as given (--fps): speeds are 2 times those "
                    "by its times")


def test_fields_are_not_mixed() -> None:
    """Frame k has fields of pictures 2k and 2k + 1: it shall be the former."""
    stamps, images, said = read(VIDEOS / "interlaced.mp4")
    with av.open(str(VIDEOS / "interlaced.mp4")) as container:
        woven = [frame.to_ndarray(format="bgr24") for frame in container.decode(video=0)]
    truth = shown_by_opencv(VIDEOS / "source.mkv")[::2]
    assert stamps == [stamp_ns(number, 12.5) for number in range(6)]
    assert off(images, truth) < 0.6 * off(woven, truth)
    assert any("interlaced" in line for line in said)
    assert any("interlaced" in line for line in describe(VIDEOS / "interlaced.mp4")[1])


def off(images: Sequence[Image], truth: Sequence[Image]) -> float:
    """Mean absolute difference in the moving middle of the picture, grey levels."""
    return float(np.mean([np.abs(a.astype(int) - b)[2:-2].mean() for a, b in zip(images, truth, strict=True)]))


def test_an_edit_list_hides_frames_and_no_frame_lacks() -> None:
    stamps, _, said = read(VIDEOS / "edit_list.mp4")
    assert (stamps, said) == (GRID[:7], [])
    assert "edit_list.mp4: video, 7 frames, 25 frames/s" in describe(VIDEOS / "edit_list.mp4")[0][0]


def test_a_cut_file_is_read_to_its_end_and_told() -> None:
    stamps, _, said = read(VIDEOS / "cut.mp4")
    assert stamps == GRID[:8]
    assert said == [f"{VIDEOS / 'cut.mp4'}: it is cut off after 8 frames"]
    lines, told = describe(VIDEOS / "cut.mp4")
    assert "8 frames" in lines[0]
    assert told == said


@pytest.mark.parametrize("name", [
    "plain.ts", "plain.mpg", "plain.ogv", "plain.wmv", "plain.y4m", "delta.gif", "vp9.webm", "mjpeg.avi", "source.mkv",
    "no_times.h264", "no_times.hevc", "no_times.mjpeg", "no_times.m4v",
])
def test_every_container_tells_that_it_is_cut_and_gives_whole_frames(name: str, tmp_path: Path) -> None:
    whole, path = (VIDEOS / name).read_bytes(), tmp_path / name
    _, images, said = read(VIDEOS / name)
    assert not any("cut off" in line for line in said)
    for share in (0.9, 0.8, 0.6, 0.45):
        path.write_bytes(whole[: int(share * len(whole))])
        _, found, said = read(path)
        assert 0 < len(found) < len(images)
        assert all(any(np.array_equal(image, one) for one in images) for image in found), share
        assert any(f"cut off after {len(found)} frame" in line for line in said), share
        assert any("cut off after" in line for line in describe(path)[1]), share


@pytest.mark.parametrize("name", ["vp9.webm", "source.mkv", "mjpeg.avi", "plain.ts", "delta.gif", "plain.y4m"])
def test_a_file_cut_within_its_first_frame_says_that(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes((VIDEOS / name).read_bytes()[: 6000 if name == "mjpeg.avi" else 1400])
    with pytest.raises(InputError, match="is cut off before the end of its first frame"):
        read(path)


def counted(path: Path) -> tuple[int, bool]:
    """Number of whole coded frames; is the file cut?"""
    with open_container(path) as container:
        packets = Packets(container, choose_stream(path, container))
        return sum(1 for _ in packets), packets.cut


@pytest.mark.parametrize("options", ["open-gop=1:keyint=12:bframes=3:b-adapt=0", "intra-refresh=1:keyint=20",
                                     "open-gop=1:keyint=4:min-keyint=1:bframes=3:b-adapt=0", "keyint=1"])
def test_what_refers_to_the_group_before_is_whole_at_every_end_unless_torn(options: str, tmp_path: Path) -> None:
    path = write(tmp_path / "all.ts", range(0, 1640, 40), "libx264", preset="veryfast",
                 **{"x264-params": options + ":scenecut=0"})
    data, start = path.read_bytes(), tmp_path / "start.ts"
    with av.open(str(path)) as container:
        places = sorted({packet.pos for packet in container.demux(video=0) if packet.pos is not None})
    assert len(places) == 41
    for number in range(1, 41):
        last, end = places[number - 1], places[number]
        start.write_bytes(data[:end])
        assert counted(start) == (number, False)
        start.write_bytes(data[: last + (end - last) // 2 // 188 * 188])
        assert counted(start) == (number - 1, True)


@pytest.mark.parametrize("name", ["endless.ts", "endless.h264"])
def test_a_group_without_end_is_not_kept_in_memory(name: str, tmp_path: Path) -> None:
    path = write(tmp_path / name, range(0, 40 * 400, 40), "libx264", preset="ultrafast",
                 **{"x264-params": "keyint=infinite:scenecut=0"})
    kept = []
    with open_container(path) as container:
        for number, _ in enumerate(Packets(container, choose_stream(path, container))):
            if number % 50 == 49:
                kept.append(sum(type(thing) is Packet for thing in gc.get_objects()))  # isinstance asks dead proxies
    assert max(kept) > 200
    assert kept[-1] < 10
    assert counted(path) == (400, False)


def test_an_avi_written_into_a_pipe_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "pipe.avi"
    reading, writing = os.pipe()
    with os.fdopen(reading, "rb") as pipe:
        write(Path(f"pipe:{writing}"), range(0, 200, 40), "mpeg2video", kind="avi")
        os.close(writing)
        path.write_bytes(pipe.read())
    assert path.read_bytes()[4:8] == b"\xff\xff\xff\xff"
    stamps, _, said = read(path)
    assert (stamps, said) == (GRID[:5], [])
    assert describe(path)[1] == []
    video = VideoFile(path, None)
    assert video.count is None
    video.close()


def test_damage_within_costs_the_frames_it_hits(tmp_path: Path) -> None:
    damaged = tmp_path / "damaged.avi"
    data = bytearray((VIDEOS / "mjpeg.avi").read_bytes())
    at = [k for k in range(len(data)) if data[k : k + 4] == b"00dc"][5]
    size = int.from_bytes(data[at + 4 : at + 8], "little")
    data[at + 8 : at + 8 + size] = bytes(size)  # the fifth picture; an index comes first
    damaged.write_bytes(data)
    stamps, _, said = read(damaged)
    assert stamps == GRID[:4] + GRID[5:]
    assert said == [f"{damaged}: 11 of its 12 frames can be decoded"]


def test_damage_of_a_transport_stream_is_told(tmp_path: Path) -> None:
    path = write(tmp_path / "hole.ts", [40 * number for number in range(40)], "mpeg2video")
    data = path.read_bytes()
    packets = [data[at : at + 188] for at in range(0, len(data), 188)]
    path.write_bytes(b"".join(packets[: len(packets) // 2] + packets[len(packets) // 2 + 2 :]))
    said = read(path)[2]
    assert any("damaged" in line or "can be decoded" in line for line in said), said


def test_a_turned_video_is_shown_upright_and_told() -> None:
    _, images, said = read(VIDEOS / "rotated.mp4")
    assert images[0].shape == (96, 64, 3)
    assert any("turned anticlockwise" in line for line in said)
    assert any("turned anticlockwise" in line for line in describe(VIDEOS / "rotated.mp4")[1])


def test_a_slanted_turn_is_left_and_told() -> None:
    _, images, said = read(VIDEOS / "slanted.mp4")
    assert np.array_equal(images, read(VIDEOS / "plain.mp4")[1])
    assert len(said) == 1
    assert "taken as stored; the file asks players to show them turned anticlockwise by 45 degrees" in said[0]
    assert describe(VIDEOS / "slanted.mp4")[1] == said


def test_pixels_that_are_not_square_are_told() -> None:
    _, images, said = read(VIDEOS / "stretched.mp4")  # 96x64 as 2:1
    assert images[0].shape == (64, 96, 3)
    assert len(said) == 1
    assert "pixels are not square, but 1.333 times as wide as high; frames are taken as stored" in said[0]
    assert "ffmpeg -i stretched.mp4 -vf" in said[0]
    assert describe(VIDEOS / "stretched.mp4")[1] == said


def test_the_way_out_can_be_pasted_whatever_the_name(tmp_path: Path) -> None:
    path = tmp_path / "it's my video.mp4"
    path.write_bytes((VIDEOS / "stretched.mp4").read_bytes())
    words = shlex.split(read(path)[2][0].partition("make them square: ")[2])
    assert words[:3] == ["ffmpeg", "-i", path.name]
    assert words[-1] == "it's my video_square.mp4"
    path.write_bytes(path.read_bytes().replace(b"avc1", b"XYZ1"))
    with pytest.raises(InputError) as caught:
        read(path)
    words = shlex.split(str(caught.value).partition("where it plays: ")[2])
    assert words[:3] == ["ffmpeg", "-i", path.name]
    assert words[-1] == "it's my video_h264.mp4"


def test_the_preview_is_not_taken_for_the_video() -> None:
    _, images, said = read(VIDEOS / "preview.mp4")
    assert images[0].shape == (64, 96, 3)
    assert said == [f"{VIDEOS / 'preview.mp4'}: of several videos that of 96x64 is read, not 48x32"]


def test_a_gif_is_a_video_with_its_own_times() -> None:
    stamps, images, _ = read(VIDEOS / "delta.gif")
    assert stamps == [stamp_ns(number, 12.5) for number in range(7)]
    assert np.abs(images[3].astype(int) - shown_by_opencv(VIDEOS / "source.mkv")[6]).mean() < 40  # of 256 colours


@pytest.mark.parametrize(("name", "says"), [
    ("cover.mp4", "holds no video, only a cover and audio"),
    ("open.mp4", "its index (moov) is missing"),
    ("text.mp4", "cannot be decoded"),
    ("alien.mp4", "ffmpeg -i alien.mp4 -c:v libx264"),
])
def test_what_cannot_be_read_is_named_with_the_way_out(tmp_path: Path, name: str, says: str) -> None:
    plain = (VIDEOS / "plain.mp4").read_bytes()
    path = tmp_path / name
    path.write_bytes({"cover.mp4": (VIDEOS / "cover.mp4").read_bytes(), "open.mp4": plain[: len(plain) // 2],
                      "text.mp4": b"no video\n" * 99, "alien.mp4": plain.replace(b"avc1", b"XYZ1")}[name])
    with pytest.raises(InputError) as caught:
        read(path)
    assert says in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize("pixels", ["gray16le", "gray12le"])
def test_grey_of_more_than_8_bits_keeps_its_values(pixels: str, tmp_path: Path) -> None:
    grey = np.random.default_rng(1).integers(7400, 7900, (64, 96), np.uint16)
    with av.open(str(tmp_path / "a.mkv"), "w") as container:
        stream = container.add_stream("ffv1", rate=25)
        stream.width, stream.height, stream.pix_fmt = 96, 64, pixels
        container.mux(stream.encode(av.VideoFrame.from_ndarray(grey, "gray16le").reformat(format=pixels)))
        container.mux(stream.encode(None))
    video = VideoFile(tmp_path / "a.mkv", None)
    ((_, frame),) = video.frames()
    video.close()
    assert isinstance(frame, Frame)
    assert frame.encoding == "mono16"
    np.testing.assert_allclose(frame.image, grey, atol=0 if pixels == "gray16le" else 16)


@pytest.mark.skipif(os.geteuid() != 0, reason="needs root, to become another user")
def test_a_file_that_may_not_be_read_is_said(tmp_path: Path) -> None:
    path = tmp_path / "a.mp4"
    path.write_bytes((VIDEOS / "plain.mp4").read_bytes())
    path.chmod(0)
    os.seteuid(65534)
    try:
        with pytest.raises(InputError, match="may not be read"):
            VideoFile(path, None)
    finally:
        os.seteuid(0)
