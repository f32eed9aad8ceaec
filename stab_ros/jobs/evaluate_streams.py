"""The image streams of a recording, and the topics of their homographies and references."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from stab_ros.core.errors import InputError
from stab_ros.io.bag import BagReader, Topic, open_bag
from stab_ros.io.cdr import CAMERA_INFO, IMAGE
from stab_ros.io.image_message import IMAGE_TYPES
from stab_ros.io.source import (
    REFERENCE_IMAGE,
    SINGLE_IMAGES,
    BagSource,
    Clock,
    Kind,
    Source,
    holds_images,
    is_stabilized,
    kind_of,
    namespace_of,
    no_images,
    open_source,
)
from stab_ros.io.topics import HOMOGRAPHY_TOPIC, RAW_COMPRESSED_TOPIC, RAW_TOPIC, topic_in
from stab_ros.jobs.log_stamps import LogStamps

_RAW = (RAW_TOPIC, RAW_COMPRESSED_TOPIC)


@dataclass(frozen=True, eq=False)
class ImageStream:
    """An image topic, and the topics of its homographies and of its reference.

    stamps: of their messages, where the images are not stamped by their headers.
    """

    source: Source
    homography: str | None = None
    reference: str | None = None
    stamps: LogStamps | None = None

    @property
    def others(self) -> list[str]:
        return [name for name in (self.homography, self.reference) if name is not None]


@contextmanager
def open_streams(path: Path, image_topics: Sequence[str], fps: float | None,
                 clock: Clock = Clock.HEADER) -> Iterator[Sequence[ImageStream]]:
    """Opens the streams of an input; empty `image_topics`: the only one, or the raw and the stabilised one of a camera.

    Raises:
        InputError: the input is missing, of an unknown kind, or ambiguous.
    """
    with ExitStack() as stack:
        if kind_of(path) is not Kind.BAG:
            topic = image_topics[0] if image_topics else None
            yield [ImageStream(stack.enter_context(open_source(path, topic, fps, clock)))]
            return
        reader = stack.enter_context(open_bag(path))
        names = choose_topics(str(path), reader, image_topics)
        yield [_stream(BagSource(path, reader, name, clock)) for name in names]


def _stream(source: BagSource) -> ImageStream:
    """A stream with its topics; only a stabilised one has homographies and a reference."""
    images = source.topics[source.image_topic]
    if not is_stabilized(images):
        return ImageStream(source)
    namespace = namespace_of(images)
    homography = source.topics.get(topic_in(namespace, HOMOGRAPHY_TOPIC))
    known = homography is not None and homography.msgtype == CAMERA_INFO and homography.count
    references = [topic.name for topic in source.topics.values() if topic.msgtype == IMAGE
                  and topic.name.startswith(f"{namespace}/") and topic.name.endswith(REFERENCE_IMAGE)]
    stamps = LogStamps(source.logged()) if source.clock is Clock.LOG else None
    return ImageStream(source, homography.name if homography and known else None, next(iter(references), None), stamps)


def choose_topics(name: str, reader: BagReader, wanted: Sequence[str]) -> Sequence[str]:
    """The image topics of a bag to evaluate, the raw one first.

    Raises:
        InputError: there is none, the wanted one is missing, or the choice is ambiguous.
    """
    topics = reader.topics
    images = sorted(topic.name for topic in topics.values() if holds_images(topic))
    unknown = [topic for topic in wanted if topic not in images]
    if unknown:
        raise InputError(f"{name}: has no image topic {unknown[0]}; its image topics are {', '.join(images) or 'none'}")
    if wanted:
        return list(dict.fromkeys(wanted))
    filled = [topic for topic in images if topics[topic].count and not topic.endswith(SINGLE_IMAGES)]
    if len(filled) <= 1:
        if not images:
            raise no_images(name, topics, reader.warnings)
        return filled or images[:1]
    pair = _raw_and_stabilized([topics[topic] for topic in filled])
    if pair is None:
        raise InputError(f"{name}: has several image topics, name one with --image-topic: {', '.join(filled)}")
    return pair


def _raw_and_stabilized(filled: Sequence[Topic]) -> list[str] | None:
    """The raw and the stabilised topic of the only stabilised camera; None if the choice is ambiguous.

    filled: in the order of their names, so that of pictures recorded in two ways the uncompressed ones are taken.
    """
    stabilized = [topic for topic in filled if is_stabilized(topic)]
    namespaces = {namespace_of(topic) for topic in stabilized}
    if len(namespaces) != 1:
        return None
    namespace = namespaces.pop()
    raw = [topic.name for topic in filled if topic not in stabilized and _is_raw(topic, namespace)]
    strangers = [topic for topic in filled if not topic.name.startswith(f"{namespace}/")]
    return None if strangers else [*raw[:1], stabilized[0].name]


def _is_raw(topic: Topic, namespace: str) -> bool:
    """Raw images have one of two names; coded video has any, and only a camera sends it."""
    named = topic.name in [topic_in(namespace, name) for name in _RAW]
    return named or (topic.msgtype not in IMAGE_TYPES and namespace_of(topic) == namespace)


def expected_pictures(streams: Sequence[ImageStream], limit: int | None) -> int | None:
    """Number of images of all streams, at most `limit` of each; None if unknown."""
    counts = [stream.source.count if limit is None else min(stream.source.count or limit, limit) for stream in streams]
    known = [count for count in counts if count is not None]
    return sum(known) if len(known) == len(counts) else None
