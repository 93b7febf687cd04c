"""MkDocs hook: takes in pages from outside of docs/, so that links hold on GitHub and in the site alike.

A link is rewritten by the file that it means. Links to what has no page here, such as source files, become
text.
"""

from __future__ import annotations

import posixpath
import re
from collections.abc import Callable
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[1]
OUTSIDE = ("README.md", "CONTRIBUTING.md", "CHANGELOG.md", "policies/*.md", "robots/*/README.md")
LINK = re.compile(r"(?P<image>!?)\[(?P<text>[^\]]*)\]\((?P<target>[^)#\s]*)(?P<anchor>#[^)\s]*)?\)")
CODE = re.compile(r"^```.*?^```|^    .*?$|`[^`\n]+`", re.MULTILINE | re.DOTALL)


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages from outside under the path that they have in the repository."""
    for pattern in OUTSIDE:
        for path in sorted(ROOT.glob(pattern)):
            uri = path.relative_to(ROOT).as_posix()
            files.append(File.generated(config, uri, abs_src_path=str(path)))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Let links lead to pages of the site."""
    uri = page.file.src_uri
    outside = page.file.generated_by is not None
    here = uri if outside else f"docs/{uri}"

    def rewritten(match: re.Match[str]) -> str:
        target, anchor = match["target"], match["anchor"] or ""
        if not target or re.match(r"\w+:", target):
            return match[0]
        meant = posixpath.normpath(posixpath.join(posixpath.dirname(here), target))
        in_site = meant.removeprefix("docs/")
        if files.get_file_from_path(in_site) is None:
            return match["text"]
        relative = posixpath.relpath(in_site, posixpath.dirname(uri) or ".")
        return f"{match['image']}[{match['text']}]({relative}{anchor})"

    return _outside_code(markdown, lambda text: LINK.sub(rewritten, text))


def _outside_code(markdown: str, change: Callable[[str], str]) -> str:
    parts, end = [], 0
    for code in CODE.finditer(markdown):
        parts += [change(markdown[end : code.start()]), code[0]]
        end = code.end()
    return "".join([*parts, change(markdown[end:])])
