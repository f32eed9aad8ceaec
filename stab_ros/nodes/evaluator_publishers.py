"""Everything that the evaluator publishes but its diagnostics."""

from __future__ import annotations

from collections.abc import Sequence

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import QoSProfile
from std_msgs.msg import Float64

from stab_ros.evaluation.frame_metrics import FrameMetrics
from stab_ros.io.cdr import Header
from stab_ros.io.metrics_message import float64_cdr, metrics_cdr
from stab_ros.io.topics import DISPLACEMENT_TOPIC, METRICS_TOPIC, RMSD_TOPIC, RMSE_TOPIC, private
from stab_ros.nodes.cdr_publisher import CdrPublisher
from stab_ros.nodes.managed_node import StabNode

_PLOTTED = {"rmse_reference_px": RMSE_TOPIC, "rmsd_reference": RMSD_TOPIC,
            "displacement_reference_px": DISPLACEMENT_TOPIC}


class EvaluatorPublishers:
    """All metrics of a frame, and three of them as single numbers for plotting tools."""

    def __init__(self, node: StabNode) -> None:
        self.metrics = CdrPublisher(node, DiagnosticArray, private(METRICS_TOPIC), QoSProfile(depth=100))
        self._plots = {name: CdrPublisher(node, Float64, private(topic), QoSProfile(depth=100))
                       for name, topic in _PLOTTED.items()}

    def send(self, metrics: FrameMetrics, point_names: Sequence[str], header: Header) -> None:
        self.metrics.send(metrics_cdr(metrics, point_names, header))
        for name, publisher in self._plots.items():
            value = metrics[name]
            if value is not None:
                publisher.send(float64_cdr(value))
