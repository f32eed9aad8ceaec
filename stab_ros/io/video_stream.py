"""Opens a video file and chooses the stream to read."""

from __future__ import annotations

import shlex
from fractions import Fraction
from pathlib import Path

import av
import av.logging
from av.container import InputContainer
from av.error import FFmpegError
from av.video.stream import VideoStream

from stab_ros.core.errors import InputError
from stab_ros.core.text import one_line
from stab_ros.io.frame_reader import DEFAULT_FPS, MAX_FPS
from stab_ros.io.video_clock import Timing

_PICTURES = {"mjpeg", "png", "bmp", "tiff", "webp"}  # codecs of a cover
_TIMES_IN_CODED_ORDER = {"avi"}  # containers that number frames as they are stored, not as they are shown
_SQUARE = 1e-3  # a factor closer to 1 is the rounding of a size
_AVI_FRAMES_UNKNOWN = 1 << 30  # what FFmpeg writes where it cannot go back, as into a pipe; no duration follows from it
_NO_TIMES = 0x80  # AVFMT_NOTIMESTAMPS of libavformat/avformat.h


def open_container(path: Path) -> InputContainer:
    """Opens a file.

    Raises:
        InputError: it is no video, or its index is missing.
    """
    if av.logging.get_level() is not None:  # PyAV before 12 prints what FFmpeg logs
        av.logging.set_level(av.logging.PANIC)
    try:
        return av.open(str(path), mode="r", metadata_errors="replace")
    except (FFmpegError, OSError) as error:
        raise InputError(f"{path}: {_reason(path, error)}") from error


def choose_stream(path: Path, container: InputContainer) -> VideoStream:
    """The stream with the most pixels; a cover or a preview is none.

    Raises:
        InputError: there is no video, or no decoder for it.
    """
    streams = [stream for stream in container.streams.video if not _is_cover(stream, container)]
    if not streams:
        kinds = {"a cover" if stream.type == "video" else stream.type or "unknown" for stream in container.streams}
        raise InputError(f"{path}: holds no video, only {' and '.join(sorted(kinds)) or 'nothing'}; it must hold one")
    stream = max(streams, key=_pixels)
    if stream.codec_context is None:
        raise undecodable(path, None)
    return stream


def timing_of(stream: VideoStream, fps: float | None) -> Timing:
    """fps: the rate to assume in place of the file's times."""
    if fps is not None:
        return Timing(Fraction(fps), None)
    rate = next((rate for rate in (stream.guessed_rate, stream.average_rate) if rate and 0 < rate <= MAX_FPS),
                Fraction(DEFAULT_FPS))
    reordered = stream.codec_context.has_b_frames and stream.container.format.name in _TIMES_IN_CODED_ORDER
    return Timing(rate, None if reordered or lacks_times(stream) else stream.time_base)


def lacks_times(stream: VideoStream) -> bool:
    """Are the pictures stored one after the other without a container? FFmpeg then makes up their times."""
    kind = stream.container.format
    return bool(int(kind.flags) & _NO_TIMES) or kind.name.endswith("_pipe")


def codec_of(stream: VideoStream) -> str:
    """The name of its codec, as h264; `av1` for each of its decoders."""
    name = stream.codec_context.name
    return "av1" if "av1" in name else name.removeprefix("lib").removesuffix("-vp9")


def announced_frames(stream: VideoStream) -> int | None:
    """The number of frames in the header; None: the file does not say."""
    return stream.frames if stream.frames not in {0, _AVI_FRAMES_UNKNOWN} else None


def announced_s(container: InputContainer, stream: VideoStream) -> float | None:
    """The duration of the stream, s; None: the file does not say."""
    if stream.frames == _AVI_FRAMES_UNKNOWN:
        return None
    if stream.duration is not None and stream.time_base:
        return float(stream.duration * stream.time_base)
    whole = container.duration
    return whole / 1e6 if whole and len(container.streams) == 1 else None


def others(container: InputContainer, stream: VideoStream) -> list[str]:
    """What else there is to see in the file, in one line."""
    rest = [other for other in container.streams.video if other is not stream and not _is_cover(other, container)]
    sizes = " and ".join(f"{other.codec_context.width}x{other.codec_context.height}" for other in rest
                         if other.codec_context)
    context = stream.codec_context
    return [f"of several videos that of {context.width}x{context.height} is read, not {sizes}"] if sizes else []


def stretched(path: Path, stream: VideoStream) -> list[str]:
    """What there is to say, in one line, of pixels that are not square."""
    factor = stream.sample_aspect_ratio or Fraction(1)
    if abs(factor - 1) < _SQUARE:
        return []
    return [f"pixels are not square, but {float(factor):.4g} times as wide as high; frames are taken as stored, not as "
            f"players show them; to make them square: ffmpeg -i {shlex.quote(path.name)} "
            f'-vf "scale=2*round(iw*sar/2):ih,setsar=1" -c:v libx264 -crf 12 {shlex.quote(path.stem + "_square.mp4")}']


def undecodable(path: Path, codec: str | None, reason: str = "") -> InputError:
    """The error for a video that FFmpeg knows but cannot decode; it names the way out."""
    what = f"video of codec {codec}" if codec else "a video of an unknown codec"
    because = f" ({reason})" if reason else ""
    return InputError(f"{path}: {what} cannot be decoded here{because}; convert it where it plays: "
                      f"ffmpeg -i {shlex.quote(path.name)} -c:v libx264 -crf 12 {shlex.quote(path.stem + '_h264.mp4')}")


def _is_cover(stream: VideoStream, container: InputContainer) -> bool:
    """A picture without a rate beside other streams."""
    context = stream.codec_context
    return context is not None and context.name in _PICTURES and not stream.average_rate and len(container.streams) > 1


def _pixels(stream: VideoStream) -> int:
    return stream.codec_context.width * stream.codec_context.height if stream.codec_context else 0


def _reason(path: Path, error: FFmpegError | OSError) -> str:
    if isinstance(error, PermissionError):
        return "may not be read; its permissions must allow it"
    if _lacks_index(path):
        return ("cannot be decoded, its index (moov) is missing: the recording was not closed; the camera can restore "
                "it, or a tool as untrunc with a sound file of the same camera")
    return f"this video cannot be decoded ({one_line(error.strerror or error)}); it must be a file that FFmpeg can play"


def _lacks_index(path: Path) -> bool:
    """Is it an mp4 or mov whose boxes end before the index?"""
    kinds: list[bytes] = []
    at, size = 0, path.stat().st_size
    with path.open("rb") as file:
        while at + 8 <= size and len(kinds) < 100:
            file.seek(at)
            head = file.read(16)
            kinds.append(head[4:8])
            length = int.from_bytes(head[:4], "big")
            length = int.from_bytes(head[8:16], "big") if length == 1 else length
            if length < 8:
                break
            at += length
    return kinds[:1] == [b"ftyp"] and b"moov" not in kinds
