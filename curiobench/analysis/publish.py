"""The command `curiobench publish`: writes a published set from run folders; `curiobench.analysis.load` reads it."""

import gzip
import hashlib
import io
import re
import shutil
from collections.abc import Container, Mapping, Sequence
from pathlib import Path

import pandas as pd

from curiobench.analysis.agents import collect_agents
from curiobench.analysis.figures import draw_figures
from curiobench.analysis.folders import AGENTS, CONFIGS, PUBLISHED_FILES, SUMS, agents_of, check_sums, is_published
from curiobench.analysis.formats import make_tables, write_tables
from curiobench.analysis.frames import Results, read_results
from curiobench.analysis.paper import LEARNED
from curiobench.analysis.report import write_report
from curiobench.files import read_content, replace_file, sync_folder, utf8, writing_to
from curiobench.workers import cores

DERIVED = ("tables", "figures", "report.html")  # made from the csv files each time a set is published
_OWN = {*PUBLISHED_FILES, CONFIGS, AGENTS, SUMS, *DERIVED}
_PLAIN = re.compile(r"[\w+-][\w.+-]{0,199}")
_COMMITS = re.compile(r"[0-9a-f]+( [0-9a-f]+)*")
"""One commit, or several separated by spaces: the parts of a lengthened run may come from different commits."""


def publish(
    paths: Sequence[Path], out: Path, allow_dirty: bool = False, replace: bool = False, trusted: Container[str] = ()
) -> list[str]:
    """Write a published set of runs, and return lines that name its parts and the methods without an agent.

    The set is written to a temporary folder beside `out`, which is renamed to `out` when it is complete. Other files of
    an existing set, such as a README, are kept.

    Args:
        paths: run folders, grids, published sets. A lengthened run replaces the shorter one.
        out: folder of the set.
        allow_dirty: also accept runs of modified code, or of code whose commit is unknown.
        replace: also replace a set with runs or agents that are not in the new one, or with other numbers for a run.
        trusted: external methods that may be imported. Agents of other external methods are left out.

    Raises ValueError if folders are missing, damaged, partial, duplicate or foreign, if a run's code is not a commit,
    or if `out` is something else or cannot be written. The message names each of them, and `out` is unchanged.
    """
    results = read_results(paths, longest=True)
    _check_runs(results, allow_dirty)
    files = {f"{CONFIGS}/{run}.json": read_content(file) for run, file in results.config_files.items()}
    agents, notes = collect_agents(results, trusted)
    files |= agents
    place = out.resolve()
    if not place.name:
        raise ValueError(f"{out} cannot itself become a set; give a new folder, e.g. {out / 'v1'}")
    with writing_to(out):
        _write_in_place(place, results, files, replace)
    rows = [f"{out / name}: {len(frame):,} rows" for name, frame in _frames(results).items()]
    folders = (CONFIGS, AGENTS) if agents else (CONFIGS,)
    return [*rows, *(str(out / name) for name in (*folders, SUMS, *DERIVED)), *notes]


def _write_in_place(place: Path, results: Results, files: Mapping[str, bytes], replace: bool) -> None:
    """Write a set beside its place, and rename it when it is complete."""
    old, new = (place.with_name(f".{place.name}.curiobench-{kind}") for kind in ("old", "new"))
    _tidy(place, old, new)
    _check_place(place, results, files, replace)
    try:
        new.mkdir(parents=True)
        _write(new, results, files)
        derive(new)
        _keep_others(place, new)
        if place.exists():
            place.rename(old)
        new.rename(place)
        sync_folder(place.parent)
    finally:
        _tidy(place, old, new)


def _check_runs(results: Results, allow_dirty: bool) -> None:
    """Raises ValueError unless all runs can be published."""
    if results.faults:
        raise ValueError(f"not published: {'; '.join(results.faults)}")
    dirty = [
        f"{run} was made from {f'code with uncommitted changes (commit {commit})' if commit else 'an unknown commit'}"
        for run, commit in zip(results.runs["run"], results.runs["git_commit"], strict=True)
        if not _COMMITS.fullmatch(commit)
    ]
    if dirty and not allow_dirty:
        raise ValueError(f"not published: {'; '.join(dirty)}; publish anyway with --allow-dirty")
    if odd := [run for run in results.runs["run"] if not _PLAIN.fullmatch(run)]:
        raise ValueError(f"not published: the run folder {odd[0]!r} needs a unique name of letters, digits and .+-_")


def _tidy(out: Path, old: Path, new: Path) -> None:
    """Clean up after an interrupted `publish`. If it was interrupted between its two renames, restore the old set."""
    if old.exists() and not out.exists():
        old.rename(out)
    for rest in (old, new):
        if rest.exists():
            shutil.rmtree(rest)


def _keep_others(out: Path, new: Path) -> None:
    """Copy the other files of an existing set, such as a README, into the new one."""
    if out.exists():
        own = {str(out): _OWN}  # ignored at the top level only
        shutil.copytree(out, new, symlinks=True, dirs_exist_ok=True, ignore=lambda folder, _: own.get(folder, ()))


def _check_place(out: Path, results: Results, files: Container[str], replace: bool) -> None:
    """Raises ValueError if the new set must not replace what is at `out`."""
    if not out.exists() or (out.is_dir() and {path.name for path in out.iterdir()} <= {"README.md"}):
        return
    if not is_published(out):
        raise ValueError(f"{out} exists and is not a published set")
    if replace:
        return
    check_sums(out)
    there = read_results([out])
    faults, (theirs, ours) = list(there.faults), map(_rows_of_runs, (there, results))
    for run, rows in theirs.items():
        if run not in ours:
            faults.append(f"its run {run} would be lost")
        elif not rows.equals(ours[run][: len(rows)]):  # the new run may be longer
            faults.append(f"its run {run} would get other numbers")
    lost = [name for name in agents_of(out) if f"{AGENTS}/{name}/config.json" not in files]
    faults += [f"its agent {name} would be lost" for name in lost]
    if faults:
        why = "; ".join(faults)
        raise ValueError(f"{out} holds a published set that would lose or change data: {why}; overwrite with --replace")


def _rows_of_runs(results: Results) -> dict[str, pd.DataFrame]:
    """The numbers of each run's evaluations."""
    columns = ["epoch", "steps", "success", "episodes", "success_unsatisfied", "episodes_unsatisfied"]
    groups = results.evaluations.groupby("run", observed=True)[columns]
    return {str(run): rows.reset_index(drop=True) for run, rows in groups}


def _frames(results: Results) -> dict[str, pd.DataFrame]:
    """The frames of a set, by file name."""
    return dict(zip(PUBLISHED_FILES, (results.runs, results.evaluations, results.progress), strict=True))


def _write(folder: Path, results: Results, files: Mapping[str, bytes]) -> None:
    """Write the frames of a set, its other files, and the digests of all of them."""
    texts = {name: utf8(frame.to_csv(index=False, lineterminator="\n")) for name, frame in _frames(results).items()}
    data = {name: _gzip(text) if name.endswith(".gz") else text for name, text in texts.items()}
    data |= files
    sums = "".join(f"{hashlib.sha256(content).hexdigest()}  {name}\n" for name, content in sorted(data.items()))
    for name, content in (data | {SUMS: sums.encode()}).items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        replace_file(folder / name, lambda file, content=content: file.write(content))


def derive(folder: Path) -> None:
    """Write the tables, figures and report of a published set into its folder, as the commands of these names do."""
    results = read_results([folder], every_goal=False)
    for like in (None, "paper") if LEARNED.keys() & set(results.runs["method"]) else (None,):
        write_tables(folder / "tables", make_tables(results, like), results)
    draw_figures(results, folder / "figures", processes=cores())
    write_report([folder], folder / "report.html", processes=cores())


def _gzip(content: bytes) -> bytes:
    """The gzip-compressed content, without file name and time, so that the bytes depend on the content only."""
    buffer = io.BytesIO()
    with gzip.GzipFile("", "wb", 9, buffer, mtime=0) as file:
        file.write(content)
    return buffer.getvalue()
