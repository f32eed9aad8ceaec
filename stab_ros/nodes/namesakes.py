"""That other nodes have the full name of this one, which ROS allows, and tells of in some of its tools alone."""

from __future__ import annotations

from rclpy.node import Node

_LOOKS = 3  # in a row until it is told: a node that is restarted may overlap with the one before


class Namesakes:
    """Of one node; `look` is to be called once a second.

    A look reads what the middleware knows anyhow, 6 us among 50 nodes. A node that was killed leaves its name to those
    that knew it, until its participant is given up (Fast DDS: 20 s); one that takes its place never hears of it.

    problem: what is wrong, and what to do; "" for nothing.
    """

    def __init__(self, node: Node, given: str = "") -> None:
        """given: the name of the node in its program, where its process has others that shall not be renamed too."""
        self._node = node
        self._rename = f"{given}:__node" if given else "__node"
        self._looks = 0
        self.problem = ""

    def look(self) -> None:
        """Logs it when others come, and when they have left."""
        named, name = (self._node.get_name(), self._node.get_namespace()), self._node.get_fully_qualified_name()
        there_are = self._node.get_node_names_and_namespaces().count(named) > 1
        self._looks = self._looks + 1 if there_are else 0
        if self._looks >= _LOOKS and not self.problem:
            self.problem = (f"another node is named {name} too: services and topics below this name are of both; give "
                            f"one another name, as -r {self._rename}:=NAME, or namespace, as -r __ns:=/NAME")
            self._node.get_logger().warning(self.problem)
        elif self.problem and not there_are:
            self.problem = ""
            self._node.get_logger().info(f"no other node is named {name} any more")
