#!/usr/bin/env python3
"""tests/docs/check_paths.py ROOT: fails where README, CONTRIBUTING or a page in docs/ names a path that does not exist.

Looked at are words in backticks that begin with a folder or file of the repository's root and contain a slash, and the
targets of links. `x` and `x.*` also stand for a file x with any ending. Words with <, { or a name to choose like NAME
and SCENE are left out, and so are files that a build makes.
"""

import glob
import os
import re
import sys

CODE = re.compile(r"`([^`\n]+)`")
LINK = re.compile(r"\]\(([^)\s#]+)(?:#[^)]*)?\)")
PLACEHOLDER = re.compile(r"[<>{}$…]|NAME|SCENE|MESH|DIR|FILE|^(build|demo-output)(/|$)")


def pages(root):
    for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md"):
        if os.path.exists(os.path.join(root, name)):
            yield name
    for path in sorted(glob.glob(os.path.join(root, "docs", "**", "*.md"), recursive=True)):
        yield os.path.relpath(path, root)


def exists(root, path):
    path = path.rstrip("/")
    pattern = path if path.endswith(".*") else path + ".*"
    return os.path.exists(os.path.join(root, path)) or bool(glob.glob(os.path.join(root, pattern)))


def stale(root):
    tops = {name for name in os.listdir(root) if not name.startswith(".git")}
    for page in pages(root):
        with open(os.path.join(root, page), encoding="utf-8") as file:
            for number, line in enumerate(file, 1):
                for text in CODE.findall(line):
                    for word in text.split():
                        word = re.sub(r"^\./", "", word.strip(",;:()'\""))
                        if "/" not in word or word.split("/")[0] not in tops or PLACEHOLDER.search(word):
                            continue
                        if not exists(root, word):
                            yield f"{page}:{number}: `{word}`"
                for target in LINK.findall(CODE.sub("", line)):
                    if "://" not in target and not exists(root, os.path.join(os.path.dirname(page), target)):
                        yield f"{page}:{number}: link to {target}"


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    found = list(stale(sys.argv[1]))
    for line in found:
        print(line)
    sys.exit(1 if found else 0)


if __name__ == "__main__":
    main()
