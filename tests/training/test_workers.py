"""Work on several processes gives what one gives, whatever happens to the others."""

import gc
import multiprocessing
import os
import signal
import sys
import time

import pytest

from curiobench.grid.launcher import physical_cores
from curiobench.workers import cores, no_collection, parallel_map, quota

HERE = os.getpid()
linux = pytest.mark.skipif(sys.platform != "linux", reason="processes are forked on Linux only")


def square(number):
    return number**2


def worker(number):
    """A little work, so that no process does all of it, and who did it."""
    sum(range(100_000))
    return number, os.getpid()


@pytest.mark.parametrize(
    ("items", "processes", "least"), [(0, 2, 1), (1, 2, 1), (40, 1, 1), (40, 3, 1), (40, 9, 16), (1500, 3, 1)]
)
def test_results_are_those_of_a_loop_in_its_order(items, processes, least):
    assert parallel_map(square, range(items), processes, least) == [number**2 for number in range(items)]
    assert not multiprocessing.active_children()


@linux
@pytest.mark.parametrize(("processes", "least", "most"), [(1, 1, 1), (3, 1, 3), (3, 100, 2), (3, 101, 1)])
def test_several_processes_share_the_work_where_it_is_enough(processes, least, most):
    numbers, workers = zip(*parallel_map(worker, range(200), processes, least), strict=True)
    assert numbers == tuple(range(200))
    assert len(set(workers)) <= most
    assert (HERE in workers) == (most == 1)


@linux
def test_a_process_that_is_killed_is_no_loss(capfd):
    """This process does all the work then, and nothing is printed."""

    def dies_elsewhere(number):
        if os.getpid() != HERE and number > 3:
            os.kill(os.getpid(), signal.SIGKILL)
        return number, os.getpid()

    assert parallel_map(dies_elsewhere, range(100), 3) == [(number, HERE) for number in range(100)]
    assert capfd.readouterr() == ("", "")


class Unreadable:
    """Can be sent, but not received."""

    def __reduce__(self):
        return int, ("no number",)


@linux
def test_a_result_that_cannot_be_received_is_made_once_more(capfd):
    assert all(isinstance(found, Unreadable) for found in parallel_map(lambda _: Unreadable(), range(100), 3))
    assert not multiprocessing.active_children()


@linux
def test_processes_end_with_their_parent(tmp_path):
    """Also if it is killed, when they are in the middle of an item."""
    parent = multiprocessing.get_context("fork").Process(target=parallel_map, args=(sleep_long, [tmp_path] * 9, 2))
    parent.start()
    while len(workers := list(tmp_path.iterdir())) < 2:
        time.sleep(0.01)
    parent.kill()
    parent.join()
    deadline = time.monotonic() + 30
    while any(os.path.exists(f"/proc/{worker.name}") and not is_zombie(worker.name) for worker in workers):
        assert time.monotonic() < deadline
        time.sleep(0.01)


def sleep_long(folder):
    (folder / str(os.getpid())).touch()
    time.sleep(600)


def is_zombie(process):
    return open(f"/proc/{process}/stat").read().rpartition(")")[2].split()[0] == "Z"


@linux
def test_without_room_for_more_processes_one_does_it(monkeypatch):
    """Not even one more, or one of those that were asked for."""
    fork = os.fork
    for room in (0, 1):
        left = iter([fork] * room)

        def limited(left=left):
            for once in left:
                return once()
            raise BlockingIOError(11, "Resource temporarily unavailable")

        monkeypatch.setattr(os, "fork", limited)
        assert parallel_map(worker, range(10), 3) == [(number, HERE) for number in range(10)]
        assert not multiprocessing.active_children()


@linux
def test_a_process_that_may_have_no_children_does_it_alone():
    with multiprocessing.get_context("fork").Pool(1) as pool:
        assert pool.apply(parallel_map, (square, range(10), 3)) == [number**2 for number in range(10)]


def test_an_error_is_raised_and_no_process_stays():
    def fails(number):
        raise ValueError(f"no {number}")

    with pytest.raises(ValueError, match=r"^no \d$"):
        parallel_map(fails, range(10), 3)
    assert not multiprocessing.active_children()


def test_garbage_is_collected_again_afterwards():
    with no_collection():
        assert not gc.isenabled()
        with no_collection():
            pass
        assert not gc.isenabled()
    assert gc.isenabled()


@pytest.mark.parametrize(
    ("limits", "expected"),
    [
        ({}, sys.maxsize),
        ({"": "max 100000", "pod": "max 100000"}, sys.maxsize),
        ({"pod": "250000 100000", "pod/job": "max 100000"}, 3),
        ({"": "400000 100000", "pod": "150000 100000", "pod/job": "50000 100000"}, 1),
    ],
)
def test_a_container_s_limit_is_the_least_of_its_groups(tmp_path, limits, expected):
    root, membership = tmp_path / "cgroup", tmp_path / "membership"
    membership.write_text("9:name=systemd:/\n0::/pod/job\n")
    (root / "pod" / "job").mkdir(parents=True)
    for group, limit in limits.items():
        (root / group / "cpu.max").write_text(limit + "\n")
    assert quota(root, membership) == expected
    assert quota(root, tmp_path / "none") == (sys.maxsize if limits.get("", "max").startswith("max") else 4)


def test_a_process_that_is_bound_to_a_core_has_one(monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: {0}, raising=False)
    assert cores() == physical_cores() == 1
