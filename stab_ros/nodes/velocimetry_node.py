"""Velocimetry live: the ROS side of `Velocimeter`, with the engine and the messages of `stab-ros velocity`."""

from __future__ import annotations

import time
from collections import deque
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

from stab_ros.core.errors import InputError
from stab_ros.core.settings import Value
from stab_ros.georeferencing.georeferencer import Georeferenced, Georeferencer
from stab_ros.io.cdr import SECOND_NS
from stab_ros.io.georeference_messages import georeference_values as values_of
from stab_ros.io.georeference_messages import origin_cdr
from stab_ros.io.regions import read_area
from stab_ros.io.static_maps import read_static_map
from stab_ros.io.topics import VELOCITY_TOPIC
from stab_ros.nodes import params
from stab_ros.nodes.frame_placer import Asked
from stab_ros.nodes.georeference_status import Result
from stab_ros.nodes.patience import Patience
from stab_ros.nodes.placing_node import PlacingNode
from stab_ros.nodes.static_map_input import StaticMapInput
from stab_ros.nodes.velocimetry_publishers import VelocimetryPublishers
from stab_ros.nodes.velocimetry_status import VelocimetryStatus
from stab_ros.parameters.engines import tells_level
from stab_ros.parameters.node_settings import VelocimetrySettings
from stab_ros.parameters.table import OWN_VELOCITY_PARAMETERS, VELOCITY_PARAMETERS, velocity_table_with_preset
from stab_ros.parameters.velocimeters import (
    check_velocimetry,
    make_bank_check,
    make_placer,
    make_velocimeter,
    stream_config,
    takes_map,
    unit_of,
)
from stab_ros.tracking.static_map import StaticMap
from stab_ros.velocimetry.pictures import Stream
from stab_ros.velocimetry.velocimeter import Measured, Velocimeter

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from stab_ros.nodes.node_options import NodeOptions

SETTINGS = params.table_of(VelocimetrySettings)
_REGIONS = {"roi", "exclude"}
CHANGEABLE = frozenset(OWN_VELOCITY_PARAMETERS) - {"grid_m"}  # where frames lie stays as it is


@dataclass(frozen=True, eq=False)
class _Answered:
    """A frame with its place."""

    answer: Georeferenced
    asked: Asked
    engine: Georeferencer


class VelocimetryNode(PlacingNode):
    """Publishes the velocities of every interval."""

    settings: VelocimetrySettings

    def __init__(self, **options: Unpack[NodeOptions]) -> None:
        super().__init__("velocimetry_node", **options)

    def configure(self) -> None:
        given = [name for name in VELOCITY_PARAMETERS if params.given(self, name) is not None]
        table = velocity_table_with_preset(params.given(self, "method"))
        declared = params.declare(self, {**table, **SETTINGS}, CHANGEABLE)
        params.warn_of_unknown(self, declared)
        chosen: Any = {item.name: declared[item.name] for item in fields(VelocimetrySettings)}
        self.settings = VelocimetrySettings(**chosen)
        values = {name: declared[name] for name in given}  # which tell whether there is any georeference
        check_velocimetry(values)
        config, self._unit = stream_config(values), unit_of(values)
        self._ground = read_static_map(values)
        self._held: deque[_Answered] = deque()  # until the map is known
        self._map_patience = Patience(round(self.settings.wait_s * SECOND_NS))
        self._reference_size: tuple[int, int] | None = None  # width and height, px, once known
        self._engine: Georeferencer | None = None  # for which the velocimeters are
        self._water: Velocimeter | None = None
        self._bank: Velocimeter | None = None
        status = VelocimetryStatus(config.orientation if self._unit == "m" else "none",
                                   round(self.settings.stale_s * SECOND_NS), self._unit)
        self._velocity_status = status
        self.begin(values, config, status, make_placer, tells_level(values))
        self._map: StaticMapInput | None = None
        if takes_map(values) and self.takes_motion:
            self._map = StaticMapInput(self, self._use_map, lambda text: self.on_unusable("", text))
        self.outputs = VelocimetryPublishers(self, float(declared["grid_m"]), lossless=self.settings.queue_depth == 0)
        self.at_cleanup(params.ParameterUpdates(self, VELOCITY_PARAMETERS, self._change).close)

    def deactivate(self) -> None:
        """Tells of the interval that is under way, too."""
        super().deactivate()
        self._release()
        self._end(time.time_ns())

    def flush(self) -> None:
        """Tells of the interval that is under way, too."""
        self._release()
        self._end(time.time_ns())
        self.outputs.flush()

    @property
    def takes_camera_info(self) -> bool:
        """For metres alone: pixels of the reference are what the homographies lead to."""
        return self._unit == "m" and super().takes_camera_info

    @property
    def takes_level(self) -> bool:
        return self._unit == "m"

    @property
    def subscribers(self) -> int:
        return self.outputs.velocity.subscribers

    @property
    def awaited_topic(self) -> str:
        return VELOCITY_TOPIC

    def on_answer(self, answer: Georeferenced, asked: Asked, engine: Georeferencer) -> None:
        """See `PlacerCallbacks`."""
        warnings = () if answer.placement is None else answer.placement.warnings
        values, latency_ns = values_of(answer, self.status.orientation), time.time_ns() - asked.source_ns
        self.status.on_result(Result(answer.frame.stamp_ns, answer.reason, warnings, values, latency_ns))
        self._send_origin(answer, engine)
        self._held.append(_Answered(answer, asked, engine))
        if not self._waits_for_map:
            self._release()

    def _send_origin(self, answer: Georeferenced, engine: Georeferencer) -> None:
        """Where the map is on the Earth, once it is known; it stays there, whatever becomes of the engine."""
        if self._unit == "m" and self.placer.origin is None and engine.local_frame is not None:
            self.placer.origin = engine.local_frame
            self.outputs.send_origin(origin_cdr(answer, engine.local_frame))

    # the static map --------------------------------------------------------------------------------------------------
    @property
    def _waits_for_map(self) -> bool:
        """Whether the first frames wait to be told where the water is."""
        held_mb = sum(one.asked.frame.image.nbytes for one in self._held) / 1e6
        return (self._map is not None and self._ground is None and not self._map_patience.is_over
                and held_mb < self.settings.backlog_mb)

    def _use_map(self, ground: StaticMap) -> None:
        if self._engine is None:  # what has begun without goes on so
            self._ground = ground
        self._release()

    def refresh(self) -> None:
        """Gives up waiting for a map that does not come."""
        if self._map is None or self._ground is not None:
            return
        self._map.refresh()
        if self._map_patience.check(self.free.ns, bool(self._held)):
            text = f"{self._map.lack}: velocities are measured everywhere"
            self.status.warn("map", text)
            self.get_logger().warning(text, once=True)
            self._release()

    def _release(self) -> None:
        """Measures the frames that have waited."""
        while self._held:
            one = self._held.popleft()
            with self.failures:
                try:
                    self._measure(one.answer, one.asked, one.engine)
                except InputError as error:
                    self.warn("measuring", f"cannot measure: {error}")

    # measuring -------------------------------------------------------------------------------------------------------
    def _measure(self, answer: Georeferenced, asked: Asked, engine: Georeferencer) -> None:
        self._begin_with(engine, asked.source_ns)
        told = None if self._motions is None else self._motions.reference_size
        self._reference_size = told or answer.frame.size
        if self._water is not None:
            self._send(self._water.add(answer, asked.motion), asked.source_ns)
        if self._bank is not None:
            self._note_bank(self._bank.add(answer, asked.motion))

    def _begin_with(self, engine: Georeferencer, source_ns: int) -> None:
        """Measures anew where frames are placed by another engine."""
        if engine is self._engine:
            return
        self._end(source_ns)
        self._engine = engine
        motions, placer = self._motions, self.placer
        by_tracker = None if motions is None else motions.camera
        camera = None if self._stabilized else by_tracker if self._unit == "px" else placer.camera
        stream = Stream(self._unit, None if motions is None else motions.reference_size, placer.image_H_ref, camera,
                        engine.orthophoto if self.values.get("orthophotos") else None)
        self._water = make_velocimeter(self.values, stream, self._ground)
        self._bank = None if self._ground is None else make_bank_check(self.values, stream, self._ground)

    def _end(self, source_ns: int) -> None:
        """Tells of the interval that is under way."""
        if self._water is not None:
            self._send(self._water.finish(), source_ns)
        self._water = self._bank = None

    def _send(self, intervals: list[Measured], source_ns: int) -> None:
        for measured in intervals:
            self.outputs.send(measured)
            self._velocity_status.on_measured(measured, time.time_ns() - source_ns)

    def _note_bank(self, intervals: list[Measured]) -> None:
        for measured in intervals:
            self._velocity_status.on_bank(measured)

    def _change(self, changed: dict[str, Value]) -> None:
        """Other parameters hold from the next frame on; the interval ends."""
        values = {**self.values, **changed}
        check_velocimetry(values)
        if self._reference_size is not None and _REGIONS & changed.keys():
            read_area(values).allowed(self._reference_size)
        self._ground = read_static_map(values) or self._ground
        self._end(time.time_ns())
        self.values, self._engine = values, None
