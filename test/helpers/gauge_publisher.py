"""A program of another's: publishes one message of a package that is not ours, and ends once it has been received."""

from __future__ import annotations

import time

import rclpy
from builtin_interfaces.msg import Time
from rclpy.duration import Duration
from river_msgs.msg import Gauge, Level


def main() -> None:
    rclpy.init()
    node = rclpy.create_node("gauge")
    publisher = node.create_publisher(Gauge, "/gauge", 10)
    while not publisher.get_subscription_count():
        time.sleep(0.05)
    levels = [Level(stamp=Time(sec=7, nanosec=8), level_m=2.5), Level(level_m=-0.25)]
    publisher.publish(Gauge(site="Aare, Bern", levels=levels, wind_m_s=[1.0, 2.0, -3.0], codes=[1, 2, 300]))
    publisher.wait_for_all_acked(Duration(seconds=60))
    node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
