"""What a report says about how its numbers are made, and how they are cited."""

from collections.abc import Sequence

DEFINITIONS = (
    (
        "Success",
        "At an evaluation every goal is tested from plain starts by the deterministic policy. An episode succeeds if "
        "exactly the goal's predicates hold after its last, 50th step. The test starts are the same for every run. "
        "Final success is that of the last evaluation, mean over goals.",
    ),
    ("Learned", "A goal is learned at an evaluation if more than 80 % of its test episodes succeed."),
    ("Layer", "Height of a goal's tallest stack, in blocks."),
    (
        "IQM of final success",
        "Interquartile mean: of the final successes of all goals and seeds, the mean of the middle half. It depends "
        "less than the mean on goals that everybody or nobody learns and on a lucky seed.",
    ),
    (
        "Success over training",
        "Normalised area under the learning curve (AUC): success, mean over goals, averaged over training from its "
        "beginning to its end. It tells who learns early where all end alike.",
    ),
    (
        "Epochs to 0.8",
        "Epochs until the first evaluation at which the mean success is 0.8, mean over the seeds that get there.",
    ),
    (
        "[ ]",
        "95 % percentile interval of a stratified bootstrap over seeds, with a fixed seed of its own. With few seeds "
        "it is too narrow: three runs show little of how far runs differ.",
    ),
    (
        "P(final > baseline), P(over training > baseline)",
        "Probability of improvement: the chance that a run of the method, drawn at random, has more final success, or "
        "more success over training, than one of the baseline; ties count half. 0.5 is no difference.",
    ),
    (
        "Hours and memory",
        "Wall-clock time of a run's own work, mean over seeds, and the largest memory of any of its processes; both "
        "depend on the machine and on what else it had to do.",
    ),
)
"""Terms and what they mean."""

PAPER = (
    "Han, C., Peng, Z., Liu, Y., Tang, J., Yu, Y., Zhou, Z. (2023). Learning robotic manipulation skills with multiple "
    "semantic goals by conservative curiosity-motivated exploration. Frontiers in Neurorobotics 17. "
    "doi:10.3389/fnbot.2023.1089270"
)


def citation(versions: Sequence[str]) -> tuple[str, ...]:
    """The benchmark, in the versions that the runs were made with, and the paper that it follows."""
    told = f", version {' and '.join(versions)}" if versions else ""
    return (
        "The curiobench authors (2026). curiobench: a benchmark of curiosity methods for sparse-reward robot "
        f"manipulation{told}.",
        PAPER,
    )
