"""The scrubber: images before and after stabilisation, frame by frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from stab_ros.evaluation.findings import frame_name
from stab_ros.evaluation.results import Evaluation
from stab_ros.report.pictures import ReportImages
from stab_ros.report.sampling import leaves, partners


@dataclass(frozen=True)
class Scrub:
    """Images of F frames. labels: (F,) their names. streams: topic and (F,) data URIs, empty where it has no image."""

    labels: Sequence[str]
    streams: Sequence[tuple[str, Sequence[str]]]


def scrub_of(evaluation: Evaluation, pictures: ReportImages) -> Scrub:
    """The selected frames of the last stream, beside those of the others."""
    last = evaluation.topics[-1]
    frames = [row for row in leaves(last) if (last.topic, row.stamp_ns) in pictures.small]
    streams = [(topic.topic, [pictures.small.get((topic.topic, row.stamp_ns), "") if row else ""
                              for row in partners(topic, frames)]) for topic in evaluation.topics]
    return Scrub([frame_name(row) for row in frames], [stream for stream in streams if any(stream[1])])
