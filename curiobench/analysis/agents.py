"""Selection of the trained agents in a published set: for each task and method, the agent of the best run.

The best run is the one with the highest mean success over all goals at its last evaluation, among runs that have an
agent. Ties are broken by the lowest seed, then by name. Critics and replay buffers are left out.
"""

from collections import defaultdict
from collections.abc import Container, Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from curiobench.analysis.folders import AGENT_FILES, AGENTS, WEIGHTS, agent_name, agents_of, check_sums, is_published
from curiobench.analysis.frames import Results
from curiobench.analysis.samples import DECIMALS
from curiobench.files import read_content, utf8
from curiobench.run_folder import CHECKPOINT

_README = """# Trained agents

One agent per task and method. It comes from the run with the highest mean success over all goals at the last
evaluation (the lowest seed if several are equal), among the runs that had a checkpoint when the set was published.
`config.json` is that run's. `agent.safetensors` holds what acting needs.

| task | method | run | success | goals learned | bytes |
|---|---|---|---|---|---|
"""


def collect_agents(results: Results, trusted: Container[str]) -> tuple[dict[str, bytes], list[str]]:
    """Files of the selected agents, by path in the set, and one line per reason why methods have no agent.

    Args:
        results: the runs.
        trusted: external methods that may be imported.
    """
    files: dict[str, bytes] = {}
    rows, lacking = [], defaultdict(list)
    for (task, method), runs in _with_success(results).groupby(["task", "method"], sort=False):
        found, reasons = _best_agent(runs, results.config_files, trusted)
        if found is None:
            lacking[reasons].append(f"{task} {method}")
            continue
        run, weights = found
        config = read_content(results.config_files[run["run"]])
        place = f"{AGENTS}/{agent_name(task, method)}"
        files |= {f"{place}/config.json": config, f"{place}/{WEIGHTS}": weights}
        told = f"{run['run']} | {run['success']:.2f} | {run['learned']} of {run['goals']} | {len(weights):,}"
        rows.append(f"| {task} | {method} | {told} |\n")
    if files:
        files[f"{AGENTS}/README.md"] = utf8(_README + "".join(rows))
    return files, [f"no agent of {', '.join(names)}: {why}" for why, names in lacking.items()]


def _with_success(results: Results) -> pd.DataFrame:
    """The frame `runs` with columns of the last evaluation: mean success over all goals, goals learned, and goals."""
    all_goals = results.layers[results.layers["layer"] == 0]
    last = all_goals.groupby("run", observed=True)[["success", "learned", "goals"]].last().round(DECIMALS)
    return results.runs.join(last.set_index(last.index.astype(str)), on="run")


def _best_agent(
    runs: pd.DataFrame, config_files: Mapping[str, Path], trusted: Container[str]
) -> tuple[tuple[dict[str, Any], bytes] | None, str]:
    """The best run that has an agent, and the agent's weights; None and the reasons if no run has one."""
    reasons = []
    best_first = runs.sort_values(["success", "seed", "run"], ascending=[False, True, True])
    for run in best_first.to_dict("records"):
        try:
            return (run, _weights(run, config_files[run["run"]], trusted)), ""
        except ValueError as error:
            reasons.append(str(error))
    return None, "; ".join(dict.fromkeys(reasons))


def _weights(run: dict[str, Any], config_file: Path, trusted: Container[str]) -> bytes:
    """Content of the agent's weights file. Raises ValueError with the reason if there is no agent."""
    folder, home = config_file.parent, config_file.parent.parent
    if is_published(home):
        name = agent_name(run["task"], run["method"])
        agent = home / AGENTS / name
        if name in agents_of(home) and read_content(agent / "config.json") == read_content(config_file):
            check_sums(home, tuple(f"{AGENTS}/{name}/{file}" for file in AGENT_FILES))
            return read_content(agent / WEIGHTS)
    elif (folder / CHECKPOINT).is_dir():
        from curiobench.published_agent import packed  # torch takes seconds to import
        from curiobench.saved_agent import load_saved

        saved = load_saved(folder, trusted)
        if saved.epoch != run["epoch"]:
            there = f"the checkpoint of {folder} is from epoch {saved.epoch}"
            raise ValueError(f"{there}, the last evaluation from {run['epoch']}")
        return packed(saved.agent)
    raise ValueError("runs without a checkpoint")
