#!/usr/bin/env python3
"""documents.py SOURCE TO: the project's READMEs and pictures as a package has them, with links that lead somewhere.

A link to a file that is no document (source, tests) becomes its path in the source, as text.
"""
import pathlib
import re
import shutil
import sys

source, to = map(pathlib.Path, sys.argv[1:])
folders = ["server", "haptic", "physics", "idl", "config", "tools", "tests"]
texts = sorted(source.glob("*.md")) + sorted(p for folder in folders for p in (source / folder).rglob("*.md"))
pictures = sorted(p for folder in folders for p in (source / folder).rglob("*.png"))
known = {p.relative_to(source).as_posix() for p in texts + pictures}


def link(text, match):
    """Kept where its target is a document of the package, or elsewhere on the web."""
    words, target = match[1], match[2]
    path = target.split("#")[0]
    if not path or "://" in path:
        return match[0]
    absolute = (text.parent / path).resolve()
    inside = absolute.relative_to(source.resolve()).as_posix()
    if inside in known:
        return match[0]
    if absolute.is_dir() and f"{inside}/README.md" in known:
        return f"[{words}]({path.rstrip('/')}/README.md)"
    return words if inside in words else f"{words} (`{inside}`)"


shutil.rmtree(to, ignore_errors=True)
for path in texts + pictures:
    (to / path.relative_to(source)).parent.mkdir(parents=True, exist_ok=True)
for path in pictures:
    shutil.copyfile(path, to / path.relative_to(source))
for path in texts:
    text = re.sub(r"(?<!!)\[([^\]]*)\]\(([^)\s]+)\)", lambda m, path=path: link(path, m), path.read_text(encoding="utf-8"))
    (to / path.relative_to(source)).write_text(text, encoding="utf-8")
