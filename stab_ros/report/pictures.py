"""The few images that a report shows, selected from all frames."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import TypeAlias

import cv2

from stab_ros.core.gray import grey_range, to_gray
from stab_ros.core.progress import Progress
from stab_ros.core.types import Frame, Gray, Image
from stab_ros.evaluation.results import Evaluation, TopicEvaluation
from stab_ros.io.frame_reader import Decoded
from stab_ros.io.video_writer import to_bgr
from stab_ros.report.panel import data_uri
from stab_ros.report.sampling import leaves, partners, worst_frames

_SCRUB_PX = 720
_JPEG_QUALITY = 50
Key: TypeAlias = tuple[str, int]  # topic and stamp, ns
# of every evaluated stream, in order: its frames, or why one cannot be decoded; each is iterated once, in turn
Streams: TypeAlias = Iterable[Iterable[Decoded]]


@dataclass(frozen=True, eq=False)
class ReportImages:
    """By topic and stamp. whole: (h, w) uint8 of the worst frames. small: JPEGs of the scrubber, as data URIs."""

    whole: dict[Key, Gray] = field(default_factory=dict)
    small: dict[Key, str] = field(default_factory=dict)


def read_pictures(evaluation: Evaluation, streams: Streams, progress: Progress) -> ReportImages:
    """Selects the worst frames of every stream, and those of the scrubber: of the last stream, and their partners."""
    pictures, leafed = ReportImages(), leaves(evaluation.topics[-1])
    total, done = sum(len(topic.rows) for topic in evaluation.topics), 0
    for stream, topic in zip(streams, evaluation.topics, strict=True):
        worst = {topic.rows[index].stamp_ns for index in worst_frames(topic)}
        scrub = {row.stamp_ns for row in partners(topic, leafed) if row is not None}
        for decoded in stream:
            done += 1
            progress(done, max(done, total))
            if isinstance(decoded, Frame):
                _keep(pictures, topic, decoded, worst, scrub)
    return pictures


def _keep(pictures: ReportImages, topic: TopicEvaluation, frame: Frame, worst: set[int], scrub: set[int]) -> None:
    key, shown = (topic.topic, frame.stamp_ns), grey_range(topic.reference)
    if frame.size != topic.reference.size:
        return
    if frame.stamp_ns in worst:
        pictures.whole[key] = to_gray(frame, shown)
    if frame.stamp_ns in scrub:
        pictures.small[key] = jpeg_uri(to_bgr(frame, shown))


def jpeg_uri(image: Image) -> str:
    """The image as a JPEG data URI, at most 720 px wide."""
    height, width = image.shape[:2]
    if width > _SCRUB_PX:
        image = cv2.resize(image, (_SCRUB_PX, round(height * _SCRUB_PX / width)), interpolation=cv2.INTER_AREA)
    _, content = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
    return data_uri("image/jpeg", content.tobytes())
