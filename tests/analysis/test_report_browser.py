"""The HTML report in a real browser, if there is one: its script runs, tables sort, nothing sticks out on a phone."""

import base64
import hashlib
import html
import json
import re
import shutil
import subprocess

import pytest
from synthetic import write_runs

from curiobench.analysis.report import write_report

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
PHONE, DESKTOP = 390, 1280

pytestmark = [pytest.mark.slow, pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")]


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """The report on five methods × two seeds on three blocks."""
    folder = tmp_path_factory.mktemp("browser")
    write_runs(folder / "runs", tasks=("stack3",), methods=("sac", "icm", "rnd+hm", "mihm", "a.b:LongName"), seeds=2)
    write_report([folder / "runs"], folder / "page.html")
    return folder / "page.html"


def visit(page, script: str, width: int = DESKTOP):
    """The value of `script`, the body of a function, on the page in a frame: no window is as narrow as a phone."""
    script = f"parent.postMessage(JSON.stringify((() => {{ {script} }})()), '*');"
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    text = page.read_text().replace("script-src '", f"script-src 'sha256-{digest}' '", 1)
    framed, host = page.with_name("framed.html"), page.with_name("host.html")
    framed.write_text(text.replace("</body>", f"<script>{script}</script></body>"))
    host.write_text(
        f"""<body><script>onmessage = (event) => {{ document.body.dataset.answer = event.data; }};</script>
        <iframe src="framed.html" style="width: {width}px; height: 844px; border: 0"></iframe></body>"""
    )
    command = [
        *(CHROMIUM, "--headless=new", "--no-sandbox", "--disable-gpu", f"--user-data-dir={page.parent / 'profile'}"),
        *("--hide-scrollbars", "--virtual-time-budget=5000", "--dump-dom", host.as_uri()),
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    return json.loads(html.unescape(re.search(r'data-answer="([^"]*)"', done.stdout)[1]))


NAMES_IN_ORDER = "[...table.tBodies[0].rows].map((row) => row.cells[0].textContent)"


def test_tables_sort_by_click_and_mark_the_order(page):
    names, largest, smallest, sorts = visit(
        page,
        f"""const table = document.querySelector("table.sortable");
        const names = {NAMES_IN_ORDER}, last = table.tHead.rows[0].cells.length - 1;
        const head = table.tHead.rows[0].cells[last], answers = [], sorts = [head.ariaSort];
        for (let turn = 0; turn < 2; turn++) {{
          head.querySelector("button").click();
          answers.push({NAMES_IN_ORDER}); sorts.push(head.ariaSort);
        }}
        return [names, ...answers, sorts];""",
    )
    assert names == ["sac", "icm", "mihm", "rnd+hm", "a.b:LongName"]
    assert sorts == ["none", "descending", "ascending"]
    assert largest[0] == "a.b:LongName"  # longer names learn more in synthetic runs
    assert smallest[-1] == "a.b:LongName"
    assert sorted(largest) == sorted(names)


def test_the_keyboard_reaches_what_the_mouse_does(page):
    unreachable = visit(
        page,
        """return [...document.querySelectorAll("th[aria-sort] button, .toggle, #expand, #filter, summary, .scroll")]
        .filter((element) => element.tabIndex < 0).map((element) => element.outerHTML);""",
    )
    assert unreachable == []


@pytest.mark.parametrize("width", [PHONE, DESKTOP])
def test_nothing_sticks_out(page, width):
    inner, content, outside = visit(
        page,
        """document.querySelectorAll("details").forEach((box) => { box.open = true; });
        document.getElementById("expand").click();
        const width = document.documentElement.clientWidth;
        const outside = [...document.querySelectorAll("main *")].filter((element) =>
          element.getBoundingClientRect().right > width + 1 && !element.closest(".scroll, .paper"));
        return [width, document.documentElement.scrollWidth, outside.map((element) => element.outerHTML)];""",
        width,
    )
    assert inner == width
    assert content <= inner
    assert outside == []


def test_commands_unfold_and_the_list_filters(page):
    folded, opened, all_open, shown, count = visit(
        page,
        """const more = [...document.querySelectorAll(".more")], hidden = () => more.filter((row) => row.hidden).length;
        const folded = hidden();
        document.querySelector(".toggle").click();
        const opened = hidden();
        document.getElementById("expand").click();
        const all = hidden(), filter = document.getElementById("filter");
        filter.value = "mihm";
        filter.dispatchEvent(new Event("change"));
        const bodies = [...document.querySelectorAll("table.runs tbody")].filter((body) => !body.hidden);
        return [folded, opened, all, bodies.map((body) => body.dataset.method),
          document.getElementById("shown").textContent];""",
    )
    assert (folded, opened, all_open) == (10, 9, 0)
    assert shown == ["mihm", "mihm"]
    assert count == "2 of 10 runs"
