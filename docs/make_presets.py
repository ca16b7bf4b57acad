"""Writes tables from the runs kept in results/: `make presets`."""

from collections.abc import Iterable, Mapping
from pathlib import Path

from make_methods import RESULTS, final_table
from sections import DOCS, markdown, write_section

from curiobench.analysis import load
from curiobench.analysis.frames import read_results
from curiobench.run_folder import read_rows

RUNS = RESULTS / "agent"
PARTS_EPOCH = 4
"""Epoch at which agents with and without a part are compared."""

Rows = Iterable[Mapping[str, str]]


def by_layer(rows: Rows) -> str:
    """Mean success a layer."""
    success: dict[str, list[float]] = {}
    for row in rows:
        success.setdefault(row["layer"], []).append(float(row["success"]))
    return " / ".join(f"{sum(values) / len(values):.2f}" for values in success.values())


def mean(rows: Rows) -> float:
    """Mean success over all goals."""
    values = [float(row["success"]) for row in rows]
    return sum(values) / len(values)


def evaluation(run: Path, epoch: int) -> list[dict[str, str]]:
    """A run's rows, one per goal, after some epoch."""
    return [row for row in read_rows(run / "evaluations.csv") if int(row["epoch"]) == epoch]


def parts_table(whole: Iterable[Path], parts: Iterable[Path]) -> str:
    """One row per variant of the agent: success by layer of each seed, and the mean over goals and seeds."""
    runs = {"the whole agent": list(whole)}
    for part in parts:
        runs.setdefault(part.name.removeprefix("stack2-sac-").rpartition("-")[0], []).append(part)
    table = []
    for variant, of_variant in runs.items():
        found = [evaluation(run, PARTS_EPOCH) for run in of_variant]
        over_seeds = sum(map(mean, found)) / len(found)
        table.append([variant, ", ".join(map(by_layer, found)), f"{over_seeds:.2f}"])
    table = [table[0], *sorted(table[1:], key=lambda row: float(row[2]))]
    return markdown(["variant", "success by layer, a seed each", "mean"], table)


def sb3_table(path: Path) -> str:
    """A row a test of stable-baselines3's agent."""
    tests: dict[tuple[str, str, str], list[dict[str, str]]] = {}
    for row in read_rows(path):
        tests.setdefault((row["minutes"], row["steps"], row["updates"]), []).append(row)
    table = [[*head, by_layer(rows), f"{mean(rows):.2f}"] for head, rows in tests.items()]
    return markdown(["minutes of training", "steps", "updates", "success by layer", "mean"], table)


if __name__ == "__main__":
    page = DOCS / "presets.md"
    sac = ("sac",)
    tables = {
        "sac": final_table(load("v2"), sac),
        "longer": final_table(read_results([RUNS / "longer"]), sac),
        "biased starts": final_table(read_results([RUNS / "biased"]), sac),
        "parts": parts_table(sorted(RUNS.glob("biased/stack2-sac-[01]")), sorted(RUNS.glob("parts/*"))),
        "sb3 on stack2": sb3_table(RUNS / "sb3-stack2.csv"),
        "sb3 on stack3": sb3_table(RUNS / "sb3-stack3.csv"),
    }
    for name, table in tables.items():
        write_section(page, name, table, "make presets")
