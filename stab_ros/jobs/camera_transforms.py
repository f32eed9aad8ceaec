"""The place of the camera on /tf of an output bag, beside the transforms that its input has recorded."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from stab_ros.core.errors import MessageError
from stab_ros.georeferencing.georeferencer import Georeferenced
from stab_ros.io.bag import Message
from stab_ros.io.cdr import TF_MESSAGE
from stab_ros.io.georeference_messages import camera_transform_cdr
from stab_ros.io.source import BagSource, Source
from stab_ros.io.topics import TF_STATIC_TOPIC, TF_TOPIC
from stab_ros.io.transform_message import read_children


class CameraTransforms:
    """Keeps what the input tells of its own frames: a frame has one parent, so what it has placed is not placed again.

    types: of the topics to announce beside those of the input.
    """

    def __init__(self, source: Source) -> None:
        self._name, self._is_video = source.name, not isinstance(source, BagSource)
        self._tells = {name for name in (TF_TOPIC, TF_STATIC_TOPIC)
                       if name in source.topics and source.topics[name].msgtype == TF_MESSAGE}
        self.types: Mapping[str, str] = {} if TF_TOPIC in self._tells else {TF_TOPIC: TF_MESSAGE}
        self._placed: set[str] = set()  # frames whose place the input tells
        self._doubt = ""

    @property
    def warnings(self) -> tuple[str, ...]:
        """What was left out, one line."""
        return (f"{self._name}: {self._doubt}",) if self._doubt else ()

    def take_over(self, message: Message) -> None:
        """Looks at a message that is copied."""
        if message.topic in self._tells:
            try:
                self._placed |= read_children(message.data)
            except MessageError:
                return  # which whoever reads the transforms will be told

    def write(self, answer: Georeferenced, write: Callable[[str, bytes], None]) -> None:
        """Writes the transform of a frame, topic and message, where it is known."""
        placement, frame_id = answer.placement, answer.frame.frame_id
        if placement is None or placement.pose is None:
            return
        data = camera_transform_cdr(answer)
        if data is None and self._is_video:
            return  # no driver has named its frame
        if data is None:
            self._say("its images have no frame_id, so that their camera is not on /tf")
        elif frame_id in self._placed:
            self._say(f"its own transforms tell where {frame_id} is, so that the pose of the camera is not on /tf")
        else:
            write(TF_TOPIC, data)

    def _say(self, doubt: str) -> None:
        self._doubt = self._doubt or doubt
