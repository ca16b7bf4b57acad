"""The docs site, which `make docs` builds from the README, docs/, the READMEs in results/ and docstrings."""

# Put below pages for the sidebar, and to widen one with wide tables; here, because GitHub shows the pages, too.
CONTENTS = {
    "README": """
```{toctree}
:hidden:
:caption: Use

docs/tasks
docs/training
docs/presets
docs/grids
docs/results
docs/figures
docs/frames
docs/publishing
docs/agents
docs/notebook
docs/api
```

```{toctree}
:hidden:
:caption: Methods

docs/methods/README
docs/new_method
docs/probes
```

```{toctree}
:hidden:
:caption: Background

results/README
docs/fidelity
docs/features
docs/code
```
""",
    "docs/methods/README": """
```{toctree}
:glob:

[a-z]*
```
""",
    "docs/features": """
```{raw} html
<style>.content { flex: 1; max-width: 72em; min-width: 0 } td, th { font-size: 0.85em }</style>
```
""",
    "results/README": """
```{toctree}
:hidden:
:glob:

v*/README
v*/agents/README
```
""",
}

project = html_title = "curiobench"
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
include_patterns = [
    "README.md",
    "docs/**.md",
    "docs/*.rst",
    "docs/*.ipynb",
    "results/README.md",
    "results/v*/README.md",
    "results/v*/agents/README.md",
]
root_doc = "README"
myst_enable_extensions = ["html_image"]
nb_execution_mode = "off"  # the notebook has its outputs; `make notebook` makes them
myst_heading_anchors = 4  # links to headings, as GitHub makes them
highlight_language = "text"  # of blocks that name none
default_role = "code"  # of docstrings
autodoc_member_order = "bysource"
html_theme = "furo"
html_show_copyright = False
html_static_path, html_css_files = ["site"], ["notebook.css"]


def setup(app):
    app.connect("source-read", lambda app, page, source: source.append(source.pop() + CONTENTS.get(page, "")))
