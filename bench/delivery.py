"""How late small messages come beside pictures, over real DDS: with Fast DDS's own settings, and with our profile."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import rclpy
from effort import Effort
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message
from sensor_msgs.msg import CameraInfo, Image
from tables import Section, Table, number

from stab_ros.core.types import FloatArray
from stab_ros.nodes.transport import FAST_DDS, loaded_fast_dds

_SIZES = {"960x540 bgr8": (960, 540), "1920x1080 bgr8": (1920, 1080), "3840x2160 bgr8": (3840, 2160)}
_PROFILES: Mapping[str, bool] = {"Fast DDS's own": False, "ours": True}
_LISTENERS, _RATE_HZ, _DOMAIN = 2, 24.0, 71
_HERE = Path(__file__)


def measure(effort: Effort) -> Section:
    """Every size with either profile; in a process of its own, since Fast DDS reads the profile once."""
    rows, data = [], {}
    for size in _SIZES:
        found = {name: _late_ms(size, ours, effort.delivered) for name, ours in _PROFILES.items()}
        rows.append((size, *(number(value, 0) for late in found.values()
                             for value in (*np.percentile(late, [50, 95]), late.max()))))
        data[size] = {name: {"median_ms": float(np.median(late)), "p95_ms": float(np.percentile(late, 95)),
                             "max_ms": float(late.max()), "count": len(late)} for name, late in found.items()}
    head = ("pictures beside them", *(f"{name}: {what}" for name in _PROFILES for what in ("median", "95 %", "max")))
    note = (f"One publisher at {_RATE_HZ:g} Hz, {_LISTENERS} subscribers, each a process; pictures at depth 1, each "
            "acknowledged before the next; all RELIABLE.")
    return Section("Delivery", [Table("How late a small message comes, ms", head, rows, note)], data)


def _late_ms(size: str, ours: bool, count: int) -> FloatArray:
    environment = {**os.environ, "ROS_DOMAIN_ID": str(_DOMAIN), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    for one in FAST_DDS:
        environment.pop(one.variable, None)
    fast_dds = loaded_fast_dds()
    environment |= {fast_dds.variable: str(fast_dds.profile)} if ours and fast_dds else {}
    listen = [sys.executable, str(_HERE.with_name("one_listener.py")), str(count)]
    listeners = [subprocess.Popen(listen, env=environment, stdout=subprocess.PIPE) for _ in range(_LISTENERS)]
    subprocess.run([sys.executable, str(_HERE), size, str(count)], env=environment, check=True)
    return np.concatenate([json.loads(one.communicate()[0]) for one in listeners])


def speak(size: str, count: int) -> None:
    """What the publishing process does."""
    context = Context()
    rclpy.init(context=context)
    node = rclpy.create_node("speaker", context=context)
    pictures = node.create_publisher(Image, "pictures", QoSProfile(depth=1))
    small = node.create_publisher(CameraInfo, "small", QoSProfile(depth=100))
    width, height = _SIZES[size]
    picture = Image(width=width, height=height, step=3 * width, encoding="bgr8")
    picture.data.frombytes(bytes(3 * width * height))
    cdr = serialize_message(picture)
    while min(pictures.get_subscription_count(), small.get_subscription_count()) < _LISTENERS:
        time.sleep(0.05)
    for _ in range(count):
        next_s = time.monotonic() + 1 / _RATE_HZ
        small.publish(_stamped(node))
        pictures.wait_for_all_acked(Duration(seconds=10))
        pictures.publish(cdr)
        time.sleep(max(0.0, next_s - time.monotonic()))
    small.wait_for_all_acked(Duration(seconds=10))
    rclpy.shutdown(context=context)


def _stamped(node: Node) -> CameraInfo:
    message = CameraInfo()
    message.header.stamp = node.get_clock().now().to_msg()
    return message


if __name__ == "__main__":
    speak(sys.argv[1], int(sys.argv[2]))
