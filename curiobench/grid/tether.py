"""Runs a command that gets SIGTERM when the process that started it dies, even by SIGKILL: `tether.py PARENT COMMAND…`.

A program of its own, run by path without the package, because code between fork and exec is unsafe in a process with
threads. The training process checkpoints on SIGTERM and ends. Linux only; elsewhere the command runs on by itself.
"""

import ctypes
import os
import signal
import sys

_PR_SET_PDEATHSIG = 1  # linux/prctl.h


def main() -> None:
    """Tether this process and become the command."""
    parent, *command = sys.argv[1:]
    # a background shell or Ray may have left these ignored or blocked, which the command would inherit
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_SETMASK, [])
    # SLURM sends it to all processes of a job whose time is nearly up; the worker turns it into a request to end
    signal.signal(signal.SIGUSR2, signal.SIG_IGN)
    if sys.platform == "linux":
        if ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM) != 0:
            sys.exit(f"cannot tie this process to its parent: {os.strerror(ctypes.get_errno())}")
        if os.getppid() != int(parent):
            sys.exit("the grid ended before its cell began")
    os.execv(command[0], command)


main()
