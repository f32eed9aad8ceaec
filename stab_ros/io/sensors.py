"""The positions, attitudes and water levels of a recording."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, TypeVar

from stab_ros.core.errors import InputError, MessageError
from stab_ros.core.text import are, counted, one_line
from stab_ros.io.attitude_message import ATTITUDE_TYPES, Attitude, read_attitude
from stab_ros.io.bag import BagReader, Message, Topic, open_bag
from stab_ros.io.cdr import IMU, NAV_SAT_FIX, QUATERNION_STAMPED
from stab_ros.io.fix_message import Fix, read_fix
from stab_ros.io.telemetry import KINDS
from stab_ros.io.topics import FIX_TOPIC, GIMBAL_TOPIC, IMU_TOPIC, WATER_LEVEL_TOPIC
from stab_ros.io.water_level_message import WATER_LEVEL_TYPES, WaterLevel, read_water_level


@dataclass(frozen=True)
class SensorTopics:
    """Names of topics; None: the one whose name ends with `fix`, `gimbal` (else `imu`), `water_level`, if any."""

    fix: str | None = None
    attitude: str | None = None
    water_level: str | None = None


@dataclass(frozen=True, eq=False)
class Sensors:
    """What the sensors of a recording measured, each in the order of its stamps, no two of which are equal.

    Attributes:
        topics: that it was read from; None: the recording has no such topic.
        fixes: positions without a fault.
        attitudes: attitudes without a fault.
        water_levels: water levels without a fault.
        warnings: what was left out or is in doubt: one line each.
    """

    topics: SensorTopics
    fixes: tuple[Fix, ...] = ()
    attitudes: tuple[Attitude, ...] = ()
    water_levels: tuple[WaterLevel, ...] = ()
    warnings: tuple[str, ...] = ()


class _Sample(Protocol):
    @property
    def stamp_ns(self) -> int: ...

    @property
    def fault(self) -> str: ...


_S = TypeVar("_S", bound=_Sample)


def read_sensors(path: Path, topics: SensorTopics | None = None) -> Sensors:
    """Reads the sensors of a recording.

    Args:
        path: an .mcap, a rosbag2 folder or a ROS 1 .bag; the one with the images or another, as `stab-ros telemetry`
            writes it.
        topics: which to read; None: as their names tell.

    Returns:
        The samples; none of a kind for which there is no topic.

    Raises:
        InputError: the recording cannot be read; a topic is missing, of another type, or one of several.
    """
    if path.suffix.lower() in KINDS:
        raise InputError(f"{path}: is no recording, `stab-ros telemetry {path} OUTPUT.mcap` makes one of it")
    with open_bag(path) as reader:
        chosen = choose_topics(str(path), reader.topics, topics or SensorTopics())
        collected = _Collected(str(path))
        fixes = collected.of(reader, chosen.fix, lambda message: read_fix(message.data))
        attitudes = collected.of(reader, chosen.attitude, lambda message: read_attitude(
            message.data, reader.topics[message.topic].msgtype))
        levels = collected.of(reader, chosen.water_level, lambda message: read_water_level(
            message.data, reader.topics[message.topic].msgtype, message.log_time_ns))
        doubts = (*_doubts(path, chosen.fix, fixes), *_doubts(path, chosen.attitude, attitudes))
        return Sensors(chosen, fixes, attitudes, levels, (*reader.warnings, *collected.warnings, *doubts))


def choose_topics(name: str, topics: Mapping[str, Topic], wanted: SensorTopics) -> SensorTopics:
    """The topics of a recording (`name`, for messages) that its sensors are read from; None where there is none.

    Raises:
        InputError: as `read_sensors`.
    """
    gimbal = _choose(name, topics, wanted.attitude, (GIMBAL_TOPIC,), ATTITUDE_TYPES, "attitude")
    return SensorTopics(
        _choose(name, topics, wanted.fix, (FIX_TOPIC,), (NAV_SAT_FIX,), "fix"),
        gimbal or _choose(name, topics, None, (IMU_TOPIC,), (IMU, QUATERNION_STAMPED), "attitude"),
        _choose(name, topics, wanted.water_level, (WATER_LEVEL_TOPIC,), WATER_LEVEL_TYPES, "water level"))


def _choose(name: str, topics: Mapping[str, Topic], wanted: str | None, endings: Collection[str],
            types: Collection[str], what: str) -> str | None:
    fitting = sorted(topic.name for topic in topics.values() if topic.msgtype in types and topic.encoding == "cdr")
    if wanted is not None:
        if wanted not in fitting:
            there = f"; it has {', '.join(map(one_line, fitting))}" if fitting else ", and none"
            raise InputError(f"{name}: has no topic {wanted} of type {' or '.join(types)}{there}")
        return wanted
    named = [topic for topic in fitting if topic.rstrip("/").rpartition("/")[2] in endings]
    filled = [topic for topic in named if topics[topic].count > 0] or named[:1]
    if len(filled) > 1:
        raise InputError(f"{name}: has several topics of the {what}, one must be named: "
                         f"{', '.join(map(one_line, filled))}")
    return filled[0] if filled else None


class _Collected:
    """Reads topics and notes what is left out of each."""

    def __init__(self, name: str) -> None:
        self.warnings: list[str] = []
        self._name = name

    def of(self, reader: BagReader, topic: str | None, read: Callable[[Message], _S]) -> tuple[_S, ...]:
        """The samples of a topic that can be used."""
        if topic is None:
            return ()
        left_out: Counter[str] = Counter()
        samples: dict[int, _S] = {}
        for message in reader.messages([topic]):
            try:
                sample = read(message)
                fault = sample.fault or ("its stamp is that of another" if sample.stamp_ns in samples else "")
            except MessageError as error:
                fault = str(error)
            if fault:
                left_out[fault] += 1
            else:
                samples[sample.stamp_ns] = sample
        if left_out:
            lost, why = left_out.total(), one_line(left_out.most_common(1)[0][0])
            self.warnings.append(f"{self._name}: {lost} of {counted(lost + len(samples), 'message')} of "
                                 f"{one_line(topic)} {are(lost)} left out, most because: {why}")
        return tuple(samples[stamp_ns] for stamp_ns in sorted(samples))


def _doubts(path: Path, topic: str | None, samples: Iterable[Fix | Attitude]) -> list[str]:
    found = Counter(sample.doubt for sample in samples)
    total = found.total()
    return [f"{path}: {count} of {counted(total, 'message')} of {one_line(topic)}: {doubt}"
            for doubt, count in found.items() if doubt]
