"""Who works off the cells: this process, a pool of processes, or a Dask cluster, all as ``concurrent.futures``.

A cell that outlives its time limit fails alone. The pool kills its process and starts another. In this process and on
Dask nothing can be killed: the cell is given up, its thread runs on without anybody waiting for it, and ends with its
process.
"""

from __future__ import annotations

import multiprocessing
import os
import queue
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any, cast

from bodyimage_kin.errors import BodyImageKinError, InvalidConfig, MissingDependency


class TimeLimitExceeded(Exception):
    """A cell took longer than the study allows."""


class WorkerDied(Exception):
    """The process of a cell ended: a crash, or no memory left."""


class InProcess(Executor):
    """Works at once, in this process."""

    def submit(self, work: Callable[..., Any], /, *arguments: Any, **keywords: Any) -> Future[Any]:
        """Calls and waits. See :meth:`concurrent.futures.Executor.submit`."""
        future: Future[Any] = Future()
        try:
            future.set_result(work(*arguments, **keywords))
        except Exception as problem:
            future.set_exception(problem)
        return future


class KillablePool(Executor):
    """Processes, each of which can be killed without harm to the others.

    The standard pool breaks as a whole when one of its processes dies, and cannot be told to give up a task.

    Args:
        workers: Number of processes; None: one a processor.
    """

    def __init__(self, workers: int | None = None) -> None:
        count = (os.cpu_count() or 1) if workers is None else workers
        if count < 1:
            raise InvalidConfig(f"workers={workers!r}: give a whole number of at least 1")
        self._jobs: queue.SimpleQueue[_Job | None] = queue.SimpleQueue()
        self._threads = [threading.Thread(target=self._serve, daemon=True) for _ in range(count)]
        for thread in self._threads:
            thread.start()

    def submit(self, work: Callable[..., Any], /, *arguments: Any, **keywords: Any) -> Future[Any]:
        """Without a time limit. See :meth:`concurrent.futures.Executor.submit`."""
        return self.submit_within(None, None, work, *arguments, **keywords)

    def submit_within(
        self,
        limit: float | None,
        prepare: Callable[[Any], Any] | None,
        work: Callable[..., Any],
        /,
        *arguments: Any,
        **keywords: Any,
    ) -> Future[Any]:
        """As :meth:`submit`; once ``prepare(first argument)`` is done, the process has ``limit`` seconds to live."""
        job = _Job(Future(), limit, prepare, work, arguments, keywords)
        self._jobs.put(job)
        return job.future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Ends the processes once they are done. See :meth:`concurrent.futures.Executor.shutdown`."""
        while cancel_futures:
            try:
                job = self._jobs.get_nowait()
            except queue.Empty:
                break
            if job is not None:
                job.future.cancel()
        for _ in self._threads:
            self._jobs.put(None)
        for thread in self._threads if wait else ():
            thread.join()

    def _serve(self) -> None:
        """One thread's life: it has a process, hands it jobs, and replaces it when it dies."""
        worker: _Worker | None = None
        while (job := self._jobs.get()) is not None:
            if not job.future.set_running_or_notify_cancel():
                continue
            try:
                worker = worker or _Worker()
                job.future.set_result(worker.call(job))
            except Exception as problem:
                job.future.set_exception(problem)
                if worker is not None and not worker.alive:
                    worker = None
        if worker is not None:
            worker.end()


@contextmanager
def executor(chosen: Any = None, workers: int | None = None) -> Iterator[Executor]:
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
        yield chosen
    elif hasattr(chosen, "get_executor"):
        yield chosen.get_executor(pure=False)
    elif isinstance(chosen, str) and "://" in chosen:
        with _dask_client(chosen) as client:
            yield client.get_executor(pure=False)
    elif chosen == "in-process":
        yield InProcess()
    elif chosen is None:
        pool = KillablePool(workers)
        try:
            yield pool
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
        pool.shutdown()
    else:
        raise InvalidConfig(
            f"executor {chosen!r}: give None, 'in-process', a Dask scheduler's address, a Client or an Executor"
        )


def submit(
    executor: Executor,
    limit: float | None,
    prepare: Callable[[Any], Any] | None,
    work: Callable[..., Any],
    *arguments: Any,
) -> Future[Any]:
    """Hands out work that may take ``limit`` seconds; the future then raises :class:`TimeLimitExceeded`.

    Args:
        executor: Who works.
        limit: [s]; None: any time.
        prepare: Called with the first argument before the time begins to run.
        work: Called with all arguments.
        arguments: What it is called with.
    """
    if isinstance(executor, KillablePool):
        return executor.submit_within(limit, prepare, work, *arguments)
    return executor.submit(within, limit, prepare, work, *arguments)


def within(limit: float | None, prepare: Callable[[Any], Any] | None, work: Callable[..., Any], *arguments: Any) -> Any:
    """Calls, and gives up after ``limit`` seconds. See :func:`submit`.

    Raises:
        TimeLimitExceeded: It took longer. The thread that works is left behind.
    """
    if prepare is not None:
        prepare(arguments[0])
    if limit is None:
        return work(*arguments)
    future: Future[Any] = Future()

    def call() -> None:
        try:
            future.set_result(work(*arguments))
        except BaseException as problem:
            future.set_exception(problem)

    threading.Thread(target=call, daemon=True).start()
    try:
        return future.result(limit)
    except TimeoutError:
        if future.done():
            raise
        raise TimeLimitExceeded(_too_long(limit)) from None


# Inner ---------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Job:
    """Something to do, and what is waiting for it."""

    future: Future[Any]
    limit: float | None
    prepare: Callable[[Any], Any] | None
    work: Callable[..., Any]
    arguments: tuple[Any, ...]
    keywords: dict[str, Any]


class _Worker:
    """A process that does one job after the other."""

    def __init__(self) -> None:
        # Forked children would inherit torch's threads in whatever state they are.
        context = multiprocessing.get_context("spawn")
        self._pipe: Connection
        self._pipe, theirs = context.Pipe()
        self._process: BaseProcess = context.Process(target=_work, args=(theirs,), daemon=True)
        try:
            # A script that starts workers as it is imported starts them in each worker again, which Python refuses.
            self._process.start()
            theirs.close()
            self._pipe.recv()
        except (EOFError, OSError, RuntimeError, AssertionError) as problem:
            raise NoWorker(
                f"a worker could not start ({type(problem).__name__}); in a script, what runs a study belongs under "
                "`if __name__ == '__main__':`"
            ) from None
        self.alive = True

    def call(self, job: _Job) -> Any:
        try:
            self._pipe.send((job.prepare, job.work, job.arguments, job.keywords))
            done, value = self._pipe.recv()
            if done:
                if not self._pipe.poll(job.limit):
                    self._kill()
                    raise TimeLimitExceeded(_too_long(job.limit or 0.0))
                done, value = self._pipe.recv()
        except (EOFError, ConnectionError):
            self._process.join(5)
            code = self._process.exitcode
            self._kill()
            raise WorkerDied(f"the process ended with status {code}: a crash, or no memory left") from None
        if done:
            return value
        raise value

    def end(self) -> None:
        self._pipe.close()
        self._process.join(5)
        self._kill()

    def _kill(self) -> None:
        self.alive = False
        self._process.kill()
        self._process.join()


class NoWorker(BodyImageKinError):
    """No process can be started here; nothing a cell is to blame for."""


def _work(pipe: Connection) -> None:
    """What a process of the pool does until its pipe is closed."""
    # An interrupt from the terminal reaches every process; the one that began the study decides what follows.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # What cells need is loaded before the first limit runs.
    import bodyimage_kin.study.cells  # noqa: F401

    pipe.send("ready")
    while True:
        try:
            prepare, work, arguments, keywords = pipe.recv()
        except EOFError:
            return
        except Exception as problem:
            pipe.send((False, RuntimeError(f"cannot read the work: {problem}")))
            continue
        try:
            if prepare is not None:
                prepare(arguments[0])
            pipe.send((True, None))
            answer = (True, work(*arguments, **keywords))
        except Exception as problem:
            # Said in words: not every error can travel between processes.
            answer = (False, RuntimeError(f"{type(problem).__name__}: {problem}"))
        try:
            pipe.send(answer)
        except (TypeError, AttributeError, ValueError) as problem:
            pipe.send((False, RuntimeError(f"what it returned cannot be sent: {problem}")))


def _too_long(limit: float) -> str:
    return f"took longer than the time limit of {limit:g} s"


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
