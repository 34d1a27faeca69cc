"""Collects the committed pages: copies them for Sphinx, and makes the navigation from docs/README.md.

Three rules turn pages of GitHub into pages of the site:
- README.md is the index of its folder, so README.md of the repository is the front page.
- A link to a file of the repository that is neither page nor picture leads to a page with the file's text; a link to a
  folder leads to the list of its files.
- Each table row of docs/README.md is an entry of the navigation under the heading of its section. The first link of the
  row is the page; the others are below it.
"""

import os
import re
import shutil
import subprocess
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path, PurePosixPath

# folders of the site's build
ROOT = Path(__file__).parents[2]
CONFIGURATION = Path(__file__).parent
PAGES = ROOT / "build" / "docs" / "pages"  # copies of the committed pages, and the generated ones
DOCTREES = ROOT / "build" / "docs" / "doctrees"
SITE = ROOT / "build" / "site"

INDEX = PurePosixPath("docs/README.md")
FRONT = "README.md"
PICTURES = (".gif", ".jpg", ".png", ".svg")
LINK = re.compile(r"\]\((?![a-z]+:|#)([^()\s#]+)(#[^()\s]*)?\)")  # a link that stays in the repository
TITLED = re.compile(r"(?<!!)\[([^\]]+)\]\((?![a-z]+:|#)([^()\s#]+\.md)\)")  # a link to a page, with its text
FENCE = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)
FILES = PurePosixPath("files")  # folder of the pages that show files
LANGUAGES = {".py": "python", ".toml": "toml", ".json": "json"}


def write(folder: Path, generated: Sequence[str]) -> None:
    """Write the pages of the repository into a folder. `generated`: index pages of the generated parts."""
    committed = _committed()
    names = [name for name in committed if name.suffix == ".md" and (name.parts[0] == "docs" or len(name.parts) == 1)]
    children = dict(_children(_rows()))
    shown: set[PurePosixPath] = set()
    for name in names:
        text = outside_fences((ROOT / name).read_text(encoding="utf-8"), partial(relinked, page=name, shown=shown))
        if name in children:
            text += _toctree(name, "", children[name])
        if str(name) == FRONT:
            text += navigation(generated)
        write_page(folder / _page(name), text)
    for name in committed:
        if name.suffix in PICTURES and name.parts[0] == "docs":
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(ROOT / name, folder / name)
    below = {folder: [file for file in committed if file.parent == folder] for folder in shown - set(committed)}
    for name, files in below.items():
        write_page(folder / _file_page(name), _folder_text(name, files))
    for name in shown.union(*below.values()) - set(below):
        write_page(folder / _file_page(name), _file_text(name))


def _committed() -> list[PurePosixPath]:
    """Return the files of the repository: those that git tracks, and new files that git does not ignore."""
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard", "--deduplicate"]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    return sorted(PurePosixPath(line) for line in listed.splitlines() if (ROOT / line).is_file())


def _page(name: PurePosixPath) -> PurePosixPath:
    return name.with_name("index.md") if name.name == "README.md" else name


def _file_page(name: PurePosixPath) -> PurePosixPath:
    return FILES / name.parent / f"{name.name}.md"


def write_page(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")


def outside_fences(text: str, change: Callable[[str], str]) -> str:
    """Return a page after applying `change` to all text that is not in a block of code."""
    parts, end = [], 0
    for fence in FENCE.finditer(text):
        parts += [change(text[end : fence.start()]), fence[0]]
        end = fence.end()
    return "".join([*parts, change(text[end:])])


def _target(page: PurePosixPath, link: str) -> PurePosixPath:
    """Return the target of a link of a page, as a path from the repository's root."""
    return PurePosixPath(os.path.normpath(page.parent / link))


def _relative(page: PurePosixPath, target: PurePosixPath) -> str:
    return PurePosixPath(os.path.relpath(target, page.parent)).as_posix()


def relinked(text: str, page: PurePosixPath, shown: set[PurePosixPath]) -> str:
    """Return a page's text with links that work on the site. Adds files that need a page of their own to `shown`."""

    def relink(found: re.Match[str]) -> str:
        target, anchor = _target(page, found[1]), found[2] or ""
        if not (ROOT / target).exists() or target.suffix in PICTURES:
            return found[0]
        if target.suffix == ".md":
            return f"]({_relative(page, _page(target))}{anchor})"
        shown.add(target)
        return f"]({_relative(page, _file_page(target))}{anchor})"

    return LINK.sub(relink, text)


def _folder_text(name: PurePosixPath, files: Sequence[PurePosixPath]) -> str:
    """Return a page with the names of a folder's files, with links to their texts."""
    page = _file_page(name)
    return _titled(name, "\n".join(f"- [`{file.name}`]({_relative(page, _file_page(file))})" for file in files))


def _file_text(name: PurePosixPath) -> str:
    """Return a page with the text of a file."""
    text = (ROOT / name).read_text(encoding="utf-8")
    return _titled(name, f"`````{LANGUAGES.get(name.suffix, 'text')}\n{text}\n`````")


def _titled(name: PurePosixPath, text: str) -> str:
    """Return a page with a title. The navigation does not list the page."""
    return f"---\norphan: true\n---\n# {name}\n\n{text}\n"


Link = tuple[str, PurePosixPath]  # text and page


def _rows() -> Iterator[tuple[str, list[Link]]]:
    """Yield (heading, links to pages) from docs/README.md. The links of a table row stay together."""
    heading = "Start"
    for line in (ROOT / INDEX).read_text(encoding="utf-8").splitlines():
        if line.startswith("## "):
            heading = line.removeprefix("## ")
        links = [(text[0].upper() + text[1:], _target(INDEX, path)) for text, path in TITLED.findall(line)]
        if links and line.startswith("|"):
            yield heading, links
        else:
            yield from ((heading, [link]) for link in links)


def _children(rows: Iterator[tuple[str, list[Link]]]) -> Iterator[tuple[PurePosixPath, list[Link]]]:
    """Yield the first page of each row with several pages, and the pages below it."""
    for _, (first, *others) in rows:
        if others:
            yield first[1], others


def _toctree(page: PurePosixPath, caption: str, links: Sequence[Link]) -> str:
    entries = [f"{text} <{_relative(page, _page(target).with_suffix(''))}>" for text, target in links]
    return "\n".join(["\n```{toctree}", ":hidden:", *([f":caption: {caption}"] if caption else []), *entries, "```\n"])


def navigation(generated: Sequence[str]) -> str:
    """Return the navigation of the front page: a part for each section of docs/README.md, then the generated parts."""
    sections: dict[str, list[Link]] = {}
    for heading, links in _rows():
        sections.setdefault(heading, []).append(links[0])
    sections["Start"].insert(0, ("All pages", INDEX))
    text = "".join(_toctree(PurePosixPath(FRONT), heading, links) for heading, links in sections.items())
    return text + "\n".join(["\n```{toctree}", ":hidden:", ":caption: Reference", *generated, "```\n"])
