"""Signals and errors of the process of a node."""

from __future__ import annotations

import signal
from collections.abc import Iterator

import pytest

from stab_ros.core.errors import InputError, WorkError
from stab_ros.nodes.stopping import StopRequest, node_main, until_stopped


@pytest.fixture
def handlers() -> Iterator[None]:
    """Puts the test runner's own signal handlers back."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.usefixtures("handlers")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_signals_interrupt_the_start_but_not_the_work(number: int) -> None:
    finished: list[bool] = []

    def start(_stop: StopRequest) -> int:
        signal.raise_signal(number)
        raise AssertionError("the start was not interrupted")

    def work(stop: StopRequest) -> int:
        stop.defer()
        signal.raise_signal(number)
        signal.raise_signal(number)
        finished.append(stop.requested)
        return 5

    signal.signal(number, signal.SIG_DFL)  # as in a new process, not under nohup
    assert until_stopped(start) == 0
    signal.signal(number, signal.SIG_DFL)
    assert until_stopped(work) == 5
    assert finished == [True]
    signal.raise_signal(number)  # has no effect any more


@pytest.mark.usefixtures("handlers")
def test_under_nohup_a_lost_terminal_is_nothing() -> None:
    signal.signal(signal.SIGHUP, signal.SIG_IGN)

    def work(stop: StopRequest) -> int:
        signal.raise_signal(signal.SIGHUP)
        return 5 if not stop.requested else 6

    assert until_stopped(work) == 5


@pytest.mark.usefixtures("handlers")
@pytest.mark.parametrize(("error", "code"), [(InputError("bag: missing"), 2), (WorkError("disk full"), 1)])
def test_errors_are_one_line(error: Exception, code: int, capsys: pytest.CaptureFixture[str]) -> None:
    def fail(_stop: StopRequest) -> int:
        raise error

    assert node_main("some_node", fail) == code
    assert capsys.readouterr().err == f"some_node: {error}\n"
