"""Builds the site: collects the pages in build/docs, then runs Sphinx with warnings as errors."""

import shutil
import sys

from sphinx.cmd.build import build_main

from docs.website import api, commands, pages
from docs.website.pages import CONFIGURATION, DOCTREES, PAGES, SITE


def main() -> int:
    """Build the site and return the exit status: 0, or 1 after a warning such as a broken link."""
    # Each build starts anew, because Sphinx reports the warnings of a page only when it reads the page.
    for folder in (PAGES, DOCTREES, SITE):
        shutil.rmtree(folder, ignore_errors=True)
    parts = {"commands": commands.part(), "api": api.part()}
    for part, lines_of in parts.items():
        for name, lines in lines_of.items():
            pages.write_page(PAGES / part / f"{name}.md", "\n".join(lines))
    pages.write(PAGES, [f"{part}/index" for part in parts])
    options = ["--quiet", "--fail-on-warning", "--keep-going", "--jobs", "2"]
    folders = ["--conf-dir", str(CONFIGURATION), "--doctree-dir", str(DOCTREES), str(PAGES), str(SITE)]
    status = build_main([*options, *folders])
    if status == 0:
        print(f"site: {SITE / 'index.html'}")
    return status


if __name__ == "__main__":
    sys.exit(main())
