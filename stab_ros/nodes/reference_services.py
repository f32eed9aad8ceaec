"""The services about the reference, `~/reset_reference` and `~/save_reference`: answered while a frame is worked on."""

from __future__ import annotations

from threading import Event

from std_srvs.srv import Trigger

from stab_ros.core.errors import StabRosError
from stab_ros.nodes.managed_node import StabNode
from stab_ros.nodes.reference_file import ReferenceFile


class ReferenceServices:
    """Notes that a reset is asked for, to be made before the next frame, and saves what the last frame left."""

    def __init__(self, node: StabNode, file: ReferenceFile) -> None:
        self._file, self._asked = file, Event()
        node.create_service(Trigger, "~/reset_reference", self._reset, callback_group=node.at_once)
        node.create_service(Trigger, "~/save_reference", self._save, callback_group=node.at_once)

    @property
    def reset_is_asked(self) -> bool:
        """Since the last `reset_is_made`."""
        return self._asked.is_set()

    def reset_is_made(self) -> None:
        """The next frame becomes the reference."""
        self._file.discard()
        self._asked.clear()

    def _reset(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._file.discard()
        self._asked.set()
        response.success, response.message = True, "the next frame becomes the reference"
        return response

    def _save(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self._asked.is_set():  # though the frame that is worked on may have noted the one before again
            self._file.discard()
        try:
            response.success, response.message = True, self._file.save()
        except StabRosError as error:
            response.success, response.message = False, str(error)
        return response
