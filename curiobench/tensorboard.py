"""Progress for TensorBoard, beside the csv files."""

from pathlib import Path
from typing import Any


def check_tensorboard() -> None:
    """Raises ValueError where the extra `tensorboard` is missing."""
    try:
        import torch.utils.tensorboard  # noqa: F401
    except ImportError:
        raise ValueError("--machine.tensorboard needs the extra: pip install 'curiobench[tensorboard]'") from None


class TensorBoardLog:
    """Writes rows of progress.csv as scalars."""

    def __init__(self, folder: Path, first_epoch: int) -> None:
        """
        Args:
            folder: created if it does not exist.
            first_epoch: the first that is to come; TensorBoard then hides later ones of before a kill.
        """
        from torch.utils.tensorboard import SummaryWriter  # seconds to import

        self._writer = SummaryWriter(str(folder), purge_step=first_epoch)

    def write(self, row: dict[str, Any]) -> None:
        """Add a row of progress.csv, empty fields left out."""
        for name, value in row.items():
            if value is not None and name != "epoch":
                self._writer.add_scalar(name, value, row["epoch"])
        self._writer.flush()

    def close(self) -> None:
        """Close the file."""
        self._writer.close()
