"""Writes the tables of docs/presets.md from the runs kept in results/: `make presets`."""

from pathlib import Path

from make_fidelity import markdown, replace_section

from curiobench.config import PRESETS
from curiobench.run_folder import read_config, read_rows

DOCS = Path(__file__).parent
RESULTS = DOCS.parent / "results"
COMPARED_AT = 12
"""Epochs after which the variants are compared."""


def variants_table() -> str:
    """A row for each run of the preset search, and for the laptop run at the same epochs."""
    runs = [RESULTS / "laptop" / "stack2-sac-0", *sorted((RESULTS / "preset-search").iterdir())]
    rows = []
    for run in runs:
        progress = {int(row["epoch"]): row for row in read_rows(run / "progress.csv")}
        values = [f"{float(progress[epoch]['training_success_unsatisfied']):.3f}" for epoch in (4, 8, COMPARED_AT)]
        rows.append([_overrides(run), *values, f"{float(progress[COMPARED_AT]['q']):.1f}"])
    return markdown(["laptop preset with", *(f"epoch {epoch}" for epoch in (4, 8, COMPARED_AT)), "Q at 12"], rows)


def _overrides(run: Path) -> str:
    """The settings in which a run differs from the laptop preset, its length aside."""
    config, preset = read_config(run).to_json(), PRESETS["laptop"].to_json()
    changed = [
        f"{part}.{name} = {value}"
        for part in ("sac", "replay")
        for name, value in config[part].items()
        if value != preset[part][name]
    ]
    return ", ".join(changed) or "nothing changed"


def laptop_table() -> str:
    """Success of each goal in the laptop runs, every tenth epoch."""
    rows = []
    for run in sorted((RESULTS / "laptop").iterdir()):
        evaluations = read_rows(run / "evaluations.csv")
        last = max(int(row["epoch"]) for row in evaluations)
        goals = list(dict.fromkeys(row["goal"] for row in evaluations))
        for epoch in [*range(0, last, 10), last]:
            success = {row["goal"]: row["success"] for row in evaluations if int(row["epoch"]) == epoch}
            rows.append([run.name, str(epoch), *(f"{float(success[goal]):.2f}" for goal in goals)])
    return markdown(["run", "epoch", *goals], rows)


if __name__ == "__main__":
    page = DOCS / "presets.md"
    for name, table in (("variants", variants_table), ("laptop", laptop_table)):
        page.write_text(replace_section(page.read_text(), name, table(), command="make presets"))
