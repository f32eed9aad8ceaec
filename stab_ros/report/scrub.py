"""The pictures to leaf through, before and after."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from stab_ros.core.findings import frame_name
from stab_ros.io.evaluation import Evaluation
from stab_ros.report.pictures import Pictures, scrub_stamps_ns


@dataclass(frozen=True)
class Scrub:
    """labels: (F,) names of the frames. streams: topic and (F,) data URIs, empty where it has no such picture."""

    labels: Sequence[str]
    streams: Sequence[tuple[str, Sequence[str]]]


def scrub_of(evaluation: Evaluation, pictures: Pictures) -> Scrub:
    """The frames of the last stream, and those of the others with the same stamp."""
    last = evaluation.topics[-1]
    stamps = [stamp for stamp in scrub_stamps_ns(last) if (last.topic, stamp) in pictures.small]
    names = {row.stamp_ns: frame_name(row) for row in last.rows}
    streams = [(topic.topic, [pictures.small.get((topic.topic, stamp), "") for stamp in stamps])
               for topic in evaluation.topics]
    return Scrub([names[stamp] for stamp in stamps], [stream for stream in streams if any(stream[1])])
