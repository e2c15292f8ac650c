#!/usr/bin/env python3
"""tests/walls/check_house.py ROOT [CHECK...]: measures the source tree and fails where it breaks one of these rules.

folders    no folder holds more than 40 source files, and none is called "build"
files      no source file has more than 900 lines
functions  no C++ function has more than 100 lines
comments   no comment line begins with "Of" or "What"
prose      no heading and no paragraph or item of a page begins with "Of" or "What", questions excepted
lines      no line of code or prose is longer than 120 characters (tables, lines with a URL and what stands
           between ``` in a page excepted)

Limits: functions are found by counting braces in code that clang-format has laid out. A lambda belongs to the function
around it, and a function that a macro writes is not seen. Strings and comments are taken out before braces are counted;
a brace inside a preprocessor branch that is not compiled counts like any other.
"""

import os
import re
import sys

CODE = (".h", ".cpp", ".glsl", ".js", ".mjs", ".css", ".html", ".py", ".sh", ".cmake")
CODE_NAMES = ("CMakeLists.txt", "demo", "test", "run", "lumigrid.sbatch")
SKIPPED = {".git", "node_modules", "__pycache__"}
SKIPPED_AT_TOP = {"build", "demo-output", "shared", ".cache"}
MAX_FILES, MAX_FILE_LINES, MAX_FUNCTION_LINES, MAX_COLUMNS = 40, 900, 100, 120


def is_code(name):
    return name.endswith(CODE) or name in CODE_NAMES


def walk(root):
    """Yields (folder relative to root, its file names)."""
    for folder, folders, files in os.walk(root):
        top = os.path.relpath(folder, root) == "."
        folders[:] = sorted(f for f in folders if f not in SKIPPED and not (top and f in SKIPPED_AT_TOP))
        yield os.path.relpath(folder, root), sorted(files)


def code_files(root, endings=None):
    for folder, files in walk(root):
        for name in files:
            if name.endswith(endings) if endings else is_code(name):
                path = os.path.normpath(os.path.join(folder, name))
                with open(os.path.join(root, path), encoding="utf-8") as file:
                    yield path, file.read().split("\n")


def check_folders(root):
    for folder, files in walk(root):
        count = sum(1 for name in files if is_code(name))
        if count > MAX_FILES:
            yield f"{folder}: {count} source files, at most {MAX_FILES}"
        if os.path.basename(folder) == "build" and files:
            yield f"{folder}: tools take a folder of this name for compiler output"


def check_files(root):
    for path, lines in code_files(root):
        if len(lines) - 1 > MAX_FILE_LINES:
            yield f"{path}: {len(lines) - 1} lines, at most {MAX_FILE_LINES}"


def blank(match):
    """The same number of lines, without the text."""
    return "\n" * match.group(0).count("\n") + ("0" if match.group(0)[0] not in "/" else "")


LITERALS = re.compile(
    r'R"([^(\s]*)\(.*?\)\1"|"(?:\\.|[^"\\\n])*"|\'(?:\\.|[^\'\\\n])\'|\'\\[^\'\n]*\'|//[^\n]*|/\*.*?\*/', re.S)
LEADING = re.compile(r"^(?:\s*(?:public|private|protected)\s*:)?(?:\s*template\s*<[^{]*?>(?=\s*\w))?\s*")
SCOPE = re.compile(r"(?:(?:inline|static|constexpr|const|typedef)\s+)*(?:namespace|class|struct|union|enum|extern)\b")


def functions(text):
    """Yields (line, length, head) of each function of C++ text, in the order in which they end."""
    text = LITERALS.sub(blank, text)
    text = re.sub(r"^[ \t]*#(?:[^\n]*\\\n)*[^\n]*", blank, text, flags=re.M)
    line, head, head_line, open_blocks, parentheses = 1, "", None, [], 0
    for c in text:
        if c == "\n":
            line += 1
        if c == "{" and parentheses == 0:
            inside = any(kind == "function" for kind, _, _ in open_blocks)
            scope = SCOPE.match(LEADING.sub("", head))
            is_function = not inside and not scope and ")" in head and not head.rstrip().endswith(("=", ","))
            open_blocks.append(("function" if is_function else "block", head_line or line, head.strip()))
            head, head_line = "", None
        elif c == "}" and parentheses == 0:
            if open_blocks:
                kind, begin, name = open_blocks.pop()
                if kind == "function":
                    yield begin, line - begin + 1, " ".join(name.split())
            head, head_line = "", None
        elif c == ";" and parentheses == 0:
            head, head_line = "", None
        else:
            # Braces within parentheses (a lambda that is an argument, a braced value) are the caller's.
            parentheses = max(0, parentheses + (c == "(") - (c == ")"))
            if head_line is None and not c.isspace():
                head_line = line
            head += c


def check_functions(root):
    for path, lines in code_files(root, (".h", ".cpp")):
        for begin, length, head in functions("\n".join(lines)):
            if length > MAX_FUNCTION_LINES:
                yield f"{path}:{begin}: {length} lines, at most {MAX_FUNCTION_LINES}: {head[:90]}"


COMMENT = re.compile(r"(?:^|\s)(?://+[!<]*|#+|/\*+|<!--|^\s*\*)\s*(Of|What)\b(?!')")


def check_comments(root):
    for path, lines in code_files(root):
        for number, text in enumerate(lines, 1):
            if COMMENT.search(text):
                yield f"{path}:{number}: {text.strip()[:100]}"


PARAGRAPH = re.compile(r"(?:#+ |[-*] |\d+\. )?\W{0,3}(Of|What)\b(?!')")


def check_prose(root):
    for path, lines in code_files(root, (".md",)):
        verbatim, before = False, ""
        for number, text in enumerate(lines, 1):
            verbatim ^= text.startswith("```")
            begins = not before.strip() or before.startswith("#") or re.match(r"#|[-*] |\d+\. ", text)
            if begins and not verbatim and PARAGRAPH.match(text) and "?" not in text:
                yield f"{path}:{number}: {text.strip()[:100]}"
            before = text


def check_lines(root):
    for endings in (None, (".md",)):
        for path, lines in code_files(root, endings):
            verbatim = False
            for number, text in enumerate(lines, 1):
                verbatim ^= bool(endings) and text.startswith("```")
                excepted = verbatim or (endings and text.startswith("|")) or "://" in text
                if len(text) > MAX_COLUMNS and not excepted:
                    yield f"{path}:{number}: {len(text)} characters: {text.strip()[:60]}…"


CHECKS = {"folders": check_folders, "files": check_files, "functions": check_functions, "comments": check_comments,
          "prose": check_prose, "lines": check_lines}


def main():
    if len(sys.argv) < 2 or any(name not in CHECKS for name in sys.argv[2:]):
        sys.exit(__doc__)
    found = 0
    for name in sys.argv[2:] or CHECKS:
        for violation in CHECKS[name](sys.argv[1]):
            print(f"{name}: {violation}")
            found += 1
    sys.exit(1 if found else 0)


if __name__ == "__main__":
    main()
