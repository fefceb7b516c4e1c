"""Hooks of MkDocs: folders in the navigation, and files of the project beside the book.

Links of pages to files outside of docs/ (scenes, examples, ARCHITECTURE.md) work in a checkout. The
site gets copies of these files, and lists of folders, under files/; a link to a file that does not exist is an error.
"""

import posixpath
import re
from pathlib import Path

from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File

ROOT = Path(__file__).resolve().parent.parent
LINK = re.compile(r"(\]\()((?:\.\./)+[^)#\s]+)([^)]*\))")


def title(page):
    first = page.read_text(encoding="utf-8").splitlines()[0]
    return first.lstrip("# ").lower()


def expand(nav, docs):
    """Replaces each folder of the navigation by its pages."""
    expanded = []
    for item in nav:
        if isinstance(item, str):
            expanded.append(item)
            continue
        for name, value in item.items():
            if isinstance(value, list):
                value = expand(value, docs)
            elif value.endswith("/"):
                pages = sorted((docs / value).glob("*.md"), key=title)
                pages.sort(key=lambda page: page.name != "index.md")
                value = [page.relative_to(docs).as_posix() for page in pages]
            expanded.append({name: value})
    return expanded


def on_config(config):
    config.nav = expand(config.nav, Path(config.docs_dir))
    return config


def outside(source, target):
    """Path in the project of what a page links to, if that is outside of docs/."""
    path = posixpath.normpath(posixpath.join("docs", posixpath.dirname(source), target))
    return None if path.startswith("docs/") else path


def on_files(files, config):
    wanted = set()
    for page in files.documentation_pages():
        for link in LINK.finditer(page.content_string):
            path = outside(page.src_uri, link[2])
            if path:
                wanted.add((path, page.src_uri))
    for path, source in sorted(wanted):
        if any(file.src_uri == name(path) for file in files):
            continue
        if (ROOT / path).is_dir():
            content = "\n".join(sorted(file.name for file in (ROOT / path).iterdir()))
        elif (ROOT / path).is_file():
            content = (ROOT / path).read_bytes()
        else:
            raise PluginError(f"{source} links to {path}, which is no file of the project")
        files.append(File.generated(config, name(path), content=content))
    return files


def name(path):
    """Where the site has a file of the project; .txt is shown by browsers instead of saved."""
    return f"files/{path}.txt"


def on_page_markdown(markdown, page, config, files):
    def to_copy(link):
        path = outside(page.file.src_uri, link[2])
        if not path:
            return link[0]
        here = posixpath.dirname(page.file.src_uri)
        return link[1] + posixpath.relpath(name(path), here or ".") + link[3]

    return LINK.sub(to_copy, markdown)
