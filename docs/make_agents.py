"""Writes docs/agents.md, a page with a video of every agent of a published set: `make agents SET=results/v2`."""

import sys
from pathlib import Path

import pandas as pd
from sections import DOCS

from curiobench.analysis.folders import AGENTS, agents_of
from curiobench.analysis.frames import read_results
from curiobench.run_folder import read_record
from curiobench.saved_agent import load_agent
from curiobench.tasks.registration import task_spec
from curiobench.video import film

PICTURES = DOCS / "images" / "agents"
HEAD = """# Trained agents

One agent per task and method, from the published set `{name}`. Its [README](../results/{name}/agents/README.md) names
the run of each. Each video shows one episode, from seed 0, with the first of the tallest goals.
`make agents SET=results/{name}` writes this page.

```
curiobench video {name} --method mihm --task stack3 --goal "a on b on c"   # films one
curiobench evaluate {name}/stack3/mihm                                   # its success on all goals
```

`curiobench.load_agent("{name}/stack3/mihm")` gives it to Python ([more](publishing.md#agents)).

| agent | goal | success in 25 tests | reached in the video | video |
|---|---|---|---|---|
"""


def row(folder: Path, name: str, tests: pd.DataFrame) -> str:
    """A row of the table; makes a video of the agent of this name. `tests` has the set's last evaluations."""
    trained = read_record(folder / AGENTS / name)["config"]
    config, agent = load_agent(folder / trained["task"] / trained["method"])
    space = task_spec(config.task).goal_space
    goal = space.names[int(space.layers.argmax())]
    picture, reached = film(agent, config, goal, PICTURES / f"{name}.webp", folder)
    of_method = tests[tests["task"].str.cat(tests["method"].astype(str), "-") == name]
    of_method = of_method[(of_method["seed"] == config.seed) & (of_method["variant"] == "")]
    success = of_method.set_index("goal")["success"][goal]
    link = f'<img width="240" src="{picture.relative_to(DOCS)}" alt="{name}: {goal}">'
    return f"| {name} | {goal} | {success:.2f} | {'yes' if reached else 'no'} | {link} |\n"


def main() -> None:
    """Write the page."""
    folder = Path(sys.argv[1]).resolve()
    tests = read_results([folder], every_goal=False).evaluations
    rows = [row(folder, name, tests) for name in agents_of(folder)]
    (DOCS / "agents.md").write_text(HEAD.format(name=folder.name) + "".join(rows), encoding="utf-8")


if __name__ == "__main__":
    main()
