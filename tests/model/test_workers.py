"""Work handed out in order, a bounded part of it at a time, and none after an error."""

import threading
from collections.abc import Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from typing import Any

import pytest

from fullsphere.model.workers import ordered_map, thread_pool


class Lazy(Executor):
    """Runs nothing until a result is asked for; remembers what was submitted and what was cancelled."""

    def __init__(self) -> None:
        self.futures: list[Future[Any]] = []

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        class Waiting(Future[Any]):
            def result(self, timeout: float | None = None) -> Any:
                return fn(*args, **kwargs)

        self.futures.append(Waiting())
        return self.futures[-1]


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_results_come_in_the_order_of_the_items(threads: int) -> None:
    first_waits = threading.Event()

    def work(item: int) -> int:
        if item == 0 and threads > 1:
            first_waits.wait(30)
        elif item == 1:
            first_waits.set()  # the second is done before the first
        return item * item

    with ThreadPoolExecutor(threads) as pool:
        assert list(ordered_map(pool, work, range(50))) == [k * k for k in range(50)]


def test_without_an_executor_it_is_the_plain_map() -> None:
    taken: list[int] = []

    def items() -> Iterator[int]:
        for k in range(5):
            taken.append(k)
            yield k

    results = ordered_map(None, lambda k: -k, items())
    assert taken == []
    assert next(results) == 0
    assert taken == [0]
    assert list(results) == [-1, -2, -3, -4]


def test_no_more_than_ahead_are_under_way() -> None:
    pool = Lazy()
    for count, _ in enumerate(ordered_map(pool, str, range(20), ahead=3), start=1):
        assert len(pool.futures) <= count + 2
    assert len(pool.futures) == 20


def test_an_exception_comes_out_where_it_belongs_and_stops_the_rest() -> None:
    pool = Lazy()

    def work(item: int) -> int:
        if item == 4:
            raise ValueError("the fourth")
        return item

    results = ordered_map(pool, work, range(1000), ahead=5)
    assert [next(results) for _ in range(4)] == [0, 1, 2, 3]
    with pytest.raises(ValueError, match="the fourth"):
        next(results)
    assert len(pool.futures) == 9
    assert all(future.cancelled() for future in pool.futures[5:])


def test_a_caller_who_leaves_early_cancels_what_waits() -> None:
    pool = Lazy()
    results = ordered_map(pool, str, range(1000), ahead=5)
    next(results)
    results.close()  # type: ignore[attr-defined]
    assert [future.cancelled() for future in pool.futures] == [False, True, True, True, True]


def test_nothing_to_do() -> None:
    with thread_pool(1) as pool:
        assert list(ordered_map(pool, str, [])) == []


def test_the_pool_has_the_threads_asked_for() -> None:
    with thread_pool(3) as three, thread_pool() as usual:
        assert three._max_workers == 3
        assert usual._max_workers >= 1
