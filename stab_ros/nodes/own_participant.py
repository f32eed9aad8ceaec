"""A second DDS participant in the process of a node.

All topics of a participant of Fast DDS share its sockets: while one of them waits for a slow link, the others wait,
too, also those that go to the same machine through shared memory.
"""

from __future__ import annotations

from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter

_NO_SERVICE = Parameter("start_type_description_service", value=False)


class OwnParticipant:
    """node: publishes in it; hidden from `ros2 node list`, as its name begins with an underscore."""

    def __init__(self, beside: Node, purpose: str) -> None:
        """Of the same domain and enclave. purpose: the end of its node's name."""
        self._context = Context()
        arguments = ["--ros-args", "--enclave", _enclave(beside)]
        self._context.init(arguments, initialize_logging=False, domain_id=beside.context.get_domain_id())
        self.node = Node(f"_{beside.get_name()}_{purpose}", context=self._context, namespace=beside.get_namespace(),
                         use_global_arguments=False, enable_rosout=False, start_parameter_services=False,
                         parameter_overrides=[_NO_SERVICE])
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)

    def poll(self) -> None:
        """Handles events of its publishers; to be called periodically."""
        self._executor.spin_once(timeout_sec=0)

    def close(self) -> None:
        """To be called before the other node is destroyed; again without effect."""
        if self._context.ok():
            self._executor.shutdown()
            self.node.destroy_node()
            self._context.try_shutdown()


def _enclave(node: Node) -> str:
    own = node.get_name(), node.get_namespace()
    return next((enclave for name, namespace, enclave in node.get_node_names_and_namespaces_with_enclaves()
                 if (name, namespace) == own), "/")
