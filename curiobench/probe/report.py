"""`curiobench probe`: play episodes, compute rewards, write numbers and scores, draw."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from curiobench.analysis.canvas import matplotlib_settings
from curiobench.analysis.colours import line_styles
from curiobench.cli.arguments import Among, ProbeArguments
from curiobench.files import writing_to
from curiobench.methods.agents.q_int import MEMBERS
from curiobench.methods.reward import Batch
from curiobench.methods.specs import display_name
from curiobench.probe.episodes import Played, play_scripts, reference_transitions
from curiobench.probe.figures import draw_q_int, draw_rewards
from curiobench.probe.scores import (
    ControllabilityScore,
    ProbedRun,
    Reading,
    controllability,
    open_runs,
    own_transitions,
    read,
)
from curiobench.probe.steps import falling, lifting
from curiobench.terminal import align


def probe(arguments: ProbeArguments) -> tuple[str, list[str], list[Path]]:
    """Probe runs of one task and robot, and write the results; files of the same names are replaced.

    Returns:
        The table of scores, a line on each run that was left out, and the files.

    Raises ValueError where runs cannot be read or compared, or have no replay, or the folder cannot be written.
    """
    seed, among, out = arguments.seed, arguments.among, arguments.out
    runs, notes = open_runs(arguments.runs, arguments.method, arguments.as_of_epoch)
    played = play_scripts(runs[0].config.task, runs[0].config.robot, arguments.starts, seed)
    pairs = list(zip(runs, _references(runs, seed, among), strict=True))
    readings = [[read(run, episodes, reference) for run, reference in pairs] for episodes in played]
    scores = [controllability(of_run, played, seed) for of_run in zip(*readings, strict=True)]
    score_rows = [_columns(run) | {"among": among} | vars(of) for run, of in zip(runs, scores, strict=True)]
    with writing_to(out):
        out.mkdir(parents=True, exist_ok=True)
        tables = {out / "scores.csv": score_rows, out / "numbers.csv": _number_rows(runs, readings, played)}
        for path, rows in tables.items():
            pd.DataFrame(rows).to_csv(path, index=False, lineterminator="\n", errors="backslashreplace")
        files = [*tables, *draw(runs, readings, played, seed, out, among)]
    return format_scores(runs, scores), notes, files


def _references(runs: Sequence[ProbedRun], seed: int, among: Among) -> list[Batch]:
    """The transitions that each run's steps are scored among."""
    if among == "replay":
        return [own_transitions(run, seed) for run in runs]
    return [reference_transitions(runs[0].config.task, runs[0].config.robot, seed)] * len(runs)


@matplotlib_settings()
def draw(
    runs: Sequence[ProbedRun],
    readings: Sequence[Sequence[Reading]],
    played: Sequence[Played],
    seed: int,
    out: Path,
    among: Among,
) -> list[Path]:
    """Draw all figures; that of Q_int only if a run has it."""
    files, looks = [], line_styles(run.config.method for run in runs)
    for of_kind, episodes in zip(readings, played, strict=True):
        files += draw_rewards(runs, of_kind, episodes, looks, seed, out / f"rewards_{episodes.kind.name}", among)
    hybrid = [number for number, reading in enumerate(readings[0]) if reading.q_int]
    if hybrid:
        of_hybrid = [[of_kind[number] for number in hybrid] for of_kind in readings]
        files += draw_q_int([runs[number] for number in hybrid], of_hybrid, played, looks, out / "q_int")
    return files


def format_scores(runs: Sequence[ProbedRun], scores: Sequence[ControllabilityScore]) -> str:
    """One line per run, the highest score first."""
    lines = [
        [run.label, str(run.epoch), *(f"{x:+.2f}" for x in (s.lifting, s.falling, s.controllability)),
         f"{s.low:+.2f} to {s.high:+.2f}", str(s.starts)]
        for run, s in sorted(zip(runs, scores, strict=True), key=lambda pair: -pair[1].controllability)
    ]  # fmt: skip
    return align([["method", "epoch", "lifting", "falling", "controllability", "95 %", "starts"], *lines], left=1)


def _columns(run: ProbedRun) -> dict[str, Any]:
    return {"method": display_name(run.config.method), "run": str(run.path), "epoch": run.epoch}


def _number_rows(
    runs: Sequence[ProbedRun], readings: Sequence[Sequence[Reading]], played: Sequence[Played]
) -> Iterator[dict[str, Any]]:
    """A row for each step of each episode of each run."""
    for of_kind, episodes in zip(readings, played, strict=True):
        steps = list(_step_rows(episodes))
        for run, reading in zip(runs, of_kind, strict=True):
            for row in steps:
                at = row["start"], row["step"] - 1
                values = {"raw": reading.raw[at], "normalised": reading.normalised[at]}
                values |= {f"q_int_{name}": float(reading.q_int[name][at]) if reading.q_int else None
                           for name in MEMBERS}  # fmt: skip
                yield _columns(run) | row | values


def _step_rows(played: Played) -> Iterator[dict[str, Any]]:
    """The columns of each step that do not depend on the run."""
    track = played.track
    lifts, falls = lifting(track), falling(track)
    for start, heights in enumerate(track.block[:, 1:, 2]):
        moments = {state: name for name, state in played.kind.moments(track[start]).items()}
        for step, height in enumerate(heights, start=1):
            yield {
                "episode": played.kind.name,
                "start": start,
                "pictured": int(start == played.pictured),
                "step": step,
                "block_height": height,
                "lifting": int(lifts[start, step - 1]),
                "falling": int(falls[start, step - 1]),
                "moment": moments.get(step, ""),
            }
