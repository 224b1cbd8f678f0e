"""How Sphinx builds the site: `sphinx-build -W --keep-going -n -c docs . build/site`, from the repository's folder.

The source folder is the repository itself, so that links between pages, README and studies are checked, with their
anchors. Pages stay plain Markdown: what is generated takes the place of a comment such as `<!-- settings -->`.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "docs")]

from site_api import api_page, as_rst, shown_signature  # noqa: E402
from site_formats import joint_names  # noqa: E402
from site_math import setup_math  # noqa: E402
from site_settings import settings_page  # noqa: E402

import hopdiff  # noqa: E402

project = "hopdiff"
author = project_copyright = "hopdiff contributors"
version = release = hopdiff.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc"]
root_doc = "docs/index"
include_patterns = ["docs/*.md", "README.md", "CHANGELOG.md", "CONTRIBUTING.md", "experiments/**.md"]
exclude_patterns = [".*", "build", "dist", "outputs", "multirun", "shared", "hopdiff", "tests", "conf", "*.egg-info"]

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3  # as GitHub makes them

nitpicky = True
# Names of other libraries: their pages are not fetched, so that the build needs no network.
nitpick_ignore_regex = [("py:.*", r"(torch|numpy|pathlib|os|collections|omegaconf|NDArray|Tensor|Path|Any)\b.*")]
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
add_module_names = False

html_theme = "furo"
html_title = f"hopdiff {release}"
html_copy_source = False
html_show_sphinx = False
html_math_renderer = "mathml"

CONTENTS = {
    "The guides": ("start", "animators", "researchers", "extending"),
    "Look it up": ("settings", "formats", "api", "results"),
    "The project": ("contributing", "README <../README>", "How the code is kept <../CONTRIBUTING>", "../CHANGELOG"),
}


def contents() -> str:
    """The tables of contents of the site, studies last."""
    pages = sorted(path.relative_to(ROOT).with_suffix("").as_posix() for path in ROOT.glob("experiments/*/*.md"))
    named = (f"{page.split('/')[1]}{'' if page.endswith('README') else ', tables'} </{page}>" for page in pages)
    parts = {**CONTENTS, "Studies": ("All studies </experiments/README>", *named)}
    return "\n\n".join(
        "\n".join(("```{toctree}", ":hidden:", f":caption: {caption}", "", *entries, "```"))
        for caption, entries in parts.items()
    )


GENERATED = {
    "docs/index": ("<!-- contents -->", contents),
    "docs/settings": ("<!-- settings -->", lambda: settings_page(ROOT / "conf")),
    "docs/api": ("<!-- api -->", api_page),
    "docs/formats": ("<!-- joint names -->", joint_names),
}


def put_in(app: Any, page: str, source: list[str]) -> None:
    """Put what is generated in the place of a page's comment, and a title above tables of studies that have none."""
    if page in GENERATED:
        mark, made = GENERATED[page]
        if mark not in source[0]:
            raise ValueError(f"{page}.md lacks its line {mark}")
        source[0] = source[0].replace(mark, made())
    elif not source[0].lstrip().startswith("# "):
        source[0] = f"# {' '.join(reversed(page.split('/')[1:]))}\n\n{source[0]}"


def made_anew(app: Any, env: Any, added: set[str], changed: set[str], removed: set[str]) -> list[str]:
    """Pages to be read again in every build: what they are made from is no page."""
    return list(GENERATED)


def front_door(app: Any, error: Exception | None) -> None:
    """An index.html at the top of the site, which leads to its first page."""
    if error is None and app.builder.format == "html":
        page = f'<!doctype html><title>hopdiff</title><meta http-equiv="refresh" content="0; url={root_doc}.html">\n'
        (Path(app.outdir) / "index.html").write_text(page, encoding="utf-8")


def setup(app: Any) -> dict[str, bool]:
    setup_math(app)
    app.connect("env-get-outdated", made_anew)
    app.connect("source-read", put_in)
    app.connect("autodoc-process-docstring", as_rst)
    app.connect("autodoc-process-signature", shown_signature)
    app.connect("build-finished", front_door)
    return {"parallel_read_safe": True}
