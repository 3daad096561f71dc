"""One run of a study: hands out what is missing, recordings before the rows that learn from them.

What takes little time is handed out together, and shares what it costs to hand something out, to write a file and to
have it on the disk.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from dataclasses import dataclass, field, replace
from typing import Any

from bodyimage_kin.errors import OutputRefused
from bodyimage_kin.study import cells
from bodyimage_kin.study.blocks import Block
from bodyimage_kin.study.bodies import load_body
from bodyimage_kin.study.calls import Call, NoWorker, WorkerDied
from bodyimage_kin.study.cells import Job
from bodyimage_kin.study.executors import ExecutorLost, Others, Ours, was_lost
from bodyimage_kin.study.kept import by_recording, cells_in
from bodyimage_kin.study.specs import Table
from bodyimage_kin.study.store import Store, said

__all__ = ["work_off"]

_TRIES = 5
"""How often a task is handed out whose worker is lost, or whose recordings are damaged."""
_TOGETHER = 0.2
"""Time that tasks which are handed out together take [s]."""
_MOST_TOGETHER = 64
_LOOK = 5.0
"""Time after which it is asked whether anybody is still at work [s]."""
_KEPT = "what is finished is kept, run the study again"


@dataclass(frozen=True, eq=False)
class _Task:
    """Something to hand out.

    Attributes:
        job: The recordings of a block, or one row's cell.
        waiting: Of recordings: the rows that wait for them.
        tries: How often it was handed out in vain.
        alone: Whether it is to be done by a process that has done nothing before.
    """

    job: Job
    waiting: Sequence[str] = ()
    tries: int = 0
    alone: bool = False

    @property
    def kind(self) -> tuple[str, str]:
        """What takes about the same time: a row on a recording."""
        return self.job.block.place, self.job.name

    def goes_with(self, other: _Task) -> bool:
        """Whether both may be handed out together; what went wrong before goes alone."""
        fine = not (self.tries or other.tries or self.alone or other.alone)
        return fine and self.kind[0] == other.kind[0] and bool(self.job.name) == bool(other.job.name)


def work_off(
    blocks: Sequence[Block],
    rows: Mapping[str, Table],
    store: Store,
    executor: Ours,
    *,
    limit: float | None,
    retry: bool,
    twice: bool,
    tell: Callable[[int, int], None],
) -> None:
    """Computes what is missing of a study.

    Args:
        blocks: Of the study.
        rows: Likewise, name -> table.
        store: Where everything is written, by whoever works.
        executor: Who works.
        limit: Time that a cell may take [s]; None: any.
        retry: Whether cells that failed are tried again.
        twice: Whether each cell is computed twice, and fails where that differs.
        tell: Called with the number of tasks that are done, and their total.

    Raises:
        OutputRefused: The store cannot be written to.
        ExecutorLost: Nobody is left to work.
        NoWorker: No process can be started.
    """
    todo = _Todo(rows, store, _missing(blocks, rows, store, retry=retry))
    # Where nothing can be killed, time is limited by giving up all that was handed out.
    todo.together = limit is None or (not isinstance(executor, Others) and executor.room > 1)
    tell(todo.done, todo.total)
    pending: dict[Future[Any], list[_Task]] = {}
    try:
        while todo.tasks or pending:
            while todo.tasks and len(pending) < executor.room:
                if tasks := todo.take():
                    try:
                        pending[executor.hand_out(_call(tasks, limit, twice))] = tasks
                    except Exception as problem:
                        raise ExecutorLost(f"nobody is left to work ({said(problem)}); {_KEPT}") from None
                else:
                    tell(todo.done, todo.total)
            finished = wait(pending, _LOOK, FIRST_COMPLETED).done if pending else ()
            if not finished and executor.gone:
                raise ExecutorLost(f"the scheduler is lost; {_KEPT}")
            for future in finished:
                todo.settle(pending.pop(future), future)
                tell(todo.done, todo.total)
    finally:
        for future in pending:
            future.cancel()


@dataclass
class _Todo:
    """What is to be done, and how much is."""

    rows: Mapping[str, Table]
    store: Store
    tasks: deque[_Task]
    done: int = 0
    total: int = field(init=False)
    together: bool = True
    _seconds: dict[tuple[str, str], float] = field(default_factory=dict)
    """What each kind of task took when it was last done."""

    def __post_init__(self) -> None:
        self.total = sum(1 + len(task.waiting) for task in self.tasks)

    def take(self) -> list[_Task]:
        """What is handed out next; nothing, if the next recordings are there."""
        first = self.tasks.popleft()
        if not first.job.name and not first.tries and self._is_recorded(first):
            return []
        found, seconds = [first], self._expected(first)
        while self.together and self.tasks and len(found) < _MOST_TOGETHER:
            task = self.tasks[0]
            seconds += self._expected(task)
            if seconds > _TOGETHER or not first.goes_with(task):
                break
            self.tasks.popleft()
            if task.job.name or not self._is_recorded(task):
                found.append(task)
            else:
                # Its rows came to the front.
                break
        return found

    def _expected(self, task: _Task) -> float:
        """How long a task will take, by what took the last of its kind, or any row on the recording [s]."""
        place, name = task.kind
        return self._seconds.get(task.kind, self._seconds.get((place, "any row"), _TOGETHER) if name else _TOGETHER)

    def settle(self, tasks: Sequence[_Task], future: Future[Any]) -> None:
        """Takes up what came of tasks that were handed out together.

        Raises:
            OutputRefused: The store cannot be written to.
            NoWorker: No process can be started.
            ExecutorLost: Whoever works is lost again and again.
        """
        problem = CancelledError() if future.cancelled() else future.exception()
        if isinstance(problem, NoWorker | OutputRefused):
            raise problem
        if problem is None:
            for task, (failure, seconds) in reversed(list(zip(tasks, future.result(), strict=True))):
                if failure == cells.LATER:
                    self._again([task])
                    continue
                self._seconds[task.kind] = seconds
                if task.job.name:
                    self._seconds[task.kind[0], "any row"] = seconds
                self._end(task, failure)
            return
        at = getattr(problem, "step", -1) if len(tasks) > 1 else 0
        if was_lost(problem) or not 0 <= at < len(tasks):
            # No fault of a task's.
            if tasks[0].tries >= _TRIES:
                raise ExecutorLost(f"whoever works is lost again and again ({said(problem)}); {_KEPT}")
            self._again([replace(task, tries=task.tries + 1) for task in tasks])
            return
        guilty = tasks[at]
        if isinstance(problem, WorkerDied) and not (problem.alone or guilty.alone):
            # Perhaps of what another left behind in the process.
            self._again([*tasks[:at], replace(guilty, alone=True), *tasks[at + 1 :]])
            return
        self._seconds.pop(guilty.kind, None)
        self._again([*tasks[:at], *tasks[at + 1 :]])
        self._end(guilty, said(problem))

    def _end(self, task: _Task, failure: str) -> None:
        """Takes up what came of a task."""
        block, name = task.job.block, task.job.name
        if failure == cells.AGAIN and task.tries < _TRIES:
            self._again([_Task(Job(block), (name,), task.tries + 1)])
        elif name:
            if failure:
                self._fail(block, [name], failure)
            self.done += 1
        elif failure:
            self._fail(block, task.waiting, f"no recordings: {failure}")
            self.done += len(task.waiting) + int(not task.tries)
        else:
            self._again([_Task(Job(block, one, self.rows[one]), tries=task.tries) for one in task.waiting])
            self.done += int(not task.tries)

    def _again(self, tasks: Sequence[_Task]) -> None:
        self.tasks.extendleft(reversed(tasks))

    def _fail(self, block: Block, names: Sequence[str], failure: str) -> None:
        self.store.write_cells(block, [cells.failed(block, name, self.rows[name], failure) for name in names])

    def _is_recorded(self, task: _Task) -> bool:
        """Whether recordings are in the store; then the rows come that wait for them."""
        if self.store.facts(task.job.block) is None:
            return False
        self._end(task, "")
        return True


def _missing(blocks: Sequence[Block], rows: Mapping[str, Table], store: Store, *, retry: bool) -> deque[_Task]:
    """Recordings that are wanted, each with the rows that wait for them."""
    tasks: deque[_Task] = deque()
    for ones in by_recording(blocks):
        kept = cells_in(store.folder, ones, rows, lambda part: any(part.notes["failures"]), mend=store.mends)
        there = {cell for cell, failed in kept.items() if not (failed and retry)}
        for block in ones:
            waiting = [name for name, row in rows.items() if block.is_on(row) and (name, block.number) not in there]
            if waiting:
                tasks.append(_Task(Job(block), waiting))
    return tasks


def _call(tasks: Sequence[_Task], limit: float | None, twice: bool) -> Call:
    """Tasks as whoever works takes them."""
    first = tasks[0]
    jobs = [task.job for task in tasks]
    if not first.job.name:
        return Call(cells.work_through, (first.job.block, jobs), alone=first.alone)
    # A body is loaded before the time runs.
    prepare = load_body if limit is not None else None
    return Call(cells.work_through, (first.job.block, jobs, twice), prepare, limit, first.alone)
