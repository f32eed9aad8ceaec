"""Images that several nodes of a process share, one of which falls behind."""

from __future__ import annotations

import itertools
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import rclpy
from live_graph import Graph, image_message
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.qos import HistoryPolicy, QoSProfile
from sensor_msgs.msg import Image

from stab_ros.core.errors import ConfigError
from stab_ros.nodes.image_hub import ImageHub
from stab_ros.nodes.received_image import ReceivedImage

IMAGES, FEW = 100, 20
LONG = 100  # looks of a node at its images: 10 s


def test_images_wait_in_dds_while_a_node_has_no_room(graph: Graph) -> None:
    """A few of them are in memory; of a reliable source each arrives in the end, once and in order."""
    hub, executor = ImageHub(context=graph.context), SingleThreadedExecutor(context=graph.context)
    executor.add_node(hub)
    taken: list[ReceivedImage] = []
    part = hub.join(graph.node, "/image", compressed=False, keep_all=True, take=taken.append)
    publisher = graph.speak(Image, "/image", QoSProfile(history=HistoryPolicy.KEEP_ALL))
    for number in range(IMAGES):
        publisher.publish(image_message(np.full((48, 64), number, np.uint8), number))
    for _ in range(IMAGES):  # while the node is busy
        executor.spin_once(timeout_sec=0.01)
    spins = itertools.count()
    graph.until(lambda: next(spins) > FEW, "the node has had its turn, and not the hub")
    assert 0 < len(taken) < FEW
    with ThreadPoolExecutor(1) as threads:
        threads.submit(executor.spin)
        graph.until(lambda: len(taken) == IMAGES, "all images")
        executor.shutdown()
    assert [one.frame().stamp_ns for one in taken] == [*range(IMAGES)]
    part.close()


def test_each_reason_for_no_images_is_said_once(graph: Graph, capfd: pytest.CaptureFixture[str]) -> None:
    hub, executor = ImageHub(context=graph.context), SingleThreadedExecutor(context=graph.context)
    hub.awaited = 2
    part = hub.join(graph.node, "/image", compressed=False, keep_all=True, take=lambda image: None)
    for name in ("/late", graph.node.get_fully_qualified_name()):
        hub.expect(name)

    def said() -> list[str]:
        for _ in range(LONG):
            part.refresh()
        return [line.split("images are taken: ")[1] for line in capfd.readouterr().err.splitlines()]

    assert [line[:12] for line in said()] == ["nobody spins"]
    assert hub.obstacle == "an executor that spins /image_hub"
    executor.add_node(hub)
    executor.spin_once(timeout_sec=10.0)  # until its timer
    assert said() == ["they wait for 2 nodes of the process to take images, so far 1, not yet /late"]
    assert not said()
    part.close()
    executor.shutdown()


def test_a_node_that_could_not_join_holds_nobody_up(graph: Graph) -> None:
    hub, executor = ImageHub(context=graph.context), SingleThreadedExecutor(context=graph.context)
    executor.add_node(hub)
    depth = "qos_overrides./image.subscription.depth"
    hub.set_parameters([Parameter(depth, value=-1)])
    lost = rclpy.create_node("lost", context=graph.context)
    with pytest.raises(ConfigError, match="depth: -1"):
        hub.join(lost, "/image", compressed=False, keep_all=True, take=lambda image: None)
    hub.set_parameters([Parameter(depth, value=20)])
    hub.awaited = 1
    assert hub.obstacle.endswith("so far 0")
    taken: list[ReceivedImage] = []
    part = hub.join(graph.node, "/image", compressed=False, keep_all=True, take=taken.append)
    publisher = graph.speak(Image, "/image", QoSProfile(history=HistoryPolicy.KEEP_ALL))
    for number in range(FEW):
        publisher.publish(image_message(np.full((48, 64), number, np.uint8), number))

    def all_taken() -> bool:
        executor.spin_once(timeout_sec=0.01)
        return len(taken) == FEW

    graph.until(all_taken, "all images")
    part.close()
    executor.shutdown()
