"""Writes the tables of docs/presets.md from the runs kept in results/agent: `make presets`."""

from collections.abc import Iterable
from pathlib import Path

from make_fidelity import markdown, replace_section

from curiobench.run_folder import read_rows

DOCS = Path(__file__).parent
RUNS = DOCS.parent / "results" / "agent"


def outcome(run: Path, epoch: int) -> list[str]:
    """Of a run after some epoch: updates, minutes, success a layer, learned goals of all."""
    progress = next(row for row in read_rows(run / "progress.csv") if int(row["epoch"]) == epoch)
    rows = [row for row in read_rows(run / "evaluations.csv") if int(row["epoch"]) == epoch]
    success: dict[str, list[float]] = {}
    for row in rows:
        success.setdefault(row["layer"], []).append(float(row["success"]))
    layers = " / ".join(f"{sum(values) / len(values):.2f}" for values in success.values())
    mean = sum(float(row["success"]) for row in rows) / len(rows)
    learned = f"{sum(int(row['learned']) for row in rows)} of {len(rows)}"
    return [progress["updates"], f"{float(progress['seconds']) / 60:.1f}", layers, f"{mean:.2f}", learned]


def evaluated(run: Path) -> list[int]:
    """Epochs after which a run was evaluated, the untrained agent apart."""
    return sorted({int(row["epoch"]) for row in read_rows(run / "evaluations.csv")} - {0})


def curve_table(runs: Iterable[Path]) -> str:
    """A row a run and evaluation."""
    rows = [[run.name, str(epoch), *outcome(run, epoch)] for run in runs for epoch in evaluated(run)]
    return markdown(["run", "epoch", "updates", "minutes", "success by layer", "mean", "learned"], rows)


if __name__ == "__main__":
    page = DOCS / "presets.md"
    tables = {
        "stack2": curve_table(sorted(RUNS.glob("stack2-*"))),
        "stack3": curve_table(sorted(RUNS.glob("stack3-*"))),
    }
    for name, table in tables.items():
        page.write_text(replace_section(page.read_text(), name, table, command="make presets"))
