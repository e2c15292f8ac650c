#!/usr/bin/env python3
"""Draws docs/rooms.svg, the rooms of the source tree and the arrows between them, from the wall table in
cmake/LumigridTargets.cmake.

    tools/rooms.py --write docs/rooms.svg    draws the picture
    tools/rooms.py --check docs/rooms.svg    fails when the picture differs from the table
    tools/rooms.py --table FILE ...          another table than cmake/LumigridTargets.cmake

Targets of one room are one box. A row of boxes uses only rows below it; an arrow that another path implies is left
out, as are arrows of programs that may use anything ("*").
"""

import argparse
import os
import re
import sys

TABLE = os.path.join(os.path.dirname(__file__), "..", "cmake", "LumigridTargets.cmake")
# Labels of targets whose names are not their folders with "_" for "/". A target that holds a part of a folder, or
# several, says so.
FOLDERS = {
    "lumigrid": "server/cli", "lumigrid-view": "client/native", "lumigrid-compare": "compare",
    "sampling": "repository/sampling", "sampling_json": "repository/sampling", "cache": "repository (cache)",
    "faces": "repository/faces", "face_image": "repository/faces", "frames": "repository/faces",
    "packs": "repository/packs", "objects": "repository/objects", "client": "client: app, source, viewer",
    "client_web_splats": "client/web", "client_web_decode": "client/web", "client_web_check": "client/web",
}
BASE = re.compile(r"base(_.*)?$")


def folder(target):
    return "base" if BASE.match(target) else FOLDERS.get(target, target.replace("_", "/"))


def read_table(path):
    """{target: set of targets that it may use, or "*"}"""
    with open(path, encoding="utf-8") as file:
        text = file.read()
    lists = dict(re.findall(r"^set\((\w+) ([^)]*)\)", text, re.M))
    rows = {}
    for row in re.findall(r"^lumigrid_row\(([^)]*)\)", text, re.M):
        target, *words = row.split()
        uses = words[words.index("USES") + 1:] if "USES" in words else []
        uses = uses[:uses.index("LINKS")] if "LINKS" in uses else uses
        uses = {name for word in uses for name in lists.get(word.strip("${}"), word).split()}
        rows[target] = "*" if "*" in uses else uses
    if not rows:
        sys.exit(f"{path}: no row begins with lumigrid_row(")
    for target, uses in rows.items():
        if uses != "*" and uses - rows.keys():
            sys.exit(f"{path}: '{target}' may use {', '.join(sorted(uses - rows.keys()))}, which has no row")
    return rows


def rooms_of(rows):
    """{room: rooms that it uses}, without itself"""
    rooms = {}
    for target, uses in rows.items():
        room = rooms.setdefault(folder(target), set())
        if uses != "*":
            room |= {folder(used) for used in uses}
    for room, uses in rooms.items():
        uses.discard(room)
    return rooms


def reached(rooms, room, without=None):
    """The rooms that `room` uses directly or through others, the direct arrow to `without` left out."""
    seen, todo = set(), [used for used in rooms[room] if used != without]
    while todo:
        one = todo.pop()
        if one not in seen:
            seen.add(one)
            todo += rooms[one]
    return seen


def heights(rooms):
    """The row of each room: one above the highest that it uses."""
    height = {}

    def visit(room, path):
        if room in path:
            sys.exit("the table has a circle: " + " -> ".join(path + [room]))
        if room not in height:
            height[room] = 1 + max((visit(used, path + [room]) for used in sorted(rooms[room])), default=-1)
        return height[room]

    for room in sorted(rooms):
        visit(room, [])
    # Rooms that may use anything stand on top.
    top = max(height.values())
    for room in rooms:
        if not rooms[room] and room != "base":
            height[room] = top + 1
    return height


COLOURS = {"base": "#e8e8e8", "mesh": "#f6e3c5", "lod": "#f9d9cf", "repository": "#d8ead3", "protocol": "#d5e5f5",
           "plan": "#d5e5f5", "server": "#e3dcf3", "client": "#cfeaea", "compare": "#f3dce8"}
BOX, HIGH, GAP, RISE, MARGIN = 132, 30, 18, 84, 20


def box_width(room):
    return max(BOX, 7 * len(room) + 16)


def place(rooms, height):
    """The left edge of each room's box. Rooms of a row stand in the order of the rooms they use."""
    rows = [sorted(room for room in rooms if height[room] == h) for h in range(max(height.values()) + 1)]
    widths = [sum(box_width(room) + GAP for room in row) - GAP for row in rows]
    width = max(widths) + 2 * MARGIN
    left = {}
    for row, row_width in zip(rows, widths):
        def mean(room):
            below = [left[used] + box_width(used) / 2 for used in rooms[room] if used in left and used != "base"]
            return (sum(below) / len(below) if below else width / 2, room)
        row.sort(key=mean)
        edge = (width - row_width) / 2
        for room in row:
            left[room] = edge
            edge += box_width(room) + GAP
    return left, width, len(rows) * RISE - RISE + HIGH + 2 * MARGIN


def draw(rows):
    rooms = rooms_of(rows)
    height = heights(rooms)
    left, width, tall = place(rooms, height)

    def top(room):
        return tall - MARGIN - HIGH - height[room] * RISE

    svg = [f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" height="{tall:.0f}" '
           f'viewBox="0 0 {width:.0f} {tall:.0f}" font-family="sans-serif" font-size="13">',
           "<!-- drawn by tools/rooms.py from cmake/LumigridTargets.cmake -->",
           '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" orient="auto">'
           '<path d="M0,0 L8,4 L0,8 z" fill="#666"/></marker></defs>',
           f'<rect width="{width:.0f}" height="{tall:.0f}" fill="white"/>']
    for room in sorted(rooms):
        for used in sorted(rooms[room]):
            if used in reached(rooms, room, without=used):
                continue
            x1, y1 = left[room] + box_width(room) / 2, top(room) + HIGH
            x2, y2 = left[used] + box_width(used) / 2, top(used)
            bend = (y2 - y1) * 0.5
            svg.append(f'<path d="M{x1:.1f},{y1} C{x1:.1f},{y1 + bend:.1f} {x2:.1f},{y2 - bend:.1f} {x2:.1f},{y2}" '
                       f'fill="none" stroke="#888" marker-end="url(#tip)"><title>{room} uses {used}</title></path>')
    for room in sorted(rooms):
        colour = COLOURS.get(re.match(r"\w+", room)[0], "#ffffff")
        wide = box_width(room)
        svg.append(f'<rect x="{left[room]:.1f}" y="{top(room)}" width="{wide}" height="{HIGH}" rx="5" fill="{colour}" '
                   f'stroke="#666"/><text x="{left[room] + wide / 2:.1f}" y="{top(room) + 20}" '
                   f'text-anchor="middle">{room}</text>')
    return "\n".join(svg + ["</svg>", ""])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--table", default=TABLE)
    task = parser.add_mutually_exclusive_group(required=True)
    task.add_argument("--write", metavar="SVG")
    task.add_argument("--check", metavar="SVG")
    arguments = parser.parse_args()
    picture = draw(read_table(arguments.table))
    if arguments.write:
        with open(arguments.write, "w", encoding="utf-8") as file:
            file.write(picture)
        return
    with open(arguments.check, encoding="utf-8") as file:
        if file.read() != picture:
            sys.exit(f"{arguments.check} is not what the table says: run tools/rooms.py --write {arguments.check}")


if __name__ == "__main__":
    main()
