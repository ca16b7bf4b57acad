"""Writes tables and figures of docs/methods from the runs kept in results/: `make presets`."""

from pathlib import Path

import numpy as np
import pandas as pd
from scipy import stats
from sections import DOCS, markdown, write_section

from curiobench.analysis import load
from curiobench.analysis.canvas import matplotlib_settings, new_figure, save_figure
from curiobench.analysis.colours import COLOURS
from curiobench.analysis.frames import Results, read_results
from curiobench.run_folder import read_json

RESULTS = DOCS.parent / "results"
COMMAND = "make presets"
PAPERS_TAU = 0.2

Sweep = dict[str, dict[float, list[float]]]
"""Final mean success by method and tau, one value per seed."""


def read_sweep() -> Sweep:
    """The finished runs of docs/examples/tau.yaml."""
    sweep: Sweep = {}
    for path in sorted((RESULTS / "tau").glob("*/result.json")):
        config = read_json(path.parent / "config.json")["config"]
        method = path.parent.name.removeprefix("stack2-").partition("-tau-")[0]
        by_tau = sweep.setdefault(method, {})
        by_tau.setdefault(config["sac"]["tau"], []).append(read_json(path)["success"])
    return sweep


def mean_by_tau(sweep: Sweep) -> dict[float, float]:
    """Mean over methods and seeds for each tau, in ascending order."""
    taus = sorted(next(iter(sweep.values())))
    return {tau: float(np.mean([by_tau[tau] for by_tau in sweep.values()])) for tau in taus}


def tau_table(sweep: Sweep) -> str:
    """One row per method: final mean success for each tau, seed by seed; then the mean over methods and seeds."""
    means = mean_by_tau(sweep)
    rows = [[m, *(", ".join(f"{v:.2f}" for v in by_tau[tau]) for tau in means)] for m, by_tau in sweep.items()]
    return markdown(["τ", *map(str, means)], [*rows, ["mean of all", *(f"{value:.2f}" for value in means.values())]])


def tau_differences(sweep: Sweep) -> str:
    """A row a tau: its success less that of the paper's tau with the same method and seed, with a t interval."""
    paper = np.array([by_tau[PAPERS_TAU] for by_tau in sweep.values()]).ravel()
    rows = []
    for tau in sorted(next(iter(sweep.values()))):
        if tau != PAPERS_TAU:
            difference = np.array([by_tau[tau] for by_tau in sweep.values()]).ravel() - paper
            low, high = stats.ttest_1samp(difference, 0).confidence_interval()
            rows.append([str(tau), f"{difference.mean():+.2f}", f"{low:+.2f} to {high:+.2f}", str(len(difference))])
    return markdown(["τ", f"success less that of τ = {PAPERS_TAU}", "95 %", "pairs"], rows)


@matplotlib_settings()
def draw_tau(sweep: Sweep, path: Path) -> None:
    """One line per method: mean over seeds of final success by tau; one dot per run; the mean over methods in black."""
    figure = new_figure(6, 3.5, dpi=150)
    axes = figure.subplots()
    means = mean_by_tau(sweep)
    taus = list(means)
    for method, by_tau in sweep.items():
        colour = COLOURS["mi" if method == "mihm" else method]
        style = {"color": colour, "linewidth": 1, "linestyle": "-" if method == "mihm" else "--"}
        axes.plot(taus, [np.mean(by_tau[tau]) for tau in taus], label=method, **style)
        for tau in taus:
            axes.plot([tau] * len(by_tau[tau]), by_tau[tau], ".", color=colour, alpha=0.6)
    axes.plot(taus, list(means.values()), "k", linewidth=2.5, label="mean of the five")
    axes.set(xlabel="τ", ylabel="success after 3 epochs", xscale="log", ylim=(0, 1.02))
    axes.set_xticks(taus, list(map(str, taus)))
    axes.set_xticks([], minor=True)
    axes.legend(frameon=False, loc="center left", bbox_to_anchor=(1, 0.5))
    axes.spines[["top", "right"]].set_visible(False)
    save_figure(figure, path.with_suffix(""), ["png"])


def last_epochs(frame: pd.DataFrame) -> pd.DataFrame:
    """Rows of each run's last epoch in a frame."""
    return frame[frame["epoch"] == frame.groupby("run", observed=True)["epoch"].transform("max")]


def final_table(results: Results, methods: tuple[str, ...]) -> str:
    """One row per run: its length, mean success at each evaluation, success by layer and goals learned at the end."""
    layers = results.layers[results.layers["method"].isin(methods)]
    minutes = last_epochs(results.progress).set_index("run")["seconds"] / 60
    rows = []
    for run, of_run in layers[layers["epoch"] > 0].groupby("run", observed=True):
        means = " · ".join(f"{value:.2f}" for value in of_run[of_run["layer"] == 0]["success"])
        last = last_epochs(of_run).set_index("layer")
        by_layer = " / ".join(f"{value:.2f}" for value in last["success"].drop(0))
        learned = f"{last['learned'][0]} of {last['goals'][0]}"
        rows.append([str(run), f"{minutes[run]:.0f}", means, by_layer, learned])
    return markdown(["run", "minutes", "mean success at each evaluation", "by layer at the end", "learned"], rows)


def learned_table(results: Results, task: str) -> str:
    """One row per method and variant: seeds, means of learned goals by layer and in all, and mean success."""
    layers = last_epochs(results.layers[results.layers["task"] == task])
    goals = layers.groupby("layer")["goals"].first()
    head = ["method", "seeds", *(f"{layer} layer{'s'[: layer > 1]}" for layer in goals.index.drop(0))]
    rows = []
    for (method, variant), of_method in layers.groupby(["method", "variant"], observed=True):
        by_layer = of_method.groupby("layer")[["learned", "success"]].mean()
        learned = [f"{by_layer['learned'][layer]:.1f} of {goals[layer]}" for layer in (*goals.index.drop(0), 0)]
        seeds = of_method["seed"].nunique()
        name = f"{method}, {variant}" if variant else str(method)
        rows.append([name, str(seeds), *learned, f"{by_layer['success'][0]:.2f}"])
    return markdown([*head, "goals learned", "mean success"], rows)


if __name__ == "__main__":
    sweep, results = read_sweep(), load(RESULTS / "v2")
    write_section(DOCS / "methods" / "tau.md", "tau", tau_table(sweep), COMMAND)
    write_section(DOCS / "methods" / "tau.md", "differences", tau_differences(sweep), COMMAND)
    draw_tau(sweep, DOCS / "images" / "tau.png")
    table = final_table(results, ("sac", "mihm", "decstr", "mcher"))
    write_section(DOCS / "methods" / "table4.md", "table 4", table, COMMAND)
    future = read_results([RESULTS / "future"])
    write_section(RESULTS / "v2" / "README.md", "future", final_table(future, ("sac", "mihm")), COMMAND)
    write_section(DOCS.parent / "README.md", "stack3", learned_table(results, "stack3"), COMMAND)
