#!/usr/bin/env python3
"""Keeps the figures of docs/results.md: docs/results/matrix.csv has them, and the document's tables are made of it.

    tools/results.py                                prints the tables
    tools/results.py --take SUMMARY.csv...          takes the runs of reports of `lumigrid-compare` into matrix.csv
    tools/results.py --write docs/results.md        puts the tables into the document
    tools/results.py --check docs/results.md        fails when the document's tables are others
    tools/results.py --against SUMMARY.csv...       fails when runs differ from matrix.csv by more than --within dB
"""

import argparse
import csv
import io
import math
import pathlib
import re
import sys

MATRIX = pathlib.Path(__file__).resolve().parent.parent / "docs/results/matrix.csv"
COLUMNS = ["scene", "method", "path", "link", "mean_psnr_db", "bytes"]
KEY = 4  # so many of them name a run

METHODS = ["lumigraph", "static", "paper", "patches"]
LINKS = {"20Mbit/40ms": "20 Mbit/s", "384kbit/100ms": "384 kbit/s"}
PATHS = {"orbit": "around", "orbit-fast": "60 degrees a second", "walk": "close", "teleports": "jumps"}
SCENES = {
    "machangara": "machangara, city block",
    "cedar_creek": "cedar_creek, from its rooms",
    "carpark": "carpark",
    "refinery_shihua": "refinery_shihua",
    "skull": "skull",
    "rooms": "flat, generated, from its rooms",
    "statue": "statue of 30 M, generated",
}
LOSS_DB = 0.2  # less is not told apart


def fail(message):
    sys.exit(f"results.py: {message}")


def read(name):
    """The runs of a file: (scene, method, path, link) to (dB, bytes)."""
    try:
        with open(name, encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
    except (OSError, ValueError) as error:
        fail(f"{name}: {error}")
    if not rows or any(column not in rows[0] for column in COLUMNS):
        fail(f"{name}: no summary.csv of `lumigrid-compare`: it needs the columns {', '.join(COLUMNS)}")
    runs = {}
    for number, row in enumerate(rows, 2):
        try:
            value = float(row["mean_psnr_db"]), int(row["bytes"])
        except (TypeError, ValueError):
            fail(f"{name}: line {number}: mean_psnr_db and bytes are no numbers")
        if not math.isfinite(value[0]) or value[1] < 0:
            fail(f"{name}: line {number}: mean_psnr_db and bytes are no figures of a run")
        scene = pathlib.PurePath(row["scene"]).name.removesuffix(".scene")
        runs[scene, row["method"], row["path"], row["link"]] = value
    return runs


def take(matrix, names):
    for name in names:
        matrix.update(read(name))
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(COLUMNS)
    for key in sorted(matrix):
        writer.writerow([*key, f"{matrix[key][0]:.3f}", matrix[key][1]])
    MATRIX.write_text(out.getvalue(), encoding="utf-8")


def megabytes(size):
    return f"{size / 1e6:.2g}"


def path_table(matrix, path):
    """A row for each scene, the best method of each link in bold."""
    first, second = LINKS.values()
    head = ["scan", *(f"{first}: `{m}`" if m == METHODS[0] else f"`{m}`" for m in METHODS),
            *(f"{second}: `{m}`" if m == METHODS[0] else f"`{m}`" for m in METHODS)]
    rows = []
    for scene, title in SCENES.items():
        cells = [title]
        for link in LINKS:
            runs = [matrix.get((scene, method, path, link)) for method in METHODS]
            best = max((round(run[0], 1) for run in runs if run), default=0.0)
            for run in runs:
                if not run:
                    cells.append("")
                    continue
                figure = f"{run[0]:.1f}"
                cells.append((f"**{figure}**" if round(run[0], 1) == best else figure) + f" ({megabytes(run[1])})")
        if any(cells[1:]):
            rows.append(cells)
    return head, rows


def losses(matrix):
    """Where another method is ahead of the first by more than LOSS_DB, the largest loss first; the number of cases."""
    found, cases = [], 0
    for scene, title in SCENES.items():
        for path, path_title in PATHS.items():
            for link, link_title in LINKS.items():
                own = matrix.get((scene, METHODS[0], path, link))
                others = [(run[0], m) for m in METHODS[1:] if (run := matrix.get((scene, m, path, link)))]
                if not own or not others:
                    continue
                cases += 1
                best, method = max(others)
                if best - own[0] > LOSS_DB:
                    found.append((best - own[0], title, path_title, link_title, method))
    return sorted(found, reverse=True), cases


def losses_table(matrix):
    found, cases = losses(matrix)
    head = [f"`{METHODS[0]}` loses in {len(found)} of {cases} cases", "path", "link", "to", "by, dB"]
    return head, [[title, path, link, f"`{method}`", f"{by:.1f}"] for by, title, path, link, method in found]


def markdown(table):
    head, rows = table
    return "\n".join("| " + " | ".join(cells) + " |" for cells in [head, ["---"] * len(head), *rows])


def tables(matrix):
    return {**{path: path_table(matrix, path) for path in PATHS}, "losses": losses_table(matrix)}


def with_tables(text, matrix):
    for name, table in tables(matrix).items():
        begin, end = f"<!-- table: {name} -->", f"<!-- end: {name} -->"
        if text.count(begin) != 1 or text.count(end) != 1:
            fail(f"the document needs '{begin}' and '{end}', once each")
        filled = begin + "\n" + markdown(table) + "\n" + end
        pattern = re.escape(begin) + r".*?" + re.escape(end)
        text = re.sub(pattern, lambda _, filled=filled: filled, text, flags=re.DOTALL)
    return text


def compare(matrix, names, within):
    """Prints each run beside the figure that is stated for it. Returns whether all are near."""
    seen, near = 0, True
    for name in names:
        for key, (db, size) in sorted(read(name).items()):
            if key not in matrix:
                continue
            seen += 1
            stated = matrix[key][0]
            is_near = abs(db - stated) <= within
            near = near and is_near
            print(f"{' '.join(key)}: {db:.2f} dB, {stated:.2f} stated{'' if is_near else '  <- differs'}")
    if not seen:
        fail("none of these runs is in docs/results/matrix.csv")
    if not near:
        print(f"docs/results.md states other figures, by more than {within:g} dB: measure again by its command, then "
              "tools/results.py --take REPORT/summary.csv, --write docs/results.md, and read what it says of them")
    return near


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--take", nargs="+", metavar="SUMMARY", help="take these runs into docs/results/matrix.csv")
    parser.add_argument("--write", metavar="DOCUMENT", help="put the tables into it")
    parser.add_argument("--check", metavar="DOCUMENT", help="exit status 1 when its tables are others")
    parser.add_argument("--against", nargs="+", metavar="SUMMARY", help="exit status 1 when these runs differ")
    parser.add_argument("--within", type=float, default=1.0, metavar="DB", help="for --against (1)")
    arguments = parser.parse_args()

    matrix = read(MATRIX) if MATRIX.exists() or not arguments.take else {}
    if arguments.take:
        take(matrix, arguments.take)
    if arguments.against and not compare(matrix, arguments.against, arguments.within):
        sys.exit(1)
    document = arguments.write or arguments.check
    if not document:
        if not arguments.take and not arguments.against:
            print("\n\n".join(markdown(table) for table in tables(matrix).values()))
        return
    try:
        text = pathlib.Path(document).read_text(encoding="utf-8")
    except OSError as error:
        fail(f"{document}: {error}")
    filled = with_tables(text, matrix)
    if arguments.write:
        pathlib.Path(document).write_text(filled, encoding="utf-8")
    elif filled != text:
        fail(f"the tables of {document} are not those of docs/results/matrix.csv; write them with --write")


if __name__ == "__main__":
    main()
