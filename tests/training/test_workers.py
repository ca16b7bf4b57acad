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
    assert (set(workers) == {HERE}) == (most == 1)


@linux
@pytest.mark.parametrize("end", [lambda: 1 / 0, lambda: os.kill(os.getpid(), signal.SIGKILL), lambda: sys.exit(3)])
def test_what_a_helper_failed_at_is_done_once_more(end, capfd):
    """A helper that fails, is killed or leaves: nothing of its results is missed, and nothing printed."""

    def fails_elsewhere(number):
        return end() if os.getpid() != here else worker(number)

    here = os.getpid()
    assert parallel_map(fails_elsewhere, range(100), 3) == [(number, here) for number in range(100)]
    assert capfd.readouterr() == ("", "")


@linux
def test_a_helper_that_is_killed_while_it_sends_is_no_loss():
    def large(number):
        if os.getpid() == HERE:
            time.sleep(0.2)  # until the others have nothing left to do but to send
            for process in multiprocessing.active_children():
                process.kill()
        return str(number) * 10**6

    assert parallel_map(large, range(6), 3) == [str(number) * 10**6 for number in range(6)]


class Unreadable:
    """Can be sent, but not received."""

    def __reduce__(self):
        return int, ("no number",)


@linux
def test_a_result_that_cannot_be_received_is_made_once_more():
    assert all(isinstance(found, Unreadable) for found in parallel_map(lambda _: Unreadable(), range(100), 3))


@linux
def test_without_room_for_more_processes_one_does_it(monkeypatch):
    def fork():
        raise BlockingIOError(11, "Resource temporarily unavailable")

    monkeypatch.setattr(os, "fork", fork)
    assert parallel_map(worker, range(10), 3) == [(number, HERE) for number in range(10)]


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


@linux
@pytest.mark.parametrize("processes", [1, 3])
def test_others_begin_while_this_process_does_something_else(processes, tmp_path):
    """It is done once, before this process takes an item; a single one has nobody to leave them to."""
    done = []

    def meanwhile():
        done.append(os.getpid())
        while processes > 1 and not list(tmp_path.iterdir()):
            pass

    def touches(number):
        (tmp_path / str(number)).touch()
        return number

    assert parallel_map(touches, range(40), processes, meanwhile=meanwhile) == list(range(40))
    assert done == [HERE]


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
