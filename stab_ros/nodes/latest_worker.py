"""A thread that works on the newest item only, so that slow work never holds up who gives it."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from threading import Condition, Thread
from typing import Generic, TypeVar

Item = TypeVar("Item")


class LatestWorker(Generic[Item]):
    """work: is called with one item at a time. guard: entered around each call; what it lets pass ends the thread.

    keep_all: `put` waits until the item before has been begun, so that none is lost; else that gives way.
    """

    def __init__(self, work: Callable[[Item], None], guard: AbstractContextManager[object, bool | None],
                 keep_all: bool = False) -> None:
        self._work, self._guard, self._keep_all = work, guard, keep_all
        self._waiting: list[Item] = []  # one at most
        self._busy = self._closed = False
        self._changed = Condition()
        self._thread: Thread | None = None  # only once there is work

    def put(self, item: Item) -> None:
        """The item to be worked on next."""
        with self._changed:
            if self._thread is None:
                self._thread = Thread(target=self._run, name="latest_worker", daemon=True)
                self._thread.start()
            if self._keep_all:
                self._changed.wait_for(lambda: not self._waiting or self._closed)
            self._waiting[:] = [item]
            self._changed.notify_all()

    def flush(self) -> None:
        """Waits until all that was put is done."""
        with self._changed:
            self._changed.wait_for(lambda: self._closed or not (self._waiting or self._busy))

    def close(self) -> None:
        """Ends the thread after the item it works on."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        if self._thread is not None:
            self._thread.join()

    def _run(self) -> None:
        try:
            while (item := self._next()) is not None:
                with self._guard:
                    self._work(item)
        finally:  # what the guard lets pass ends the thread: nobody must wait for it
            with self._changed:
                self._closed = True
                self._changed.notify_all()

    def _next(self) -> Item | None:
        """Waits for an item; None: closed."""
        with self._changed:
            self._busy = False
            self._changed.notify_all()
            self._changed.wait_for(lambda: self._waiting or self._closed)
            if self._closed:
                return None
            self._busy = True
            item = self._waiting.pop()
            self._changed.notify_all()
            return item
