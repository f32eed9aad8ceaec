"""The live evaluator: a thin shell around `Evaluator`, the same engine and the same pairing as the command's."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import fields
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import QoSProfile
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Float64

from stab_ros.core.errors import InputError, MessageError
from stab_ros.core.gray import without_colour
from stab_ros.core.kernels import Compilation, compile_kernels
from stab_ros.core.memory import give_back_memory
from stab_ros.core.settings import Value
from stab_ros.core.types import Frame
from stab_ros.evaluation.evaluator import Arrival, Evaluator
from stab_ros.evaluation.findings import Level, findings
from stab_ros.evaluation.frame_metrics import FrameMetrics, Outcome
from stab_ros.evaluation.pairing import Pairing
from stab_ros.io.messages import (
    IMAGE,
    SECOND_NS,
    Header,
    float64_cdr,
    metrics_cdr,
    read_homography,
    read_image,
    read_size,
)
from stab_ros.nodes import params
from stab_ros.nodes.backlog import Backlog
from stab_ros.nodes.evaluator_status import EvaluatorStatus
from stab_ros.nodes.outlet import Outlet
from stab_ros.nodes.qos import AdaptiveSubscription, Choice, keep_all_offered, latest_latched
from stab_ros.nodes.runtime import StabNode
from stab_ros.nodes.spinner import Spinner
from stab_ros.parameters.engines import make_evaluator
from stab_ros.parameters.node_settings import EvaluatorSettings
from stab_ros.parameters.table import EVALUATOR_PARAMETERS, evaluator_config

_IMAGE, _HOMOGRAPHY, _REFERENCE = "image_stabilized", "homography", "tracker_node/reference_image"
_LOOK_NS = SECOND_NS // 10  # how often publishers and the level are looked at
_WARN_EVERY_S = 5.0
_TAKEN = 50  # messages at most, then a frame is measured
# Waits are of free time, with nothing to take and nothing to measure
_REFERENCE_LIMIT_NS = 4 * SECOND_NS  # a publisher of references that has sent none by then has none for this frame
_DISCOVERY_NS = SECOND_NS // 2  # by then the publisher of references is known, if there is one
_PICTURE_LIMIT_NS = SECOND_NS  # a picture that the next frame's homography overtook by so much will not come any more
_HOMOGRAPHY_LIMIT_NS = 4 * SECOND_NS  # what Fast DDS lost comes again after 3 s, unless a profile says otherwise
_FIX = "let it offer RELIABLE or BEST_EFFORT, VOLATILE or TRANSIENT_LOCAL"


SETTINGS = params.table_of(EvaluatorSettings)
# what was prepared from the reference stays as it is
_PREPARED = {"points", "window_px", "svf_columns", "svf_rows", "roi", "exclude", "points_file"}
CHANGEABLE = frozenset(EVALUATOR_PARAMETERS) - _PREPARED


class EvaluatorNode(StabNode):
    """Takes all that comes, and measures one frame after the other."""

    COMPUTES = True

    def __init__(self) -> None:
        super().__init__("evaluator_node")
        values = params.declare(self, {**EVALUATOR_PARAMETERS, **SETTINGS}, CHANGEABLE)
        params.warn_of_unknown(self, values)
        chosen: Any = {item.name: values.pop(item.name) for item in fields(EvaluatorSettings)}
        self.settings = EvaluatorSettings(**chosen)
        self.values = values
        self.evaluator: Evaluator = make_evaluator(values)
        self.status = EvaluatorStatus(*(round(seconds * SECOND_NS) for seconds in (
            self.settings.window_s, self.settings.alarm_s, self.settings.stale_s)))
        waiting_bytes = round(self.settings.backlog_mb * 1e6)
        self._backlog, self._pairing = Backlog(waiting_bytes), Pairing(False, waiting_bytes)
        self._inputs: dict[str, AdaptiveSubscription] = {}
        self._received = 0
        self._overran = False  # more pictures have waited than usual
        self._moved_ns = 0  # free time when the pairing last gave out a frame, or began to wait
        self._awaits_reference = True
        self._waits_since_ns: int | None = None  # free time when the first picture began to wait for it
        self._frame_id = ""
        self._told_level = 0
        self._make_outlets()
        params.LiveChanges(self, EVALUATOR_PARAMETERS, self._change)
        self.every(1.0, self._report)

    def _make_outlets(self) -> None:
        self.metrics = Outlet(self, DiagnosticArray, "~/metrics", QoSProfile(depth=100))
        self.plots = {name: Outlet(self, Float64, topic, QoSProfile(depth=100)) for name, topic in (
            ("rmse_reference_px", "~/rmse_px"), ("rmsd_reference", "~/rmsd"),
            ("displacement_reference_px", "~/displacement_px"))}

    def on_compiling(self, so_far: Compilation) -> None:
        self.status.waiting_for = f"kernels to be compiled, {so_far.done} of {so_far.total} are"

    def prepare(self) -> None:
        compile_kernels()  # done already, unless somebody else's process spins this node
        self.every(_LOOK_NS / SECOND_NS, self._look)
        self._look()

    def _open_inputs(self) -> None:
        self._subscribe(_IMAGE, Image, self._on_image)
        self._subscribe(_REFERENCE, Image, self._on_reference, latest_latched)
        # the last one: a tracker that waits for a subscriber of it begins now
        self._subscribe(_HOMOGRAPHY, CameraInfo, self._on_homography)
        self.get_logger().info(f"ready, taking images from {self._inputs[_IMAGE].topic}")

    def _subscribe(self, name: str, msg_class: Any, take: Callable[[bytes], None],
                   choose: Choice = keep_all_offered) -> None:
        def on_message(cdr: bytes, _info: Mapping[str, int]) -> None:
            self._received += 1
            try:
                take(cdr)
            except MessageError as error:
                self._refuse(f"{self._inputs[name].topic}: {error}")

        self._inputs[name] = AdaptiveSubscription(self, msg_class, name, on_message, choose, _FIX)

    def work(self, spinner: Spinner) -> None:
        while not spinner.stopping:
            self._take(spinner)
            if self._backlog and self._may_measure():
                self._measure_one()
            else:
                spinner.once()

    def _take(self, spinner: Spinner) -> None:
        """What waits in the middleware, so much at most that measuring goes on beside it."""
        end, idle = self._received + _TAKEN, 0
        while idle < 2 and not spinner.stopping and self._received < end:
            before = self._received
            spinner.once(0.0)
            idle = idle + 1 if self._received == before else 0

    def _on_image(self, cdr: bytes) -> None:
        frame = without_colour(read_image(cdr, IMAGE))
        self._frame_id = frame.frame_id
        self.status.on_alive(self.free.ns)
        self._pairing.expect_homography = self.count_publishers(self._inputs[_HOMOGRAPHY].topic) > 0
        self._queue(self._pairing.image(frame))

    def _on_homography(self, cdr: bytes) -> None:
        stamp_ns, ref_H_cur = read_homography(cdr)
        if ref_H_cur is None:
            self.status.on_alive(self.free.ns)
        self._queue(self._pairing.homography(stamp_ns, ref_H_cur, read_size(cdr)))

    def _on_reference(self, cdr: bytes) -> None:
        self._backlog.add_reference(without_colour(read_image(cdr, IMAGE)), time.monotonic_ns(),
                                    at_once=self.evaluator.reference is None)

    def _queue(self, arrivals: list[Arrival]) -> None:
        now_ns, waiting = time.monotonic_ns(), self._pairing
        if arrivals or (waiting.homographies_waiting <= 2 and waiting.pictures_waiting <= 1):
            self._moved_ns = self.free.ns
        for arrival in arrivals:
            self.status.on_frame(arrival)
            for skipped in self._backlog.add(arrival, now_ns):
                self.status.on_skipped(skipped, now_ns)

    def _may_measure(self) -> bool:
        """The first picture waits a little for the reference: whoever joins later gets it latched."""
        first = self._backlog.first
        if not (self._awaits_reference and isinstance(first, Arrival) and first.frame is not None):
            return True
        if self._waits_since_ns is None:
            self._waits_since_ns = self.free.ns
        limit_ns = _REFERENCE_LIMIT_NS if self._inputs[_REFERENCE].publishers else _DISCOVERY_NS
        self._awaits_reference = self.free.ns - self._waits_since_ns < limit_ns
        return not self._awaits_reference

    def _measure_one(self) -> None:
        self._overran |= self._backlog.crowded
        item = self._backlog.pop()
        try:
            if isinstance(item, Frame):
                self._awaits_reference = False
                self.evaluator.use_reference(item)
            else:
                self._publish(self._measured(item))
        except InputError as error:
            self.status.on_refused(Level.ERROR, f"nothing can be measured: {error}", time.monotonic_ns())
            self.get_logger().error(f"nothing can be measured: {error}", throttle_duration_sec=_WARN_EVERY_S)
        if self._overran and not self._backlog:
            self._overran = False
            give_back_memory()  # the room of hundreds of pictures
        self._alarm()

    def _measured(self, arrival: Arrival) -> FrameMetrics:
        check, due = not self._backlog.crowded, self.evaluator.check_is_due
        metrics = self.evaluator.step(arrival, check)
        if due and not check and metrics.outcome is Outcome.MEASURED:
            self.status.on_check_skipped(arrival, time.monotonic_ns())
        return metrics

    def _publish(self, metrics: FrameMetrics) -> None:
        header = Header(metrics.stamp_ns, self._frame_id)
        self.metrics.send(metrics_cdr(metrics, [point.name for point in self.evaluator.points], header))
        for name, outlet in self.plots.items():
            value = metrics[name]
            if value is not None:
                outlet.send(float64_cdr(value))
        self.status.on_metrics(metrics, findings(metrics, self.evaluator.config), time.monotonic_ns())

    def _refuse(self, text: str) -> None:
        """A message that is not what it claims to be."""
        self.status.on_refused(Level.WARN, f"refused a message: {text}", time.monotonic_ns())
        self.get_logger().warning(f"refused a message: {text}", throttle_duration_sec=_WARN_EVERY_S)

    def _change(self, changed: dict[str, Value]) -> None:
        values = {**self.values, **changed}
        self.evaluator.reconfigure(evaluator_config(values))
        self.values = values

    def _look(self) -> None:
        """Follows the publishers, gives up waiting for what was lost, and sees whether the stream stands."""
        self.free.ticked(_LOOK_NS)
        if not self._inputs and self.metrics.subscribers >= self.settings.wait_for_subscribers:
            self._open_inputs()
        for one in self._inputs.values():
            one.refresh()
        if self._waits_in_vain():
            self._queue(self._pairing.flush())
        self.status.waiting_for = self._awaited()
        self._alarm()

    def _waits_in_vain(self) -> bool:
        """Whether the other half of a frame should have come by now; a single one waits for a slow tracker's warp."""
        waited_ns = self.free.ns - self._moved_ns
        if self._pairing.pictures_waiting and waited_ns > _HOMOGRAPHY_LIMIT_NS:
            return True
        return self._pairing.homographies_waiting >= 2 and waited_ns > _PICTURE_LIMIT_NS

    def _awaited(self) -> str:
        if not self._inputs:
            return f"{self.settings.wait_for_subscribers} subscribers of {self.metrics.topic}"
        images = self._inputs[_IMAGE]
        return f"images on {images.topic}" + ("" if images.publishers else ", nobody publishes it")

    def _alarm(self) -> None:
        """Reports at once when it has become worse."""
        now_ns = time.monotonic_ns()
        if self.status.level(now_ns, self._backlog.delay_ns(now_ns), self.free.ns) > self._told_level:
            self._report()

    def _report(self) -> None:
        now_ns = time.monotonic_ns()
        report = self.status.report(now_ns, self._backlog.delay_ns(now_ns), self.free.ns)
        self._told_level = report.level
        self.report(report.level, report.message, report.values)
