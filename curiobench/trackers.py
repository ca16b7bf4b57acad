"""Rows of progress.csv for TensorBoard, Weights & Biases and MLflow. They cannot change or stop the run."""

import hashlib
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from curiobench.config import RunConfig
from curiobench.options import flatten
from curiobench.run_folder import read_record


class TensorBoard:
    """Writes `tensorboard/` in the run folder. Rows that a resumed run makes again are hidden."""

    def __init__(self, config: RunConfig, folder: Path, first_epoch: int) -> None:
        from torch.utils.tensorboard import SummaryWriter  # seconds to import

        self._writer = SummaryWriter(str(folder / "tensorboard"), purge_step=first_epoch)

    def log(self, values: Mapping[str, float], epoch: int) -> None:
        for name, value in values.items():
            self._writer.add_scalar(name, value, epoch)
        self._writer.flush()

    def close(self) -> None:
        self._writer.close()


class WandB:
    """Writes `wandb/` in the run folder, for `wandb sync`; sends instead where WANDB_MODE is online."""

    def __init__(self, config: RunConfig, folder: Path, first_epoch: int) -> None:
        os.environ.setdefault("WANDB_ERROR_REPORTING", "false")  # to its makers
        import wandb

        self._run = wandb.init(
            mode=os.environ.get("WANDB_MODE", "offline"),
            project=os.environ.get("WANDB_PROJECT", "curiobench"),
            group=f"{config.task} {config.method}",
            name=folder.resolve().name,
            id=_identity(config, folder),
            resume="allow",
            dir=folder,
            config=config.to_json(),
            settings=wandb.Settings(console="off", silent=True),
        )

    def log(self, values: Mapping[str, float], epoch: int) -> None:
        self._run.log(dict(values), step=epoch)

    def close(self) -> None:
        self._run.finish()


class MLflow:
    """Logs to MLFLOW_TRACKING_URI, or to `mlflow.db` in the run folder where it is not set."""

    def __init__(self, config: RunConfig, folder: Path, first_epoch: int) -> None:
        os.environ.setdefault("MLFLOW_DISABLE_TELEMETRY", "true")
        from mlflow import MlflowClient
        from mlflow.entities import Param

        uri = os.environ.get("MLFLOW_TRACKING_URI") or f"sqlite:///{folder.resolve() / 'mlflow.db'}"
        name, identity = os.environ.get("MLFLOW_EXPERIMENT_NAME", "curiobench"), _identity(config, folder)
        self._client = MlflowClient(uri)
        known = self._client.get_experiment_by_name(name)
        experiment = known.experiment_id if known else self._client.create_experiment(name)
        if found := self._client.search_runs([experiment], f"tags.curiobench = '{identity}'"):
            self._run = found[0].info.run_id
            self._client.update_run(self._run, status="RUNNING")
            return
        tags = {"curiobench": identity}
        self._run = self._client.create_run(experiment, tags=tags, run_name=folder.resolve().name).info.run_id
        params = [Param(name, str(value)) for name, value in flatten(config.to_json()).items()]
        self._client.log_batch(self._run, params=params)

    def log(self, values: Mapping[str, float], epoch: int) -> None:
        from mlflow.entities import Metric

        at = int(time.time() * 1000)
        self._client.log_batch(self._run, [Metric(name, value, at, epoch) for name, value in values.items()])

    def close(self) -> None:
        self._client.set_terminated(self._run)


TRACKERS = {"tensorboard": TensorBoard, "wandb": WandB, "mlflow": MLflow}
"""By the name of the module, of the extra that installs it, and in `--machine.track`.

Each is made from a run's config, its folder, and the first epoch to log. `log` takes the numbers of an epoch.
`close` is called at the end of the run, finished or not. All of these may raise anything.
"""


class Trackers:
    """The trackers of a run. One that fails is named in a line and left out from then on."""

    def __init__(self, config: RunConfig, folder: Path, first_epoch: int, note: Callable[[str], None]) -> None:
        """
        Args:
            config: of the run.
            folder: of the run.
            first_epoch: the first that is to come.
            note: shows a line.
        """
        self._note = note
        self._trackers: dict[str, Any] = {}
        for name in config.machine.trackers:
            with self._left_out_on_error(name):
                self._trackers[name] = TRACKERS[name](config, folder, first_epoch)

    def log(self, row: Mapping[str, Any]) -> None:
        """Called with every row of progress.csv."""
        values = {name: float(value) for name, value in row.items() if value is not None and name != "epoch"}
        for name, tracker in list(self._trackers.items()):
            with self._left_out_on_error(name):
                tracker.log(values, row["epoch"])

    def close(self) -> None:
        """The run ends."""
        for name, tracker in list(self._trackers.items()):
            with self._left_out_on_error(name):
                tracker.close()

    @contextmanager
    def _left_out_on_error(self, name: str) -> Iterator[None]:
        try:
            yield
        except Exception as error:  # a full disk, no network, or whatever else they do
            self._trackers.pop(name, None)
            self._note(f"{name} tracks no longer: {' '.join(str(error).split()) or type(error).__name__}")


def check_installed(names: Sequence[str]) -> None:
    """Raises ValueError where the extra of a tracker is missing."""
    for name in names:
        if find_spec(name) is None:
            raise ValueError(f"--machine.track {name} needs the extra: pip install 'curiobench[{name}]'")


def _identity(config: RunConfig, folder: Path) -> str:
    """Of a run in trackers: the same after a resume, another for a copy of its folder."""
    text = f"{read_record(folder).get('created')} {config.fingerprint()} {folder.resolve()}"
    return hashlib.sha256(text.encode(errors="backslashreplace")).hexdigest()[:16]
