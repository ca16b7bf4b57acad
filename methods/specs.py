"""Names of the built-in methods, and the text of method specs. Needs no torch and imports no method."""

from importlib.metadata import entry_points
from typing import NamedTuple


class BuiltIn(NamedTuple):
    """A built-in method."""

    place: str  # module and class, as `module:Class`, in curiobench.methods
    line: str  # what it does, and its paper
    rewards: bool = True  # whether it has an intrinsic reward, which `+hm` requires


BUILT_IN = {
    "icm": BuiltIn(
        "icm:ICM",
        "rewards transitions that a forward model predicts badly, among features that actions influence "
        "(Pathak et al. 2017, arXiv 1705.05363)",
    ),
    "rnd": BuiltIn(
        "rnd:RND",
        "rewards next states in which a trained network cannot yet imitate a random one "
        "(Burda et al. 2018, arXiv 1810.12894)",
    ),
    "dac": BuiltIn(
        "dac:DAC",
        "rewards actions that neither the policy nor the replay buffer would take in a state, for a goal "
        "(Han and Sung 2021, arXiv 2006.01419)",
    ),
    "re3": BuiltIn(
        "re3:RE3",
        "rewards next states whose nearest neighbours in a random feature space are far "
        "(Seo et al. 2021, arXiv 2102.09430)",
    ),
    "mi": BuiltIn(
        "mi:MI",
        "rewards next states that are rare, but could be predicted from state and action "
        "(Han et al. 2023, doi 10.3389/fnbot.2023.1089270)",
    ),
    "decstr": BuiltIn(
        "decstr:DECSTR",
        "no intrinsic reward: goals and replay are drawn from buckets in which learning progresses "
        "(Akakzia et al. 2021, arXiv 2006.07185)",
        rewards=False,
    ),
    "mcher": BuiltIn(
        "mcher:MultiCriteriaHER",
        "no intrinsic reward: hindsight relabels the predicates of each pair of blocks on their own "
        "(Lanier et al. 2019, arXiv 1906.03710)",
        rewards=False,
    ),
    "disagreement": BuiltIn(
        "disagreement:Disagreement",
        "rewards transitions about which forward models that learned from the same data disagree "
        "(Pathak et al. 2019, arXiv 1906.04161)",
    ),
    "e3b": BuiltIn(
        "e3b:E3B",
        "rewards next states unlike those before them in the episode, among features that actions influence "
        "(Henaff et al. 2022, arXiv 2210.05805)",
    ),
    "ride": BuiltIn(
        "ride:RIDE",
        "rewards large changes among features that actions influence, less for what the episode has met before "
        "(Raileanu and Rocktäschel 2020, arXiv 2002.12292)",
    ),
    "ngu": BuiltIn(
        "ngu:NGU",
        "rewards next states far from all that the episode met before, among features that actions influence "
        "(Badia et al. 2020, arXiv 2002.06038)",
    ),
    "counts": BuiltIn(
        "counts:Counts",
        "rewards semantic configurations that were seldom reached: a simple baseline "
        "(Strehl and Littman 2008, doi 10.1016/j.jcss.2007.08.009)",
    ),
}
"""Built-in methods by spec. A new method is registered here and nowhere else.

Lists, tables and colours follow this order, so append the new method at the end."""

HYBRID = "+hm"
"""Suffix of a curiosity method's spec that adds the hybrid policy mechanism."""

ALIASES = {"mihm": "mi+hm"}
"""Other names of specs; the paper calls its method MIHM."""

GROUP = "curiobench.methods"
"""Entry-point group in which installed packages register their methods."""


def installed_methods() -> dict[str, list[str]]:
    """Methods of installed packages: the `package.module:Class` of each lower-case name. Imports none of them."""
    found: dict[str, set[str]] = {}
    for point in entry_points(group=GROUP):
        found.setdefault(point.name.lower(), set()).add(point.value.partition("[")[0].strip())
    return {name: sorted(found[name]) for name in sorted(found)}


def available_specs() -> list[str]:
    """Every spec with a name, aliases last: built in, or provided by an installed package."""
    installed = [name for name in installed_methods() if name not in {"sac", *BUILT_IN, *ALIASES}]
    rewards = [*(spec for spec, method in BUILT_IN.items() if method.rewards), *installed]
    goal_methods = [spec for spec, method in BUILT_IN.items() if not method.rewards]
    return ["sac", *rewards, *goal_methods, *(spec + HYBRID for spec in rewards), *ALIASES]


def canonical(text: str) -> str:
    """Canonical form of a spec: aliases resolved, lower case except for `package.module:Class`. It may be unknown."""
    spec = text.strip() if ":" in text else text.strip().lower()
    spec = ALIASES.get(spec, spec)
    name, hybrid = split(spec)
    return name + HYBRID * hybrid


def split(spec: str) -> tuple[str, bool]:
    """The method's name in a spec, and whether the spec ends in `+hm`."""
    hybrid = spec.lower().endswith(HYBRID)
    return (spec[: -len(HYBRID)] if hybrid else spec), hybrid


def display_name(spec: str) -> str:
    """Name of a method spec in tables and figures: its alias if it has one."""
    names = {spec: alias for alias, spec in ALIASES.items()}
    return names.get(canonical(spec), canonical(spec))
