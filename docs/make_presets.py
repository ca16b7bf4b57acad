"""Writes the tables of docs/presets.md from the runs kept in results/: `make presets`."""

from pathlib import Path

import pandas as pd
from make_methods import COMMAND, RESULTS, final_table
from sections import DOCS, markdown, write_section

from curiobench.analysis import load
from curiobench.analysis.frames import read_results

RUNS = RESULTS / "agent"
PARTS_EPOCH = 4
"""Epoch at which agents with and without a part are compared."""


def joined(layers: pd.Series) -> str:
    """Success of each layer."""
    return " / ".join(f"{success:.2f}" for success in layers)


def parts_table(layers: pd.DataFrame) -> str:
    """One row per variant of the agent: success by layer of each seed, and the mean over goals and seeds."""
    layers = layers[(layers["task"] == "stack2") & (layers["epoch"] == PARTS_EPOCH) & (layers["seed"] < 2)]
    variant = layers["run"].astype(str).str.extract(r"^stack2-sac-(?:(.+)-)?\d$")[0].fillna("the whole agent")
    success = layers.pivot_table("success", [variant, "seed"], "layer")
    means = success[0].groupby(level=0).mean().sort_values()
    order = ["the whole agent", *means.index.drop("the whole agent")]
    seeds = success.drop(columns=0).apply(joined, axis=1)
    rows = [[name, ", ".join(seeds[name]), f"{means[name]:.2f}"] for name in order]
    return markdown(["variant", "success by layer, a seed each", "mean"], rows)


def sb3_table(path: Path) -> str:
    """One row per test of stable-baselines3's agent."""
    head = ["minutes", "steps", "updates"]
    tests = pd.read_csv(path, dtype=dict.fromkeys(head, str)).groupby(head, sort=False)
    by_layer = {of: joined(test.groupby("layer")["success"].mean()) for of, test in tests}
    rows = [[*of, by_layer[of], f"{test['success'].mean():.2f}"] for of, test in tests]
    return markdown(["minutes of training", "steps", "updates", "success by layer", "mean"], rows)


if __name__ == "__main__":
    sac = ("sac",)
    biased = read_results([RUNS / "biased"])
    tables = {
        "sac": final_table(load("v2"), sac),
        "longer": final_table(read_results([RUNS / "longer"]), sac),
        "biased starts": final_table(biased, sac),
        "parts": parts_table(pd.concat([biased.layers, read_results([RUNS / "parts"]).layers])),
        "sb3 on stack2": sb3_table(RUNS / "sb3-stack2.csv"),
        "sb3 on stack3": sb3_table(RUNS / "sb3-stack3.csv"),
    }
    for name, table in tables.items():
        write_section(DOCS / "presets.md", name, table, COMMAND)
