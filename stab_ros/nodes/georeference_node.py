"""Georeferencing live: the ROS side of `Georeferencer`, with the engine and the messages of `stab-ros georeference`."""

from __future__ import annotations

import time
from dataclasses import fields
from typing import TYPE_CHECKING, Any

from stab_ros.core.settings import Value
from stab_ros.georeferencing.georeferencer import Georeferenced, Georeferencer
from stab_ros.io.cdr import SECOND_NS
from stab_ros.io.georeference_messages import gcps_of_cdr, georeference_values, origin_cdr
from stab_ros.io.topics import ORTHO_INFO_TOPIC
from stab_ros.nodes import params
from stab_ros.nodes.frame_placer import Asked
from stab_ros.nodes.georeference_publishers import GeoreferencePublishers
from stab_ros.nodes.georeference_status import GeoreferenceStatus, Result
from stab_ros.nodes.placing_node import PlacingNode
from stab_ros.parameters.engines import check_georeference, make_georeferencer, tells_level
from stab_ros.parameters.node_settings import GeoreferenceSettings
from stab_ros.parameters.table import GEOREFERENCE_PARAMETERS, georeference_config

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from stab_ros.nodes.node_options import NodeOptions

SETTINGS = params.table_of(GeoreferenceSettings)
CHANGEABLE = frozenset(GEOREFERENCE_PARAMETERS) - {"camera_file", "crs", "origin"}  # the map stays as it is


class GeoreferenceNode(PlacingNode):
    """Publishes for every image where it lies on the water plane, how its camera moves, and its orthophoto."""

    settings: GeoreferenceSettings

    def __init__(self, **options: Unpack[NodeOptions]) -> None:
        super().__init__("georeference_node", **options)

    def configure(self) -> None:
        level_given = params.given(self, "wse_m") is not None
        values = params.declare(self, {**GEOREFERENCE_PARAMETERS, **SETTINGS}, CHANGEABLE)
        params.warn_of_unknown(self, values)
        chosen: Any = {item.name: values.pop(item.name) for item in fields(GeoreferenceSettings)}
        self.settings = GeoreferenceSettings(**chosen)
        if not level_given:
            del values["wse_m"]  # whose default gives way to the level in a file of the camera
        check_georeference(values)
        config = georeference_config(values)
        self._origin_said = False
        self._rejected: tuple[str, ...] | None = None  # control points, as the last message of them shows
        status = GeoreferenceStatus(config.orientation, round(self.settings.stale_s * SECOND_NS))
        self.begin(values, config, status, make_georeferencer, tells_level(values))
        self.outputs = GeoreferencePublishers(self, self.settings.queue_depth == 0, self.settings.publish_tf)
        self.at_cleanup(params.ParameterUpdates(self, GEOREFERENCE_PARAMETERS, self._change).close)

    def flush(self) -> None:
        self.outputs.flush()

    @property
    def subscribers(self) -> int:
        return self.outputs.info.subscribers

    @property
    def awaited_topic(self) -> str:
        return ORTHO_INFO_TOPIC

    def on_answer(self, answer: Georeferenced, asked: Asked, engine: Georeferencer) -> None:
        """See `PlacerCallbacks`."""
        orientation = self._config.orientation
        self.outputs.send(answer, None if self._stabilized else self.placer.camera, orientation)
        latency_ns = time.time_ns() - asked.source_ns
        self._send_map(answer, engine)
        warnings = () if answer.placement is None else answer.placement.warnings
        values = georeference_values(answer, orientation)
        self.status.on_result(Result(answer.frame.stamp_ns, answer.reason, warnings, values, latency_ns))
        self.outputs.send_image(answer, engine)

    def _send_map(self, answer: Georeferenced, engine: Georeferencer) -> None:
        """The origin, once it is known, and the control points where others are rejected than before."""
        if not self._origin_said and engine.local_frame is not None:
            self._origin_said, self.placer.origin = True, engine.local_frame
            self.outputs.send_origin(origin_cdr(answer, engine.local_frame))
        if engine.gcps is not None and answer.placement is not None and answer.placement.rejected != self._rejected:
            self._rejected = answer.placement.rejected
            self.outputs.send_gcps(gcps_of_cdr(answer, engine.gcps))

    def _change(self, changed: dict[str, Value]) -> None:
        values = {**self.values, **changed}
        config = georeference_config(values)
        check_georeference(values)
        self.go_on_with(values, config)
        self._level_given = tells_level(values)
        self._rejected = None
