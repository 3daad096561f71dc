"""Who works off the cells: this process, a pool of processes, or a Dask cluster, all as ``concurrent.futures``.

In the pool and on Dask a call runs in a child (:mod:`bodyimage_kin.study.calls`). What a step prints goes to its log.
"""

from __future__ import annotations

import abc
import contextlib
import functools
import io
import os
import queue
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Executor, Future
from contextlib import contextmanager
from pathlib import Path
from typing import Any, cast

from bodyimage_kin._checks import whole
from bodyimage_kin.errors import BodyImageKinError, InvalidConfig, MissingDependency
from bodyimage_kin.study.calls import Call, Child, Step, here, in_child, run

__all__ = [
    "ExecutorLost",
    "InProcess",
    "KillablePool",
    "OnDask",
    "Others",
    "Ours",
    "executor",
    "was_lost",
]


class ExecutorLost(BodyImageKinError):
    """Whoever worked is gone, again and again; nothing a task is to blame for."""


def was_lost(problem: BaseException) -> bool:
    """Whether an error means that whoever worked is gone, for no fault of the task."""
    return isinstance(problem, CancelledError) or type(problem).__module__.partition(".")[0] in ("distributed", "dask")


class Ours(Executor, abc.ABC):
    """An executor that takes calls."""

    @abc.abstractmethod
    def hand_out(self, call: Call) -> Future[Any]:
        """A call that begins as soon as somebody is free."""

    def submit(self, work: Callable[..., Any], /, *arguments: Any, **keywords: Any) -> Future[Any]:
        """Without a time limit. See :meth:`concurrent.futures.Executor.submit`."""
        return self.hand_out(Call(functools.partial(work, **keywords), arguments))

    @property
    def room(self) -> int:
        """How many calls may wait at once, so that nobody waits for work."""
        return 256

    @property
    def gone(self) -> bool:
        """Whether nobody will ever answer."""
        return False


class Others(Ours):
    """An executor of others: nothing can be killed there, so a call is given up once its time is over.

    Args:
        executor: Who works.
    """

    def __init__(self, executor: Executor) -> None:
        self._executor = executor

    def hand_out(self, call: Call) -> Future[Any]:
        """See :class:`Ours`."""
        return self._executor.submit(here, call)


class OnDask(Ours):
    """Works on a Dask cluster, each call in a child of a worker.

    Args:
        client: Of the cluster.
    """

    def __init__(self, client: Any) -> None:
        self._client, self._executor = client, client.get_executor(pure=False)
        # Twice as many as work when the run begins, and enough for a cluster that grows meanwhile.
        self._room = max(256, 2 * sum(client.nthreads().values()))

    @property
    def room(self) -> int:
        """See :class:`Ours`."""
        return self._room

    def hand_out(self, call: Call) -> Future[Any]:
        """See :class:`Ours`."""
        return self._executor.submit(in_child, call)

    @property
    def gone(self) -> bool:
        """Whether the scheduler is lost: what waits for it then waits for ever."""
        return self._client.status in ("closing", "closed")


class InProcess(Ours):
    """Works at once, in this process."""

    room = 1

    def hand_out(self, call: Call) -> Future[Any]:
        """A call that is done when this returns."""
        future: Future[Any] = Future()
        with _Printed() as printed:
            try:
                if call.limit is not None or call.prepare is not None:
                    said = here(call, printed.into)
                else:
                    for said in run(call):
                        printed.into(said)
                future.set_result(said)
            except Exception as problem:
                future.set_exception(problem)
        return future


class KillablePool(Ours):
    """Processes, each of which can be killed without harm to the others.

    Args:
        workers: Number of processes; None: one a processor.
    """

    def __init__(self, workers: int | None = None) -> None:
        count = (os.cpu_count() or 1) if workers is None else whole("workers", workers, least=1)
        self.workers = count
        self._jobs: queue.SimpleQueue[tuple[Future[Any], Call] | None] = queue.SimpleQueue()
        self._children: set[Child] = set()
        self._threads = [threading.Thread(target=self._serve, daemon=True) for _ in range(count)]
        for thread in self._threads:
            thread.start()

    @property
    def room(self) -> int:
        """How many calls may wait at once: one at work and one at hand for each process, and one more."""
        return 2 * self.workers + 1

    def hand_out(self, call: Call) -> Future[Any]:
        """A call that begins as soon as a process is free."""
        future: Future[Any] = Future()
        self._jobs.put((future, call))
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Ends the processes once they are done. See :meth:`concurrent.futures.Executor.shutdown`."""
        while cancel_futures:
            try:
                job = self._jobs.get_nowait()
            except queue.Empty:
                break
            if job is not None:
                job[0].cancel()
        for _ in self._threads:
            self._jobs.put(None)
        for thread in self._threads if wait else ():
            thread.join()

    def kill(self) -> None:
        """Ends everything at once, whatever is at work."""
        self.shutdown(wait=False, cancel_futures=True)
        for child in list(self._children):
            child.kill()

    def _serve(self) -> None:
        """One thread's life: it has a child, hands it jobs, and replaces it when it dies."""
        child: Child | None = None
        while (job := self._jobs.get()) is not None:
            future, call = job
            if not future.set_running_or_notify_cancel():
                continue
            try:
                if child is not None and call.alone and child.used:
                    self._children.discard(child)
                    child.end()
                    child = None
                if child is None:
                    child = Child()
                    self._children.add(child)
                future.set_result(child.call(call))
            except Exception as problem:
                future.set_exception(problem)
                if child is not None and not child.alive:
                    self._children.discard(child)
                    child = None
        if child is not None:
            self._children.discard(child)
            child.end()


@contextmanager
def executor(chosen: Any = None, workers: int | None = None) -> Iterator[Ours]:
    """The executor that is meant; what is made here is ended here.

    Args:
        chosen: None: a pool of processes; ``"in-process"``; the address of a Dask scheduler, such as
            ``"tcp://host:8786"``; a Dask ``Client``; any :class:`concurrent.futures.Executor`.
        workers: Of the pool; None: one a processor.

    Raises:
        InvalidConfig: None of these.
        MissingDependency: An address, and Dask is not installed.
    """
    if isinstance(chosen, Executor):
        yield chosen if isinstance(chosen, Ours) else Others(chosen)
    elif hasattr(chosen, "get_executor"):
        yield OnDask(chosen)
    elif isinstance(chosen, str) and "://" in chosen:
        with _dask_client(chosen) as client:
            yield OnDask(client)
    elif chosen == "in-process":
        yield InProcess()
    elif chosen is None:
        pool = KillablePool(workers)
        try:
            yield pool
        except BaseException:
            pool.kill()
            raise
        pool.shutdown()
    else:
        raise InvalidConfig(
            f"executor {chosen!r}: give None, 'in-process', a Dask scheduler's address, a Client or an Executor"
        )


# Inner ---------------------------------------------------------------------------------------------------------------


class _Printed:
    """Takes up all that Python prints in this process; what was printed in a step goes to its log."""

    def __init__(self) -> None:
        self._said, self._log, self._stack = io.StringIO(), "", contextlib.ExitStack()

    def __enter__(self) -> _Printed:
        self._redirect()
        return self

    def __exit__(self, *problem: object) -> None:
        self.into(None)
        self._stack.close()

    def into(self, said: Any) -> None:
        """Begins a step."""
        text = "" if self._said.closed else self._said.getvalue()
        if text and self._log:
            with contextlib.suppress(OSError):
                Path(self._log).parent.mkdir(parents=True, exist_ok=True)
                with Path(self._log).open("a", encoding="utf-8", errors="backslashreplace") as file:
                    file.write(text)
        if text or self._said.closed:
            self._stack.close()
            self._said = io.StringIO()
            self._redirect()
        self._log = (said.log or "") if isinstance(said, Step) else ""

    def _redirect(self) -> None:
        self._stack.enter_context(contextlib.redirect_stdout(self._said))
        self._stack.enter_context(contextlib.redirect_stderr(self._said))


@contextmanager
def _dask_client(address: str) -> Iterator[Any]:
    try:
        from distributed import Client
    except ImportError:
        raise MissingDependency(
            "a Dask scheduler needs the package distributed; pip install 'bodyimage-kin[dask]'"
        ) from None
    try:
        client: Any = cast(Any, Client)(address, timeout=10)
    except (OSError, ValueError) as problem:
        raise InvalidConfig(f"no Dask scheduler answers at {address!r}: {problem}") from None
    with client:
        yield client
