"""Whether a curiosity method follows the rules, and a template to write one from."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Finding:
    """What was found for one property, as `curiobench check` and `curiobench submit-check` print it."""

    property: str
    """The rule."""
    verdict: str
    """pass, FAIL, skip or warn."""
    detail: str = ""
    """What was expected and found, why it was skipped, or what was measured; a line a fault."""

    def __str__(self) -> str:
        return "\n      ".join([f"{self.verdict}  {self.property}", *self.detail.splitlines()])


class Skipped(Exception):
    """A rule does not apply; says why."""
