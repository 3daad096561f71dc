"""Who works off the cells: this process, a pool of processes, or a Dask cluster, all as ``concurrent.futures``.

In the pool and on Dask a task runs in a *child*, a process that can be killed without harm to anything else: a crash, a
kill or a time limit costs that task alone. What a task prints goes to its log. Children end with the process that began
them, however that ended.

Pebble 5.2.3 was tried for the children, and cannot keep three of their promises: that the time limit begins when a task
is prepared (its embodiment loaded; Pebble's begins before), that a killed child is replaced at once (there, after four
seconds), and that a script needs no ``if __name__ == "__main__":`` (there it ends in ``BrokenProcessPool``).
"""

from __future__ import annotations

import abc
import contextlib
import functools
import io
import os
import queue
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Executor, Future
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, cast

from bodyimage_kin._checks import number, whole
from bodyimage_kin.errors import BodyImageKinError, InvalidConfig, MissingDependency

__all__ = [
    "Call",
    "ExecutorLost",
    "InProcess",
    "KillablePool",
    "NoWorker",
    "OnDask",
    "Ours",
    "TimeLimitExceeded",
    "WorkerDied",
    "executor",
    "here",
    "in_child",
    "submit",
    "was_lost",
]


class TimeLimitExceeded(Exception):
    """A task took longer than it may."""


class WorkerDied(Exception):
    """The process of a task ended: a crash, or no memory left."""


class NoWorker(BodyImageKinError):
    """No process can be started here; nothing a task is to blame for."""


class ExecutorLost(BodyImageKinError):
    """Whoever worked is gone, again and again; nothing a task is to blame for."""


@dataclass(frozen=True)
class Call:
    """Something to do, as it travels.

    Attributes:
        work: A function that processes can import; called with the arguments.
        arguments: What it is called with.
        prepare: Called with the first argument before the time begins to run.
        limit: Time that the work may take [s]; None: any.
        log: File for all that it prints; None: nowhere.
    """

    work: Callable[..., Any]
    arguments: tuple[Any, ...] = ()
    prepare: Callable[[Any], Any] | None = None
    limit: float | None = None
    log: str | None = None


def submit(executor: Executor, call: Call) -> Future[Any]:
    """Hands out a call. What comes back may raise :class:`TimeLimitExceeded` or :class:`WorkerDied`.

    Where nothing can be killed, in this process and on executors of others, a call is given up once its time is over.
    """
    return executor.hand_out(call) if isinstance(executor, Ours) else executor.submit(here, call)


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
    def gone(self) -> bool:
        """Whether nobody will ever answer."""
        return False


class OnDask(Ours):
    """Works on a Dask cluster, each call in a child of a worker.

    Args:
        client: Of the cluster.
    """

    def __init__(self, client: Any) -> None:
        self._client, self._executor = client, client.get_executor(pure=False)

    def hand_out(self, call: Call) -> Future[Any]:
        """See :class:`Ours`."""
        return self._executor.submit(in_child, call)

    @property
    def gone(self) -> bool:
        """Whether the scheduler is lost: what waits for it then waits for ever."""
        return self._client.status in ("closing", "closed")


class InProcess(Ours):
    """Works at once, in this process."""

    def hand_out(self, call: Call) -> Future[Any]:
        """A call that is done when this returns."""
        future: Future[Any] = Future()
        with _prints_to(call.log):
            try:
                # Directly, where nothing is to be given up: fewer functions to read through.
                future.set_result(here(call) if call.limit is not None or call.prepare else call.work(*call.arguments))
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
        self._jobs: queue.SimpleQueue[tuple[Future[Any], Call] | None] = queue.SimpleQueue()
        self._children: set[_Child] = set()
        self._threads = [threading.Thread(target=self._serve, daemon=True) for _ in range(count)]
        for thread in self._threads:
            thread.start()

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
        child: _Child | None = None
        while (job := self._jobs.get()) is not None:
            future, call = job
            if not future.set_running_or_notify_cancel():
                continue
            try:
                if child is None:
                    child = _Child()
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


def here(call: Call) -> Any:
    """Does a call in this thread, or gives it up after its time. See :func:`submit`.

    Raises:
        TimeLimitExceeded: It took longer. The thread that works is left behind, and ends with its process.
    """
    if call.prepare is not None:
        call.prepare(call.arguments[0])
    if call.limit is None:
        return call.work(*call.arguments)
    future: Future[Any] = Future()

    def work() -> None:
        try:
            future.set_result(call.work(*call.arguments))
        except BaseException as problem:
            future.set_exception(problem)

    threading.Thread(target=work, daemon=True).start()
    try:
        return future.result(number("limit", call.limit, above=0.0))
    except TimeoutError:
        if future.done():
            raise
        raise TimeLimitExceeded(_too_long(call.limit)) from None


def in_child(call: Call) -> Any:
    """Does a call in a child of this thread's own; what a worker of Dask does."""
    child: _Child | None = getattr(_OWN, "child", None)
    if child is None or not child.alive:
        child = _OWN.child = _Child()
    return child.call(call)


# Inner ---------------------------------------------------------------------------------------------------------------


_OWN = threading.local()
"""The child of each thread that works for Dask."""


class _Child:
    """A process that does one call after the other (:mod:`bodyimage_kin.study.child`)."""

    def __init__(self) -> None:
        # Begun anew, not forked: a fork would inherit torch's threads in whatever state they are.
        paths = os.pathsep.join(path or os.getcwd() for path in sys.path)
        ours, self._lifeline = os.pipe()
        with tempfile.TemporaryFile() as said:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "bodyimage_kin.study.child", str(ours)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=said,
                pass_fds=[ours],
                env={**os.environ, "PYTHONPATH": paths},
            )
            os.close(ours)
            assert self._process.stdin is not None
            assert self._process.stdout is not None
            self._calls = Connection(os.dup(self._process.stdin.fileno()), readable=False)
            self._answers = Connection(os.dup(self._process.stdout.fileno()), writable=False)
            self._process.stdin.close()
            self._process.stdout.close()
            self.alive = True
            try:
                self._answers.recv()
            except (EOFError, OSError) as problem:
                self.kill()
                said.seek(0)
                last = said.read().decode(errors="replace").strip().splitlines()[-1:] or [type(problem).__name__]
                raise NoWorker(f"a worker could not start: {last[0]}") from None

    def call(self, call: Call) -> Any:
        """What comes of it, or what went wrong."""
        try:
            self._calls.send(call)
            done, value = self._answers.recv()
            if done:
                if not self._answers.poll(call.limit):
                    self.kill()
                    raise TimeLimitExceeded(_too_long(call.limit or 0.0))
                done, value = self._answers.recv()
        except (EOFError, OSError):
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(5)
            code = self._process.returncode
            self.kill()
            raise WorkerDied(f"the process ended with status {code}: a crash, or no memory left") from None
        if done:
            return value
        raise value

    def end(self) -> None:
        """Lets it finish."""
        self._calls.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(5)
        self.kill()

    def __del__(self) -> None:
        # A thread that works for Dask ends without a word.
        self.kill()

    def kill(self) -> None:
        """Ends it at once."""
        if getattr(self, "alive", False):
            self.alive = False
            self._process.kill()
            self._process.wait()
            for pipe in (self._calls, self._answers):
                pipe.close()
            os.close(self._lifeline)


@contextmanager
def _prints_to(log: str | None) -> Iterator[None]:
    """All that Python prints in this thread's process goes to a file meanwhile; nowhere without one."""
    with io.StringIO() as said:
        try:
            with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
                yield
        finally:
            if log is not None and not said.closed and said.getvalue():
                with contextlib.suppress(OSError):
                    Path(log).parent.mkdir(parents=True, exist_ok=True)
                    with Path(log).open("a", encoding="utf-8", errors="backslashreplace") as file:
                        file.write(said.getvalue())


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
