"""What `stab-ros discharge` reads: velocities with the water level of their time, and the section in the map."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from stab_ros.core.errors import InputError, MessageError
from stab_ros.core.text import counted
from stab_ros.core.types import FloatArray
from stab_ros.discharge.cross_section import CrossSection, between, referenced
from stab_ros.discharge.doubts import looks_like_elevations
from stab_ros.georeferencing.local_frame import LocalFrame
from stab_ros.georeferencing.survey_units import unit_in
from stab_ros.io.bag import BagReader, Message, Topic, open_bag
from stab_ros.io.cdr import NAV_SAT_FIX, POINT_CLOUD2
from stab_ros.io.fix_message import read_fix
from stab_ros.io.georeference_messages import MAP_FRAME
from stab_ros.io.section_file import Heights, SectionTable
from stab_ros.io.topics import ORIGIN_TOPIC, VELOCIMETRY_NAME, WATER_LEVEL_TOPIC
from stab_ros.io.velocity_csv import read_velocities
from stab_ros.io.velocity_message import read_surface, read_velocity
from stab_ros.io.water_level_message import WATER_LEVEL_TYPES, read_water_level
from stab_ros.velocimetry.speeds import joined
from stab_ros.velocimetry.vectors import Vectors

_VELOCITY = "velocity"  # last part of the topic's name
_OTHERS = {WATER_LEVEL_TOPIC: WATER_LEVEL_TYPES, ORIGIN_TOPIC: (NAV_SAT_FIX,)}  # likewise, and the types


@dataclass(frozen=True, eq=False)
class MeasuredVelocities:
    """What a recording or table says of velocities.

    Attributes:
        vectors: in the order of the file.
        levels: stamps, ns, and water surface elevations, m, in the order of their stamps.
        used_wse_m: at which the vectors were measured; None: not said.
        origin: the map's place on the earth; None: not said.
        warnings: one line each.
    """

    vectors: Vectors
    levels: tuple[tuple[int, float], ...] = ()
    used_wse_m: float | None = None
    origin: LocalFrame | None = None
    warnings: tuple[str, ...] = ()


def read_measured(path: Path, topic: str | None = None) -> MeasuredVelocities:
    """Reads `V.csv`, or the velocities and water levels of a recording.

    Args:
        path: a .csv as `stab-ros velocity --csv` writes it, or a recording.
        topic: of the velocities, where a recording has several of them.

    Raises:
        InputError: it cannot be read, or holds no velocities.
    """
    if path.suffix.lower() == ".csv":
        return MeasuredVelocities(read_velocities(path))
    with open_bag(path) as bag:
        velocity = _velocity_topic(path, bag.topics, topic)
        others = [one for one in bag.topics.values() if one.msgtype in _OTHERS.get(one.name.rsplit("/", 1)[-1], ())]
        return _gathered(path, bag, velocity, others)


def _velocity_topic(path: Path, topics: Mapping[str, Topic], wanted: str | None) -> Topic:
    clouds = [one for one in topics.values() if one.msgtype == POINT_CLOUD2]
    found = [one for one in clouds if one.name == wanted or (wanted is None and one.name.endswith(_VELOCITY))]
    if len(found) == 1:
        return found[0]
    if found:
        raise InputError(f"{path}: has velocities on {', '.join(one.name for one in found)}; give one as --topic")
    have = ", ".join(one.name for one in clouds) or "no PointCloud2 at all"
    raise InputError(f"{path}: has no velocities{f' on {wanted}' if wanted else ''} ({have}); it must be a recording "
                     "of velocimetry_node, or what stab-ros velocity wrote")


@dataclass(eq=False)
class _Gathered:
    """What the messages of a recording say, one by one."""

    parts: list[Vectors] = field(default_factory=list)
    used_wse_m: list[float] = field(default_factory=list)
    levels: list[tuple[int, float]] = field(default_factory=list)
    origins: dict[str, LocalFrame] = field(default_factory=dict)  # by topic
    moved: bool = False  # whether the origin of a topic changes

    @property
    def origin(self) -> LocalFrame | None:
        """That of the node which measured, where there is one of another node, too."""
        own = [frame for topic, frame in self.origins.items() if VELOCIMETRY_NAME in topic.split("/")]
        return next(iter((*own, *self.origins.values())), None)

    def take(self, message: Message, msgtype: str) -> None:
        """Raises MessageError for a damaged message."""
        if msgtype == POINT_CLOUD2:
            self.parts.append(_vectors(message))
            used_m = read_surface(message.data)
            self.used_wse_m += [] if used_m is None else [used_m]
        elif msgtype == NAV_SAT_FIX:
            fix = read_fix(message.data)
            if not fix.fault:
                frame = LocalFrame(fix.latitude_deg, fix.longitude_deg, fix.height_m)
                self.moved |= self.origins.setdefault(message.topic, frame) != frame
        else:
            level = read_water_level(message.data, msgtype, message.log_time_ns)
            self.levels += [] if level.fault else [(level.stamp_ns, level.wse_m)]


def _gathered(path: Path, bag: BagReader, velocity: Topic, others: list[Topic]) -> MeasuredVelocities:
    found, damaged = _Gathered(), 0
    types = {one.name: one.msgtype for one in (velocity, *others)}
    for message in bag.messages(list(types)):
        try:
            found.take(message, types[message.topic])
        except MessageError:
            damaged += 1
    said = [f"{path}: {counted(damaged, 'message')} could not be read"] if damaged else []
    if found.moved:
        raise InputError(f"{path}: the origin of its map changes, so its velocities are of several maps; measure the "
                         "parts one by one")
    used_m = float(np.median(found.used_wse_m)) if found.used_wse_m else None
    try:
        return MeasuredVelocities(joined(found.parts), tuple(sorted(found.levels)), used_m, found.origin,
                                  (*said, *bag.warnings))
    except ValueError as error:
        raise InputError(f"{path}: {error}; they must be of one setup") from error


def _vectors(message: Message) -> Vectors:
    header, vectors = read_velocity(message.data)
    return vectors if header.frame_id == MAP_FRAME else read_velocity(message.data, "px")[1]


@dataclass(frozen=True)
class Line:
    """Where the distances of a section are in the map.

    Attributes:
        start_m: east and north of the start.
        end_m: of the end.
        start_chainage_m: the distance at the start.
    """

    start_m: tuple[float, float]
    end_m: tuple[float, float]
    start_chainage_m: float = 0.0


def in_map(table: SectionTable, line: Line | None, crs: str, origin: LocalFrame | None
           ) -> tuple[SectionTable, Line | None]:
    """Places of a reference system in the map; heights stay as they are.

    Args:
        table: as the file says.
        line: of a section by distances, in the same system and its unit.
        crs: "EPSG:nnnn".
        origin: of the map.

    Raises:
        InputError: the origin is not known, the system is unknown, or a place is not near the map.
    """
    if origin is None:
        raise InputError(f"coordinates of {crs} need the origin of the map; give --origin LATITUDE,LONGITUDE")

    def mapped(places: FloatArray) -> FloatArray:
        full = np.column_stack([places, np.full(len(places), origin.height_m)])
        return origin.from_crs(crs, full)[:, :2]

    unit, said = (1.0, []) if table.position_m is None else unit_in(crs, table.unit_m, "section")
    placed = None if table.position_m is None else mapped(table.position_m / unit)
    if line is not None:
        start, end = mapped(np.array([line.start_m, line.end_m])).tolist()
        line = Line((start[0], start[1]), (end[0], end[1]), line.start_chainage_m)
    return replace(table, position_m=placed, remarks=(*table.remarks, *said)), line


def section_of(path: Path, table: SectionTable, line: Line | None, heights: Heights | None, wse_m: float | None
               ) -> tuple[CrossSection, float, list[str]]:
    """The section of a file, in the map.

    Args:
        path: for messages.
        table: what the file says.
        line: of distances.
        heights: what the heights are, where the header does not say so, or is wrong.
        wse_m: water surface elevation; None: not known, which depths do not need.

    Returns:
        The section, the water surface elevation (0 for depths without one), and warnings.

    Raises:
        InputError: something is missing, or the points are no section.
    """
    kind = heights or table.heights
    if kind == "unknown":
        raise InputError(f"{path}: its header does not tell whether heights are bed elevations or depths; name the "
                         "column Z or depth, or give --elevation or --depth")
    if kind == "elevation" and wse_m is None:
        raise InputError(f"{path}: bed elevations need the water surface elevation; give --wse, or depths")
    level_m = 0.0 if wse_m is None else wse_m
    said = list(table.remarks)
    if kind == "depth":
        said += _depth_doubts(path, table.height_m)
    bed = level_m - table.height_m if kind == "depth" else table.height_m
    try:
        return _placed(path, table, line, bed), level_m, said
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _placed(path: Path, table: SectionTable, line: Line | None, bed_m: FloatArray) -> CrossSection:
    if table.position_m is not None and line is not None:
        raise InputError("has places of its own, so --from and --to must not be given: they are for distances along a "
                         "line")
    if table.position_m is not None:
        return referenced(table.position_m, bed_m)
    if line is None or table.chainage_m is None:
        raise InputError("has distances along a line, so the map must be told where it runs: --from X,Y --to X,Y")
    return between(np.array(line.start_m), np.array(line.end_m), table.chainage_m, bed_m, line.start_chainage_m)


def _depth_doubts(path: Path, depth_m: FloatArray) -> list[str]:
    if not looks_like_elevations(depth_m):
        return []
    return [f"{path}: the depths are largest at its ends, or differ little for their size, as bed elevations do: if "
            "they are elevations, their column must be named Z"]
