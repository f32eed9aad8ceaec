"""The live evaluator: the ROS side of `Evaluator`, with the same engine and pairing as the command `evaluate`."""

from __future__ import annotations

import time
from dataclasses import fields
from typing import TYPE_CHECKING, Any

from stab_ros.core.errors import InputError
from stab_ros.core.kernels import Compilation
from stab_ros.core.memory import give_back_memory
from stab_ros.core.settings import Value
from stab_ros.core.text import counted
from stab_ros.core.types import Frame, Homography
from stab_ros.evaluation.evaluator import Arrival, Evaluator
from stab_ros.evaluation.findings import Level, findings
from stab_ros.evaluation.frame_metrics import FrameMetrics, Outcome
from stab_ros.evaluation.pairing import Pairing
from stab_ros.io.cdr import SECOND_NS, Header
from stab_ros.io.regions import read_area
from stab_ros.nodes import params
from stab_ros.nodes.backlog import Backlog
from stab_ros.nodes.evaluator_inputs import EvaluatorInputs
from stab_ros.nodes.evaluator_publishers import EvaluatorPublishers
from stab_ros.nodes.evaluator_status import EvaluatorStatus
from stab_ros.nodes.failures import Failures
from stab_ros.nodes.managed_node import StabNode
from stab_ros.nodes.spinner import Spinner
from stab_ros.parameters.engines import make_evaluator
from stab_ros.parameters.node_settings import EvaluatorSettings
from stab_ros.parameters.table import EVALUATOR_PARAMETERS, evaluator_config

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from stab_ros.nodes.node_options import NodeOptions

_LOG_EVERY_S = 5.0
_BURST = 50  # messages at most that are taken before a frame is measured
# Limits of waits, in free time: with no message to take and no frame to measure
_REFERENCE_LIMIT_NS = 4 * SECOND_NS  # for the reference, if somebody publishes references
_DISCOVERY_NS = SECOND_NS // 2  # for the discovery of a publisher of references
_IMAGE_LIMIT_NS = SECOND_NS  # for an image, once the next frame's homography has arrived
_HOMOGRAPHY_LIMIT_NS = 4 * SECOND_NS  # what Fast DDS lost comes again after 3 s, unless a profile says otherwise


SETTINGS = params.table_of(EvaluatorSettings)
# what was prepared from the reference stays as it is, but for regions, with which it is prepared anew
_PREPARED = {"points", "window_px", "svf_columns", "svf_rows", "points_file"}
_REGIONS = {"roi", "exclude"}
CHANGEABLE = frozenset(EVALUATOR_PARAMETERS) - _PREPARED


class EvaluatorNode(StabNode):
    """Takes all messages that arrive, and measures one frame after the other."""

    COMPUTES = True
    COMPOSABLE = False

    def __init__(self, **options: Unpack[NodeOptions]) -> None:
        super().__init__("evaluator_node", **options)

    # lifecycle and main loop -----------------------------------------------------------------------------------------
    def configure(self) -> None:
        values = params.declare(self, {**EVALUATOR_PARAMETERS, **SETTINGS}, CHANGEABLE)
        params.warn_of_unknown(self, values)
        chosen: Any = {item.name: values.pop(item.name) for item in fields(EvaluatorSettings)}
        self.settings = EvaluatorSettings(**chosen)
        self.values = values
        self.evaluator: Evaluator = make_evaluator(values)
        self.status = EvaluatorStatus(*(round(seconds * SECOND_NS) for seconds in (
            self.settings.window_s, self.settings.alarm_s, self.settings.stale_s)))
        limit_bytes = round(self.settings.backlog_mb * 1e6)
        self._backlog, self._pairing = Backlog(limit_bytes), Pairing(False, limit_bytes)
        self._inputs: EvaluatorInputs | None = None
        self._failures = Failures(self.get_logger())
        self._overran = False  # the backlog has been more than half full
        self._progress_ns = 0  # free time when the pairing last released a frame, or began to wait
        self._awaits_reference = True
        self._waits_since_ns: int | None = None  # free time when the first image began to wait for the reference
        self._frame_id = ""
        self._reported_level = 0
        self.outputs = EvaluatorPublishers(self)
        self.at_cleanup(params.ParameterUpdates(self, EVALUATOR_PARAMETERS, self._change).close)

    def on_compilation(self, progress: Compilation) -> None:
        self.status.waiting_for = progress.awaited

    def deactivate(self) -> None:
        """Measures the frames that wait; the reference stays."""
        if self._inputs is not None:
            self._inputs.close()
            self._inputs = None
        self.status.suspend()
        self._queue(self._pairing.flush())
        while self._backlog:
            self._measure_one()

    def work(self, spinner: Spinner) -> None:
        while not spinner.stopping:
            self._take(spinner)
            if self.is_active and self._backlog and self._may_measure():
                self._measure_one()
            else:
                spinner.once()

    def _take(self, spinner: Spinner) -> None:
        """Takes the messages that wait in the middleware, but not so many that measuring would starve."""
        end, idle = self._received + _BURST, 0
        while idle < 2 and not spinner.stopping and self._received < end:
            before = self._received
            spinner.once(0.0)
            idle = idle + 1 if self._received == before else 0

    @property
    def _received(self) -> int:
        return self._inputs.received if self.is_active and self._inputs is not None else 0

    def poll(self) -> None:
        """Follows the publishers, gives up waiting for lost messages, and checks whether the stream has stopped."""
        if self._inputs is None and self.outputs.metrics.subscribers >= self.settings.wait_for_subscribers:
            self._inputs = EvaluatorInputs(self, self)
            self.tell(f"ready, taking images from {self._inputs.image.topic}")
        if self._inputs is not None:
            self._inputs.refresh()
        if self._waits_in_vain():
            self._queue(self._pairing.flush())
        self.status.waiting_for = self._awaited()
        self._alarm()

    def _waits_in_vain(self) -> bool:
        """Whether the other half of a frame should have come by now; a single one waits for a slow tracker's warp."""
        waited_ns = self.free.ns - self._progress_ns
        if self._pairing.pictures_waiting and waited_ns > _HOMOGRAPHY_LIMIT_NS:
            return True
        return self._pairing.homographies_waiting >= 2 and waited_ns > _IMAGE_LIMIT_NS

    def _awaited(self) -> str:
        if self._inputs is None:
            return f"{counted(self.settings.wait_for_subscribers, 'subscriber')} of {self.outputs.metrics.topic}"
        images = self._inputs.image
        return f"images on {images.topic}" + ("" if images.publishers else ", nobody publishes it")

    # input -----------------------------------------------------------------------------------------------------------
    def on_image(self, frame: Frame) -> None:
        """See `EvaluatorCallbacks`."""
        self._frame_id = frame.frame_id
        self.status.on_alive(self.free.ns)
        if self._inputs is not None:
            self._pairing.expect_homography = self.count_publishers(self._inputs.homography.topic) > 0
        self._queue(self._pairing.image(frame))

    def on_homography(self, stamp_ns: int, ref_H_cur: Homography | None, size: tuple[int, int] | None) -> None:
        """See `EvaluatorCallbacks`."""
        if ref_H_cur is None:
            self.status.on_alive(self.free.ns)
        self._queue(self._pairing.homography(stamp_ns, ref_H_cur, size))

    def on_reference(self, frame: Frame) -> None:
        """See `EvaluatorCallbacks`."""
        self._backlog.add_reference(frame, time.monotonic_ns(), at_once=self.evaluator.reference is None)

    def on_refused(self, text: str) -> None:
        """See `EvaluatorCallbacks`."""
        self.status.on_refused(Level.WARN, f"refused a message: {text}", time.monotonic_ns())
        self.get_logger().warning(f"refused a message: {text}", throttle_duration_sec=_LOG_EVERY_S)

    def _queue(self, arrivals: list[Arrival]) -> None:
        now_ns, waiting = time.monotonic_ns(), self._pairing
        if arrivals or (waiting.homographies_waiting <= 2 and waiting.pictures_waiting <= 1):
            self._progress_ns = self.free.ns
        for arrival in arrivals:
            self.status.on_frame(arrival)
            for skipped in self._backlog.add(arrival, now_ns):
                self.status.on_skipped(skipped, now_ns)

    # measuring -------------------------------------------------------------------------------------------------------
    def _may_measure(self) -> bool:
        """The first image waits for the reference, which arrives latched if the evaluator joins later."""
        first = self._backlog.first
        if not (self._awaits_reference and isinstance(first, Arrival) and first.frame is not None):
            return True
        if self._waits_since_ns is None:
            self._waits_since_ns = self.free.ns
        is_published = self._inputs is not None and self._inputs.reference.publishers
        limit_ns = _REFERENCE_LIMIT_NS if is_published else _DISCOVERY_NS
        self._awaits_reference = self.free.ns - self._waits_since_ns < limit_ns
        return not self._awaits_reference

    def _measure_one(self) -> None:
        self._overran |= self._backlog.crowded
        item, errors = self._backlog.pop(), self._failures.count
        try:
            with self._failures:
                self._take_up(item)
        except InputError as error:
            self.status.on_refused(Level.ERROR, f"nothing can be measured: {error}", time.monotonic_ns())
            self.get_logger().error(f"nothing can be measured: {error}", throttle_duration_sec=_LOG_EVERY_S)
        if self._failures.count > errors:
            self.status.on_failure(self._failures.count, self._failures.last, time.monotonic_ns())
        if self._overran and not self._backlog:
            self._overran = False
            give_back_memory()  # of hundreds of images
        self._alarm()

    def _take_up(self, item: Arrival | Frame) -> None:
        """Measures a frame, or against another reference from now on."""
        if isinstance(item, Frame):
            self._awaits_reference = False
            self.evaluator.use_reference(item)
        else:
            self._publish(self._measured(item))

    def on_failure(self, error: BaseException) -> None:
        if not isinstance(error, Exception):
            raise error
        self._failures.note(error)
        self.status.on_failure(self._failures.count, self._failures.last, time.monotonic_ns())

    def _measured(self, arrival: Arrival) -> FrameMetrics:
        check, due = not self._backlog.crowded, self.evaluator.check_is_due
        metrics = self.evaluator.step(arrival, check)
        if due and not check and metrics.outcome is Outcome.MEASURED:
            self.status.on_check_skipped(arrival, time.monotonic_ns())
        return metrics

    # output ----------------------------------------------------------------------------------------------------------
    def _publish(self, metrics: FrameMetrics) -> None:
        header = Header(metrics.stamp_ns, self._frame_id)
        self.outputs.send(metrics, [point.name for point in self.evaluator.points], header)
        self.status.on_metrics(metrics, findings(metrics, self.evaluator.config), time.monotonic_ns())

    def _alarm(self) -> None:
        """Reports at once if the level has risen."""
        now_ns = time.monotonic_ns()
        if self.status.level(now_ns, self._backlog.delay_ns(now_ns), self.free.ns) > self._reported_level:
            self.report()

    def report(self) -> None:
        now_ns = time.monotonic_ns()
        status = self.status.report(now_ns, self._backlog.delay_ns(now_ns), self.free.ns)
        self._reported_level = status.level
        self.publish_diagnostics(status)

    def _change(self, changed: dict[str, Value]) -> None:
        values = {**self.values, **changed}
        config = evaluator_config(values)
        if changed.keys() & _REGIONS:
            self.evaluator.change_area(read_area(values))
        self.evaluator.reconfigure(config)
        self.values = values
