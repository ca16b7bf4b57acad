"""Tunes ICM on two blocks with Optuna: `python examples/tune.py runs/tune 20` makes 20 trials of one seed.

The study lies in `runs/tune/study.db`: the same command makes 20 more, after a kill, or beside another. A trial ends
after an epoch in which its success is below the median of those before it. Compare the winner on other seeds than this.
Words behind the number are options of `curiobench train`, such as preset=smoke. Needs the extra `tune`.
"""

import sys
from pathlib import Path

import optuna

import curiobench

if len(sys.argv) < 3 or not all("=" in word for word in sys.argv[3:]):
    sys.exit("usage: tune.py FOLDER TRIALS [OPTION=VALUE …]")
OUT, TRIALS = Path(sys.argv[1]), int(sys.argv[2])
EPOCHS = 6  # of the preset `laptop`, which evaluates after each
OPTIONS = {"machine.keep-replay": True, "evaluate-every": 1} | dict(word.split("=", 1) for word in sys.argv[3:])


def objective(trial: optuna.Trial) -> float:
    """Mean success over all goals after the last epoch; a run that is made longer has the numbers of a long one."""
    settings = {
        "method.learning-rate": trial.suggest_float("learning-rate", 1e-4, 1e-2, log=True),
        "method.hidden": trial.suggest_categorical("hidden", [32, 64, 128]),
    }
    for epoch in range(1, EPOCHS + 1):
        options = OPTIONS | settings | {"epochs": epoch}
        run = curiobench.train("stack2", "icm", out=OUT / f"trial-{trial.number}", resume=True, options=options)
        success = run.evaluations.query("epoch == @epoch")["success"].mean()
        trial.report(success, epoch)
        if trial.should_prune():
            raise optuna.TrialPruned
    return success


OUT.mkdir(parents=True, exist_ok=True)
pruner = optuna.pruners.MedianPruner(n_startup_trials=5)
study = optuna.create_study(
    study_name="icm", storage=f"sqlite:///{OUT}/study.db", direction="maximize", load_if_exists=True, pruner=pruner
)
study.optimize(objective, n_trials=TRIALS)
print(f"{len(study.trials)} trials, the best {study.best_value:.3f} with {study.best_params}")
