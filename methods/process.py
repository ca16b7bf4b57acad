"""Settings of the process that make small networks fast on a CPU."""

import ctypes
import sys

import torch

_M_TRIM_THRESHOLD, _M_TOP_PAD, _M_MMAP_THRESHOLD = -1, -2, -3  # malloc.h of glibc
_MEGABYTE = 1 << 20


def tune_process(threads: int = 1) -> None:
    """Call once, before training.

    Sets torch's number of threads. With networks this small, a second thread costs more time than it saves. It also
    makes glibc's allocator keep freed memory. By default the kernel provides large arrays anew each time, and the page
    faults took 7 to 30 % of an update. On systems other than Linux with glibc only the threads are set.
    """
    torch.set_num_threads(threads)
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None) if sys.platform == "linux" else None
    if mallopt is not None:
        mallopt(_M_MMAP_THRESHOLD, 32 * _MEGABYTE)
        mallopt(_M_TRIM_THRESHOLD, 1024 * _MEGABYTE)
        mallopt(_M_TOP_PAD, 64 * _MEGABYTE)
