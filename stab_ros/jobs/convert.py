"""Converts any input into an MCAP bag: messages of a bag byte for byte, videos and folders of images as raw images."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from stab_ros.core.errors import InputError
from stab_ros.core.progress import Progress
from stab_ros.core.text import are, counted
from stab_ros.core.types import Frame
from stab_ros.io.bag import BagWriter, Topic, open_bag
from stab_ros.io.cdr import header_of
from stab_ros.io.image_message import image_cdr
from stab_ros.io.outputs import check_output
from stab_ros.io.source import Kind, Picture, kind_of, open_source
from stab_ros.jobs.stabilize import expected


@dataclass(frozen=True)
class Conversion:
    """What to convert. topic: for the images of a video or folder; for a bag the only topic to keep (None: all)."""

    source: Path
    output: Path
    topic: str | None = None
    fps: float | None = None
    limit: int | None = None
    force: bool = False


@dataclass(frozen=True)
class Converted:
    """The result of a conversion. warnings: what could not be read, one line each."""

    messages: int
    warnings: tuple[str, ...]


def convert(job: Conversion, progress: Progress) -> Converted:
    """Runs the conversion.

    Raises:
        InputError: an argument or the input is unusable; no output remains.
        WorkError: the work could not be finished; the readable part remains under its `.partial` name.
    """
    check_output(job.output, ".mcap", job.source, job.force)
    steps = _copy_bag if kind_of(job.source) is Kind.BAG else _record_pictures
    return steps(job, progress)


def _copy_bag(job: Conversion, progress: Progress) -> Converted:
    if job.fps is not None or job.limit is not None:
        raise InputError(f"{job.source}: is a bag, --fps and --limit are for videos and folders of images")
    with open_bag(job.source) as reader:
        topics = [topic for topic in reader.topics.values() if job.topic in (None, topic.name)]
        if not topics and job.topic is not None:
            raise InputError(f"{job.source}: has no topic {job.topic}; it has {', '.join(sorted(reader.topics))}")
        total = sum(topic.count for topic in topics)
        done = 0
        with BagWriter(job.output, overwrite=job.force) as writer:
            for topic in topics:
                writer.add_topic(topic)
            writer.add_extras(reader.extras())
            for done, message in enumerate(reader.messages([topic.name for topic in topics]), 1):
                writer.write(message.topic, message.log_time_ns, message.publish_time_ns, message.data)
                progress(done, total)
        return Converted(done, tuple(reader.warnings))


def _record_pictures(job: Conversion, progress: Progress) -> Converted:
    problems: list[str] = []
    done = 0
    with open_source(job.source, fps=job.fps) as source:
        topic = replace(source.topics[source.image_topic], name=job.topic or source.image_topic)
        total = expected(source.count, job.limit)
        with BagWriter(job.output, overwrite=job.force) as writer:
            writer.add_topic(topic)
            for done, picture in enumerate(source.frames(job.limit), 1):
                if isinstance(picture.decoded, Frame):
                    _record(writer, topic, picture, picture.decoded)
                else:
                    problems.append(str(picture.decoded))
                progress(done, total)
        warnings = (*source.warnings, *_left_out(job.source, problems, done))
    return Converted(done - len(problems), warnings)


def _record(writer: BagWriter, topic: Topic, picture: Picture, frame: Frame) -> None:
    data = image_cdr(frame.image, frame.encoding, header_of(frame))
    writer.write(topic.name, picture.log_time_ns, picture.publish_time_ns, data)


def _left_out(source: Path, problems: list[str], total: int) -> list[str]:
    images = f"{len(problems)} of {counted(total, 'image')}"
    return [f"{source}: {images} {are(len(problems))} left out; the first: {problems[0]}"] if problems else []
