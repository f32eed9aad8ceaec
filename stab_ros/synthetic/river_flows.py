"""Flow, bed and cross-section of the scenes of `river`: 0.12 m/s (kolubara), up to 2 (alpine), and 0.4 (basento)."""

from __future__ import annotations

from dataclasses import dataclass

from stab_ros.core.errors import InputError
from stab_ros.synthetic.channel import Channel
from stab_ros.synthetic.cross_section import Bed, CrossSection
from stab_ros.synthetic.river import SceneSettings
from stab_ros.synthetic.velocity_fields import ChannelFlow, Eddy, Profile, Sum, Surge, Unsteady, VelocityField

FLOWS = ("parabolic", "asymmetric", "eddy", "unsteady")


@dataclass(frozen=True)
class _Reach:
    """Speed on the centre line, m/s, and depth there, m; the section's east, m."""

    speed_m_s: float
    depth_m: float
    section_east_m: float


# alpine: its islands crowd the flow, which is then up to 2 m/s
_REACHES = {"kolubara": _Reach(0.12, 1.4, 3.0), "alpine": _Reach(0.916, 0.9, -8.1), "basento": _Reach(0.4, 0.35, 0.4)}


def flow_of(scene: SceneSettings, kind: str = "parabolic") -> VelocityField:
    """A flow in the channel of a scene; scenes of other names flow with the speed of their stream.

    Args:
        scene: which.
        kind: `parabolic` across the channel; `asymmetric`: flat in mid-stream and faster in the north; `eddy`: with one
            on each side, the northern one so strong that water runs back; `unsteady`: pulsing, with two surges.

    Raises:
        InputError: there is no such flow.
    """
    channel, speed = Channel.of(scene), _reach(scene).speed_m_s
    plain = ChannelFlow(channel, speed)
    if kind == "parabolic":
        return plain
    if kind == "asymmetric":
        return ChannelFlow(channel, speed, Profile(exponent=4.0, skew=0.4))
    if kind == "eddy":
        return Sum((plain, *_eddies(channel, speed)))
    if kind == "unsteady":
        return Unsteady(plain, 0.15, 5.0, (Surge(2.5, 0.4, 0.3), Surge(6.0, 0.8, -0.2)))
    raise InputError(f"flow {kind!r} is unknown, it must be one of {', '.join(FLOWS)}")


def bed_of(scene: SceneSettings) -> Bed:
    """The bed below a scene's water, deepest south of the centre line."""
    return Bed(Channel.of(scene), _reach(scene).depth_m, Profile(exponent=2.5, skew=-0.25))


def section_of(scene: SceneSettings) -> CrossSection:
    """A cross-section of a scene, half a metre beyond its banks; alpine's crosses an island."""
    channel = Channel.of(scene)
    return CrossSection.at(bed_of(scene), _reach(scene).section_east_m, 0.1 * channel.half_width_m)


def _reach(scene: SceneSettings) -> _Reach:
    other = _Reach(scene.stream.speed_m_s, 0.1 * scene.stream.width * scene.ground_m[1], 0.0)
    return _REACHES.get(scene.name, other)


def _eddies(channel: Channel, speed_m_s: float) -> tuple[Eddy, Eddy]:
    """Two eddies that turn as the shear of the flow does; they end well before the banks."""
    radius = 0.16 * channel.half_width_m
    north, south = (channel.middle_m + side * 0.45 * channel.half_width_m for side in (1, -1))
    return (Eddy((-3 * radius, north), radius, 1.0 * speed_m_s), Eddy((5 * radius, south), radius, -0.6 * speed_m_s))
