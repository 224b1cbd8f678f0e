"""Optimisers that know one point at a time, side by side, so that their points are priced together."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from queue import SimpleQueue
from threading import Thread
from typing import Any

import numpy as np

Ask = Callable[[np.ndarray], Any]  # a point (G,) -> its answer


class _Ended(BaseException):
    """Unwinds an optimiser whose answers will not come."""


def lockstep(answer: Callable[[np.ndarray], Sequence[Any]], jobs: Sequence[Callable[[Ask], None]]) -> None:
    """Run jobs, a thread each, until all have ended. A job is given `ask`.

    answer: called by this thread with one point of every job that has not ended, (P, G) in the order of the jobs: what
    comes out depends on no clock. What it raises ends all jobs and is raised here; so is what a job raises.
    """
    asked: SimpleQueue[tuple[int, Any]] = SimpleQueue()
    answers: list[SimpleQueue[Any]] = [SimpleQueue() for _ in jobs]

    def work(number: int) -> None:
        def ask(point: np.ndarray) -> Any:
            asked.put((number, np.array(point)))  # a copy: optimisers write into their points
            reply = answers[number].get()
            if isinstance(reply, _Ended):
                raise reply
            return reply

        try:
            jobs[number](ask)
            asked.put((number, None))
        except BaseException as error:
            asked.put((number, error))

    threads = [Thread(target=work, args=(number,), daemon=True) for number in range(len(jobs))]
    running, waiting = set(range(len(jobs))), dict[int, np.ndarray]()
    # Jobs may share an iterator of starts: each is let run only while all the others wait.
    try:
        for thread in threads:
            thread.start()
            _take(asked, waiting, running)
        while waiting:
            order = sorted(waiting)
            found = answer(np.stack([waiting.pop(number) for number in order]))
            for number, reply in zip(order, found, strict=True):
                answers[number].put(reply)
                _take(asked, waiting, running)
    finally:
        for number in running:
            answers[number].put(_Ended())
        for thread in threads:
            if thread.ident is not None:
                thread.join()


def _take(asked: SimpleQueue[tuple[int, Any]], waiting: dict[int, np.ndarray], running: set[int]) -> None:
    """What the one job that runs says next: a point, its end, or its failure, which is raised."""
    number, said = asked.get()
    if isinstance(said, np.ndarray):
        waiting[number] = said
        return
    running.discard(number)
    if isinstance(said, BaseException):
        raise said
