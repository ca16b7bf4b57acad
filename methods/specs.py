"""Names of the built-in methods, and the text of method specs. Needs no torch and imports no method."""

BUILT_IN = {
    "icm": "icm:ICM",
    "rnd": "rnd:RND",
    "dac": "dac:DAC",
    "re3": "re3:RE3",
    "mi": "mi:MI",
    "decstr": "decstr:DECSTR",
    "mcher": "mcher:MultiCriteriaHER",
    "disagreement": "disagreement:Disagreement",
    "e3b": "e3b:E3B",
    "ride": "ride:RIDE",
    "ngu": "ngu:NGU",
    "counts": "counts:Counts",
}
"""Module and class in `curiobench.methods` of each built-in method, by spec. The one place to register a method.

Lists, tables and colours follow this order: append a new one."""

HYBRID = "+hm"
"""Behind a curiosity method's spec: that method under the hybrid policy mechanism."""

ALIASES = {"mihm": "mi+hm"}
"""Other names of specs; the paper calls its method MIHM."""


def canonical(text: str) -> str:
    """A spec's one form: aliases resolved, in lower case but for `package.module:Class`. It may still be unknown."""
    spec = text.strip() if ":" in text else text.strip().lower()
    spec = ALIASES.get(spec, spec)
    name, hybrid = split(spec)
    return name + HYBRID * hybrid


def split(spec: str) -> tuple[str, bool]:
    """The curiosity method's name in a spec, and whether the hybrid policy mechanism is around it."""
    hybrid = spec.lower().endswith(HYBRID)
    return (spec[: -len(HYBRID)] if hybrid else spec), hybrid


def shown(spec: str) -> str:
    """A spec as tables and figures show it: by its alias where it has one."""
    names = {spec: alias for alias, spec in ALIASES.items()}
    return names.get(canonical(spec), canonical(spec))
