"""Folders of the site's build."""

from pathlib import Path

ROOT = Path(__file__).parents[2]
CONFIGURATION = Path(__file__).parent
PAGES = ROOT / "build" / "docs" / "pages"  # copies of the committed pages, and the generated ones
DOCTREES = ROOT / "build" / "docs" / "doctrees"
SITE = ROOT / "build" / "site"
