"""Tables that scripts write into pages."""

from pathlib import Path

DOCS = Path(__file__).parent


def markdown(head: list[str], rows: list[list[str]]) -> str:
    """A table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def write_section(page: Path, name: str, content: str, command: str) -> None:
    """Replace what stands between the markers of section `name` of a page."""
    begin, end = f"<!-- {name}: made by `{command}` -->", f"<!-- end of {name} -->"
    before, rest = page.read_text().split(begin)
    page.write_text(before + begin + "\n" + content + "\n" + end + rest.split(end)[1])
