"""Work in the background: waiting that Ctrl-C can end, and awaiting in asyncio."""

from __future__ import annotations

import asyncio
import ctypes as c
import time
from collections.abc import Callable, Generator
from typing import Any, Generic, TypeVar

from . import _abi
from ._callbacks import WAKE, Entry, Listeners, wait_at_exit
from ._enums import State
from ._errors import Error
from ._handles import Handle, Reference
from ._library import failure, lib
from ._values import Progress

T = TypeVar("T")

SLICE_MS = 50
"""Longest time in C, in milliseconds, before Python can handle a signal."""


def read_progress(call: Callable[[Any], Any]) -> tuple[Progress, Error | None]:
    """Calls a poll or wait. Returns the progress, and the failure if the work failed or was cancelled."""
    struct = _abi.oc_progress()
    call(c.byref(struct))
    wrong = failure(struct.error) if struct.state in (State.FAILED, State.CANCELLED) else None
    return Progress._from_c(struct), wrong


def wait_in_slices(wait: Callable[[int, Any], Any], cancel: Callable[[], Any], timeout: float | None,
                   report: Callable[[float], object] | None) -> Progress:
    """Waits for work to end. Any exception meanwhile, e.g. KeyboardInterrupt, cancels the work."""
    end = None if timeout is None else time.monotonic() + timeout
    try:
        while True:
            left = SLICE_MS if end is None else max(0, min(SLICE_MS, int((end - time.monotonic()) * 1000)))
            progress, wrong = read_progress(lambda out: wait(left, out))
            if wrong is not None:
                raise wrong
            if report is not None:
                report(progress.fraction)
            if progress.state != State.RUNNING or (end is not None and time.monotonic() >= end):
                return progress
    except Error:
        raise
    except BaseException:
        cancel()
        wait(_abi.OC_FOREVER, None)
        raise


async def awaited(listen: Callable[[Callable[[], None]], None], cancel: Callable[[], Any]) -> None:
    """Suspends the task until the listener is called. The cancellation of the task cancels the work."""
    loop = asyncio.get_running_loop()
    future: asyncio.Future[None] = loop.create_future()

    def done() -> None:
        if not future.done():
            future.set_result(None)

    def wake() -> None:
        try:
            loop.call_soon_threadsafe(done)
        except RuntimeError:  # the loop is closed
            pass

    listen(wake)
    try:
        await future
    except asyncio.CancelledError:
        cancel()
        raise


_ending: list[Any] = []


def release_job(job: Any) -> None:
    """Releases a job. One that still runs is cancelled, and released after its end.

    Its thread calls back meanwhile: the end of the interpreter must wait for it.
    """
    try:
        lib.oc_job_cancel(job)
    except Error:  # of the parent process, or poisoned
        lib.oc_job_release(job)
        return
    _ending.append(job)
    release_ended(0)


def release_ended(seconds: float) -> None:
    """Releases the jobs that have ended. Waits for the others for so many seconds at most."""
    end = time.monotonic() + seconds
    for _ in range(len(_ending)):
        try:
            job = _ending.pop(0)
        except IndexError:  # another thread was faster
            return
        progress = _abi.oc_progress()
        try:
            # In a context without threads the wait does the work, which ends at once.
            lib.oc_job_wait(job, max(0, int((end - time.monotonic()) * 1000)), c.byref(progress))
        except Error:
            pass
        if progress.state == State.RUNNING:
            _ending.append(job)
        else:
            lib.oc_job_release(job)


wait_at_exit(release_ended)


class Job(Handle, Generic[T]):
    """Work in flight: a build, a load, a batch of rays or a prefetch. `await` it, or call `result()`.

    Closing it cancels the work.
    """

    _kind = "Job"
    _release = lib.oc_job_release  # of a batch: it waits until no thread uses the arrays

    def __init__(self, address: int | None, made_from: Reference, finish: Callable[[Reference, Progress], T],
                 keep: Any = None) -> None:
        super().__init__(address, made_from)
        self._h.keep.append(keep)
        self._finish = finish
        self._listeners = Listeners()
        self._entry: Entry | None = None

    def poll(self) -> Progress:
        """Returns the progress. Does not raise if the job has failed: see its `state` and `error`."""
        return read_progress(lambda out: lib.oc_job_poll(self._h, out))[0]

    def wait(self, timeout: float | None = None, progress: Callable[[float], object] | None = None) -> Progress:
        """Waits until the job has ended, or for `timeout` seconds; the state is then RUNNING.

        `progress` is called about 20 times a second with the share that is done, 0 to 1. Ctrl-C cancels the job and
        raises KeyboardInterrupt. In a context without threads, this call does the work.

        Raises:
            Cancelled: the job was cancelled.
            Error: the job failed.
        """
        job = self._h
        return wait_in_slices(lambda ms, out: lib.oc_job_wait(job, ms, out), lambda: lib.oc_job_cancel(job), timeout,
                              progress)

    def result(self, progress: Callable[[float], object] | None = None) -> T:
        """Waits until the job has ended. Returns its result."""
        return self._finish(self._h, self.wait(progress=progress))

    @property
    def done(self) -> bool:
        """True if the job has ended in any way."""
        return self.poll().state != State.RUNNING

    def cancel(self) -> None:
        """Asks the job to end. It ends within about 100 ms. A job that has ended does not change."""
        lib.oc_job_cancel(self._h)

    def on_end(self, listener: Callable[[], object]) -> None:
        """Calls the function once when the job ends, from any thread; at once if it has ended already.

        The function must return soon and must not wait. An event loop's `call_soon_threadsafe` is a good one.
        """
        if self._entry is None:
            self._entry = Entry(self._listeners.wake)
            self._h.keep.append(self._entry)
        self._listeners.add_once(listener)
        lib.oc_job_set_wake(self._h, WAKE, self._entry.key)

    async def _awaited(self) -> T:
        await awaited(self.on_end, self.cancel)
        return self.result()

    def __await__(self) -> Generator[Any, None, T]:
        return self._awaited().__await__()
