"""Header stamps of a stream against the times at which its messages were published and logged.

Only a disagreement that no delay explains is a fault: messages are logged in bursts, whole queues late, and a camera's
clock may run hours apart. So the usual step of the stamps is compared with the median and with the mean step of each
other clock, and must differ from all of them. Stamps of zero, and those that go back, are a fault in any case.
"""

from __future__ import annotations

from array import array

import numpy as np

from stab_ros.core.text import are
from stab_ros.core.types import FloatArray
from stab_ros.io.cdr import SECOND_NS

_LEAST_STEPS = 8
_FACTOR = 3.0  # between the steps; slow simulations and replays, whose stamps are right, mostly stay below
_FASTEST_S = 0.004  # a mean step below is none of a camera: the times are those of a conversion
_JUMP_S = 60.0  # no queue is that long
_AROUND = 30  # steps before and after a jump
_ONE_IN = {1e3: ("microseconds", 1_000_000), 1e6: ("milliseconds", 1_000)}  # by factor: the unit; nanosec lies below


class StampCheck:
    """Follows the images of one stream, in the order in which they are taken.

    factor: between the usual step of the header stamps and those of the other clocks, that is a fault.
    log: what the log times are called.
    """

    def __init__(self, factor: float = _FACTOR, log: str = "the log") -> None:
        self._factor, self._log = factor, log
        self._last_ns: tuple[int, int, int] | None = None
        self._steps_s = (array("d"), array("d"), array("d"))  # of header stamps, publish times and log times
        self._images = self._zero = 0
        self._most_nanosec = 0

    def add(self, stamp_ns: int, publish_time_ns: int, log_time_ns: int) -> None:
        """Takes the next image."""
        self._images += 1
        if stamp_ns == 0:
            self._zero += 1
            return
        times_ns = stamp_ns, publish_time_ns, log_time_ns
        if self._last_ns is not None:
            for steps_s, now_ns, before_ns in zip(self._steps_s, times_ns, self._last_ns, strict=True):
                steps_s.append((now_ns - before_ns) / SECOND_NS)
        self._last_ns = times_ns
        self._most_nanosec = max(self._most_nanosec, stamp_ns % SECOND_NS)

    def fault(self) -> str:
        """What is wrong with the stamps, as a sentence without its end; "" if nothing is."""
        some_zero = self._images > 1 and self._zero > 0
        zero = f"{self._zero} of {self._images} header stamps {are(self._zero)} zero" if some_zero else ""
        stamps_s, clocks = self._steps()
        others = _jumps(stamps_s, list(clocks.values())) or self.rate_fault()
        return " and ".join(filter(None, (zero, others)))

    def _steps(self) -> tuple[FloatArray, dict[str, FloatArray]]:
        """The steps of the header stamps, and of every other clock that tells anything."""
        stamps_s, published_s, logged_s = (np.array(steps_s) for steps_s in self._steps_s)
        clocks = {self._log: logged_s, "publish times": published_s}
        if np.array_equal(published_s, logged_s):
            del clocks["publish times"]
        return stamps_s, {name: steps_s for name, steps_s in clocks.items()
                          if len(steps_s) and steps_s.mean() >= _FASTEST_S}

    def rate_fault(self) -> str:
        """What is wrong with the usual step, as `fault`."""
        stamps_s, clocks = self._steps()
        if len(stamps_s) < _LEAST_STEPS or not clocks:
            return ""
        usual_s = max(float(np.median(stamps_s)), 0.0)
        spans_s = {name: (float(np.median(steps_s)), _mean_s(steps_s)) for name, steps_s in clocks.items()}
        fast = all(usual_s * self._factor < min(span_s) for span_s in spans_s.values())
        slow = all(usual_s > self._factor * max(span_s) for span_s in spans_s.values())
        if not (fast or slow):
            return ""
        told = {name: min(span_s) if fast else max(span_s) for name, span_s in spans_s.items()}
        others = " and ".join(f"{name} {_ms(step_s)}" for name, step_s in told.items())
        first_s = next(iter(told.values()))
        return f"header stamps say {_ms(usual_s)} between frames, {others}{self._guess(usual_s, first_s)}"

    def _guess(self, usual_s: float, other_s: float) -> str:
        """The factor between the two steps, and what may be its reason."""
        if self._most_nanosec == 0:
            return ": they are whole seconds"
        if usual_s == 0:
            return ": most repeat the one before"
        factor = other_s / usual_s
        for exact, (unit, below) in _ONE_IN.items():
            if abs(factor / exact - 1) < 0.1 and self._most_nanosec < below:
                return f" (factor {exact:.0f}): perhaps {unit} in nanosec"
        return f" (factor {max(factor, 1 / factor):.3g}): perhaps of a simulation, or of a replay at another rate"


def _mean_s(steps_s: FloatArray) -> float:
    """The mean step, if the first images came as late as any: a burst at the start would make it too small."""
    return float((steps_s.sum() + steps_s.max()) / (len(steps_s) + 1))


def _jumps(stamps_s: FloatArray, clocks_s: list[FloatArray]) -> str:
    """Steps that no delay of a message explains, as `StampOrder` has put messages in order."""
    back = [at for at, step_s in enumerate(stamps_s) if step_s < 0]
    far = [at for at, step_s in enumerate(stamps_s) if clocks_s and step_s > _JUMP_S]
    ahead = [at for at in far if all(_leads(stamps_s, steps_s, at) for steps_s in clocks_s)]
    for which, words in ((back, "go back"), (ahead, "jump ahead of the log")):
        if len(which):
            most_s = np.abs(stamps_s[which]).max()
            times = "once, by" if len(which) == 1 else f"{len(which)} times, by up to"
            return f"header stamps {words} {times} {most_s:.6g} s"
    return ""


def _leads(stamps_s: FloatArray, steps_s: FloatArray, at: int) -> bool:
    """Whether the stamps gain on the other clock at this step, and do not give it back before or after."""
    begin, end = max(at - _AROUND, 0), at + _AROUND
    gains_s = np.cumsum(stamps_s[begin:end] - steps_s[begin:end])
    before_s = [0.0, *gains_s[: at - begin]]
    return bool(np.median(gains_s[at - begin :]) - np.median(before_s) > _JUMP_S)


def _ms(step_s: float) -> str:
    return f"{1e3 * step_s:.3g} ms"
