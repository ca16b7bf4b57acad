"""Replaces `curiobench train`: same folder, lock, rows, signals and exit codes, in hundredths of a second.

Each row depends on all before it, so that a lost or doubled row shows. `fake.json` beside the grid's folder sets what
it does: for each cell the record for its config.json, and how it fails.
"""

import fcntl
import json
import os
import signal
import sys
import time
from pathlib import Path


def fail(message: str, code: int) -> None:
    print(f"curiobench: {message}", file=sys.stderr)
    sys.exit(code)


def main() -> None:
    flags = sys.argv[2:]
    out = Path(flags[flags.index("--out") + 1])
    cell = json.loads((out.parent.parent / "fake.json").read_text())[out.name]
    stopped = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, frame: stopped.append(number))
    out.mkdir(parents=True, exist_ok=True)
    lock = open(out / ".lock", "a+")  # noqa: SIM115 - open to the end
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        fail(f"the run in {out} is already running, in process 1", 2)
    if (out / "result.json").exists():
        fail(f"the run in {out} is finished", 2)
    with open(out / "starts", "a") as file:
        file.write(f"{os.getpid()} {os.environ['OMP_NUM_THREADS']}\n")
    starts = len((out / "starts").read_text().splitlines())
    if starts <= cell.get("failures", 0):
        print("Traceback:\n  in the middle")
        fail(cell.get("message", "no luck"), cell.get("code", 1))
    if not (out / "config.json").exists():
        write(out / "config.json", cell["record"])
    train(out, cell, stopped)


def train(out: Path, cell: dict, stopped: list[int]) -> None:
    progress, state = out / "progress.csv", {"epoch": 0, "value": 1, "size": 0}
    if (out / "state.json").exists():
        state = json.loads((out / "state.json").read_text())
    progress.touch()
    os.truncate(progress, state["size"])
    if not state["size"]:
        (out / "evaluations.csv").write_text("epoch,goal\n0,a\n0,b\n0,c\n")
        append(progress, "epoch,goals_learned,value,seconds")
    while state["epoch"] < cell["record"]["config"]["epochs"]:
        time.sleep(cell.get("pace", 0.02))
        if stopped:
            state["size"] = progress.stat().st_size
            write(out / "state.json", state)
            fail("stopped after a checkpoint", 128 + stopped[0])
        state = {"epoch": state["epoch"] + 1, "value": state["value"] * 31 % 9973, "size": 0}
        append(progress, f"{state['epoch']},{state['epoch'] % 4},{state['value']},{state['epoch'] / 50}")
        if state["epoch"] % 3 == 0:
            write(out / "state.json", state | {"size": progress.stat().st_size})
    write(out / "result.json", {"epochs": state["epoch"]})


def append(path: Path, line: str) -> None:
    with open(path, "a") as file:
        file.write(line + "\n")


def write(path: Path, values: dict) -> None:
    partial = path.with_name(path.name + ".partial")
    partial.write_text(json.dumps(values))
    os.replace(partial, path)


main()
