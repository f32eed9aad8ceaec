"""The work of velocimetry on every picture of a recording: the water, and the bank beside it."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

from stab_ros.core.settings import Value
from stab_ros.core.types import Frame
from stab_ros.georeferencing.local_frame import LocalFrame
from stab_ros.io.cdr import IMAGE
from stab_ros.io.source import Kind, Source, kind_of, namespace_of
from stab_ros.io.static_maps import read_recorded_map, read_static_map
from stab_ros.io.topics import STATIC_MAP_TOPIC, TRACKER_NAME, topic_in
from stab_ros.jobs.placed_recording import Placed, Placing, Recording
from stab_ros.jobs.placing import PlacedPicture, Work
from stab_ros.parameters.table import velocity_config
from stab_ros.parameters.velocimeters import GROUND, make_bank_check, make_placer, make_velocimeter, takes_map
from stab_ros.report.panel import gray_of
from stab_ros.report.velocity_maps import Background
from stab_ros.tracking.static_map import StaticMap
from stab_ros.velocimetry.pictures import Stream
from stab_ros.velocimetry.settings import METHODS
from stab_ros.velocimetry.vectors import Unit, Vectors
from stab_ros.velocimetry.velocimeter import Measured, Velocimeter
from stab_ros.velocimetry.zone import Zone


class VelocityWork:
    """Measures what pictures show, once they are placed.

    unit: of lengths. name: of the recording.
    """

    def __init__(self, job: Placed, values: Mapping[str, Value], recording: Recording, source: Source,
                 unit: Unit) -> None:
        """values: parameters of velocimetry.

        Raises:
            InputError: a value or a file is wrong.
        """
        self.unit, self.name = unit, source.name
        self._values, self._recording = values, recording
        self._given = read_static_map(values)
        self._ground = self._given or _recorded_map(job, source)
        self._placing: Placing | None = None
        self._stream = Stream(unit)
        self._water: Velocimeter | None = None
        self._bank: Velocimeter | None = None
        self.background: Background | None = None

    @property
    def grid_m(self) -> float:
        """Side of the cells of the grid; 0: what suits the vectors."""
        return float(self._values.get("grid_m", 0.0))

    @property
    def interval_name(self) -> str:
        """The parameter that tells how long an interval is."""
        return METHODS[velocity_config(self._values).method]

    @property
    def local_frame(self) -> LocalFrame | None:
        """Where the map is on the Earth; None: unknown."""
        return None if self._placing is None else self._placing.engine.local_frame

    @property
    def doubts(self) -> tuple[str, ...]:
        """Of the whole stream, at its end."""
        if self._placing is None:
            return ()
        engine = self._placing.engine
        return (*engine.doubts, *(f"{self.name}: {doubt}" for doubt in engine.last_look()))

    @property
    def bank_known(self) -> bool:
        """Whether a static map tells where the bank is."""
        return self._ground is not None

    @property
    def leaves_out_bank(self) -> bool:
        """Whether velocities are not wanted where a static map shows ground."""
        return self.bank_known and (takes_map(self._values) or self._given is not None)

    @property
    def area_given(self) -> bool:
        """Whether parameters say where velocities are wanted."""
        return any(self._values.get(name) for name in ("roi", "exclude", "lines"))

    def begin(self, size: tuple[int, int]) -> Work:
        """The engines for images of this width and height.

        Raises:
            InputError: settings, camera and recording contradict each other.
        """
        placing = self._placing = self._recording.begun(size, partial(make_placer, self._values))
        engine, camera = placing.engine, placing.camera
        recorded = self._recording.recorded
        if self.unit == "px" and recorded is not None:
            camera = recorded.camera  # whose distortion the homographies have taken out
        self._stream = Stream(
            self.unit, placing.reference_size, placing.image_H_ref, camera if placing.image_H_ref is None else None,
            engine.orthophoto if self._values.get("orthophotos") else None)
        make_velocimeter(self._values, self._stream)  # so that wrong values end the work before the first frame
        return Work(engine, camera, placing.motion_of, None)

    def add(self, placed: PlacedPicture) -> tuple[list[Measured], list[Measured]]:
        """The intervals that end with a picture: of the water, and of the bank."""
        water = self._begun()
        if self.background is None and placed.answer.placement is not None:
            self.background = _background(placed, self.unit)
        bank = [] if self._bank is None else self._bank.add(placed.answer, placed.motion)
        return water.add(placed.answer, placed.motion), bank

    def finish(self) -> tuple[list[Measured], list[Measured]]:
        """The intervals that were under way at the end."""
        return ([] if self._water is None else self._water.finish(), [] if self._bank is None else self._bank.finish())

    def of_water(self, measured: Measured) -> Vectors:
        """The vectors that do not lie on static ground, as far as that is known."""
        if self._ground is None:
            return measured.vectors
        ground = Zone(measured.zone.plane_H_ref, self._ground.picture() >= GROUND)
        return measured.vectors[~ground.holds(measured.vectors)]

    def _begun(self) -> Velocimeter:
        """The engine for the water; that for the bank, where a map tells of it.

        The map of the stabiliser is known when it has answered the first frame.
        """
        if self._water is not None:
            return self._water
        tracker = None if self._placing is None else self._placing.tracker
        if self._ground is None and tracker is not None and tracker.static_map is not None:
            self._ground = tracker.static_map if tracker.static_map.divides else None
        left_out = self._ground if takes_map(self._values) else self._given
        self._water = make_velocimeter(self._values, self._stream, left_out)
        if self._ground is not None:
            self._bank = make_bank_check(self._values, self._stream, self._ground)
        return self._water


def _recorded_map(job: Placed, source: Source) -> StaticMap | None:
    """The static map in the recording, as `stabilize` or a recorder of the tracker wrote it."""
    namespace = namespace_of(source.topics[source.image_topic])
    names = (topic_in(namespace, STATIC_MAP_TOPIC), topic_in(topic_in(namespace, TRACKER_NAME), STATIC_MAP_TOPIC))
    found = [name for name in names if name in source.topics and source.topics[name].msgtype == IMAGE]
    return read_recorded_map(job.source, found[0]) if found and kind_of(job.source) is Kind.BAG else None


def _background(placed: PlacedPicture, unit: Unit) -> Background | None:
    """The orthophoto of a frame, with its borders on the plane."""
    image, grid, frame = placed.work.engine.orthophoto(placed.answer), placed.answer.grid, placed.answer.frame
    if image is None or grid is None:
        return None
    gray = gray_of(Frame(image, frame.warped_encoding, frame.stamp_ns))
    east, south = grid.west_m + grid.columns * grid.resolution_m, grid.north_m - grid.rows * grid.resolution_m
    down = -1 if unit == "px" else 1  # y of pixels
    return Background(gray, (grid.west_m, east, down * south, down * grid.north_m))
