"""What the constructor of each node takes, so that it can live in a process of somebody else."""

from __future__ import annotations

from typing import TypedDict

from rclpy.context import Context
from rclpy.parameter import Parameter

from stab_ros.nodes.image_source import ImageSource


class RosOptions(TypedDict, total=False):
    """Keyword arguments with the meaning that they have for `rclpy.node.Node`.

    use_global_arguments: whether remappings and parameters of the process, such as `__node` and `__ns`, hold for the
    node as well; without them, `cli_args` can name its own.
    """

    node_name: str
    context: Context
    namespace: str
    cli_args: list[str]
    use_global_arguments: bool
    parameter_overrides: list[Parameter]
    enable_logger_service: bool


class NodeOptions(RosOptions, total=False):
    """images: who takes images for the node, with others of its process; else it subscribes to them by itself."""

    images: ImageSource
