#!/usr/bin/env python3
"""Works out from measured rates what a scene of a size costs to build, keep and serve. docs/scale.md holds its tables.

    tools/scale.py                                   prints the tables
    tools/scale.py --set viewers=500 --set images=1e6
    tools/scale.py --rates mine.json                 {"name": value, ...} instead of the rates below
    tools/scale.py --write docs/scale.md             puts the tables into the document
    tools/scale.py --check docs/scale.md             fails when the document's tables are others
"""

import argparse
import json
import math
import re
import sys

# name: (value, unit, where from). Values marked "assumed" are not measured: replace them.
RATES = {
    # The question
    "triangles": (1e9, "", "asked"),
    "images": (1e7, "that show something", "asked"),
    "viewers": (1e4, "at once", "asked"),
    # Hierarchy
    "triangles_per_core_second": (0.48e6, "1/s", "results/hierarchy.md, 100 M triangles"),
    "build_cores": (16, "", "assumed; more gain little (decisions/levels-wait.md)"),
    "build_busy_share": (0.75, "", "decisions/levels-wait.md: 16 cores"),
    "source_bytes_per_triangle": (20.5, "B", "PLY of `lumigrid sample`, 30 M triangles, colours"),
    "work_bytes_per_triangle": (70, "B", "lod/patch/builder, kWorkBytes; measured on scans with colours"),
    "hierarchy_bytes_per_triangle": (3.18, "B", "results/hierarchy.md, 100 M triangles"),
    "patches_per_triangle": (7.27e-4, "", "21 802 patches of 30 M triangles"),
    "groups_per_patch": (0.167, "", "3 636 groups of 21 802 patches"),
    # Images: machangara, 3.02 M triangles, --grid 8, faces of 512, all defaults: 750 images, 930 empty faces
    "cpu_seconds_per_image": (0.051, "s",
                              "machangara, software GL: 38.5 s of CPU for 750 images, empty faces included"),
    "bake_triangles": (3.02e6, "", "the mesh of that figure"),
    "bake_growth": (1.6, "per ten times the triangles",
                    "sample of 3 M and 30 M, --grid 5: 8.6 and 13.7 s of CPU for 600 faces"),
    "empty_per_image": (1.24, "", "machangara: 930 of 1 680 faces see nothing"),
    "jpeg_bytes": (11805, "B an image", "machangara"),
    "mask_bytes": (108, "B an image", "machangara"),
    "store_overhead": (1.16, "", "machangara: data.mdb over JPEG and masks"),
    "index_bytes": (24, "B a face in packs", "assumed: key, place, length"),
    "pack_bytes": (16e6, "B", "assumed, of 1 to 64 MB"),
    "environments": (64, "", "trial: 16 to 64 for 10^7 images"),
    "bake_machines": (8, "", "assumed"),
    "machine_cores": (32, "", "assumed"),
    "machine_memory": (128e9, "B", "assumed"),
    "machine_network": (10e9, "bit/s", "assumed"),
    "disk_bytes_per_second": (500e6, "B/s", "assumed"),
    # One viewer: an orbit of 60 views around machangara, 1280 x 720, headless, without exact frames
    "session_bytes": (5.72e6, "B",
                      "orbit of 60 views: 279 images 3.22 MB (0.857 of that with Huffman tables of their own), "
                      "82 groups 2.96 MB"),
    "session_faces": (279, "", "the same orbit"),
    "first_view_bytes": (2.75e6, "B", "its first view, until complete"),
    "session_cpu_seconds": (0.06, "s", "the same orbit: the server's CPU time, to 0.01 s"),
    "session_views": (60, "", "the same orbit"),
    "session_seconds": (600, "s", "assumed: somebody looks for ten minutes and sees as much as the orbit shows"),
    "frame_cpu_seconds": (0.41, "s", "8 exact frames of 1280 x 720 by software GL: 3.4 s of CPU"),
    "frame_bytes": (180e3, "B", "the same frames"),
    "connection_bytes": (76e3, "B", "trial: with TLS; 8 kB without"),
    "tls_bytes_per_core_second": (0.73e9, "B/s", "trial: 0.38 GB/s at 52 % of a core"),
    "get_cpu_seconds": (3.8e-6, "s", "trial: LMDB"),
    "patch_table_bytes": (155, "B a patch", "`lumigrid serve` of 21 802 patches: 3.3 MB of its own memory"),
    "held_face_bytes": (56, "B a face and session", "assumed: an entry of a hash set"),
    "connections_per_process": (256, "", "default of `lumigrid serve --max-connections`"),
    "access_row_bytes": (3.5, "B", "formats/access.md"),
    "access_interval": (30, "s", "default of `lumigrid serve --access-interval`"),
    # Object store
    "cache_hits": (0.9, "of images sent", "assumed: people look at the same places"),
    "faces_per_read": (6, "", "assumed: one range read brings a point's faces"),
    # Money
    "busy_hours": (60, "h a month", "assumed: so long are all the viewers there"),
    "usd_core_hour": (0.04, "USD", "assumed"),
    "usd_gb_month": (0.02, "USD", "assumed: object storage"),
    "usd_gb_out": (0.05, "USD", "assumed: traffic to viewers; 0 on one's own line"),
    "usd_million_gets": (0.4, "USD", "assumed"),
    "usd_million_puts": (5, "USD", "assumed"),
}


class Rates:
    def __init__(self, values):
        self.__dict__.update(values)


def number(value):
    """Three digits, with spaces between thousands."""
    if value == 0:
        return "0"
    if abs(value) >= 1e6 and abs(value) < 1e15:
        for step, name in ((1e12, "·10^12"), (1e9, "·10^9"), (1e6, "·10^6")):
            if abs(value) >= step:
                return f"{value / step:.3g}{name}"
    if abs(value) >= 1000:
        return f"{round(value, 2 - int(math.floor(math.log10(abs(value))))):,.0f}".replace(",", " ")
    return f"{value:.3g}"


def size(value):
    for step, name in ((1e12, "TB"), (1e9, "GB"), (1e6, "MB"), (1e3, "kB")):
        if value >= step:
            return f"{value / step:.3g} {name}"
    return f"{value:.3g} B"


def duration(seconds):
    if seconds >= 2 * 86400:
        return f"{seconds / 86400:.3g} days"
    if seconds >= 2 * 3600:
        return f"{seconds / 3600:.3g} h"
    if seconds >= 120:
        return f"{seconds / 60:.3g} min"
    return f"{seconds:.3g} s"


def usd(value):
    return f"{number(value)} USD" if value >= 0.01 else "under 0.01 USD"


def bits(value):
    return f"{value / 1e9:.3g} Gbit/s"


def rates_table(_):
    rows = [(f"`{name}`", f"{number(value)} {unit}".strip(), source) for name, (value, unit, source) in RATES.items()]
    return ("rate", "value", "from"), rows


def hierarchy(r):
    cpu = r.triangles / r.triangles_per_core_second
    computing = cpu / (r.build_cores * r.build_busy_share)
    moved = r.triangles * (r.source_bytes_per_triangle + 2 * r.work_bytes_per_triangle + r.hierarchy_bytes_per_triangle)
    disk = moved / r.disk_bytes_per_second
    return ("hierarchy", "", "how"), [
        ("source", size(r.triangles * r.source_bytes_per_triangle), "read once"),
        ("work files", size(r.triangles * r.work_bytes_per_triangle), "written and read once; gone in the end"),
        ("patch.lgp", size(r.triangles * r.hierarchy_bytes_per_triangle), f"{number(patches(r))} patches"),
        ("computing", f"{number(cpu / 3600)} core hours",
         f"{duration(computing)} on one machine, {number(r.build_cores)} cores"),
        ("disk", duration(disk), f"{size(moved)} moved"),
        ("in all", duration(computing + disk), "as if the disk never worked beside the cores"),
        ("cost", usd((computing + disk) / 3600 * r.build_cores * r.usd_core_hour), "the machine, for so long"),
    ]


def patches(r):
    return r.triangles * r.patches_per_triangle


def image_cpu(r):
    return r.cpu_seconds_per_image * r.bake_growth ** max(0.0, math.log10(r.triangles / r.bake_triangles))


def bake(r):
    cpu = r.images * image_cpu(r)
    cores = r.bake_machines * r.machine_cores
    seconds = cpu / cores
    faces = r.images * (1 + r.empty_per_image)
    return ("images", "", "how"), [
        ("faces", number(faces),
         f"of {number(faces / 6)} points: about {round((faces / 6) ** (1 / 3))} along each side"),
        ("CPU for an image", duration(image_cpu(r)), f"{number(r.cpu_seconds_per_image)} s, grown with the mesh"),
        ("computing", f"{number(cpu / 3600)} core hours", "software GL"),
        ("time", duration(seconds),
         f"{number(r.bake_machines)} machines of {number(r.machine_cores)} cores, a shard each or more"),
        ("written", f"{size(r.images * image_bytes(r) / seconds / r.bake_machines)}/s",
         "by each machine; LMDB takes 143 MB/s at least (trial)"),
        ("cost", usd(cpu / 3600 * r.usd_core_hour), ""),
    ]


def image_bytes(r):
    return r.jpeg_bytes + r.mask_bytes


def storage(r):
    payload = r.images * image_bytes(r)
    hierarchy_bytes = r.triangles * r.hierarchy_bytes_per_triangle
    index = r.images * (1 + r.empty_per_image) * r.index_bytes
    kept = payload + hierarchy_bytes + index
    return ("storage", "", "how"), [
        ("JPEG", size(r.images * r.jpeg_bytes), f"{size(r.jpeg_bytes)} an image"),
        ("masks", size(r.images * r.mask_bytes), f"{size(r.mask_bytes)} an image"),
        ("patch.lgp", size(hierarchy_bytes), ""),
        ("as LMDB", size(payload * r.store_overhead),
         f"{number(r.environments)} environments of {size(payload * r.store_overhead / r.environments)}"),
        ("published", size(kept),
         f"{number(math.ceil(payload / r.pack_bytes))} packs of {size(r.pack_bytes)}, {size(index)} of index"),
        ("copied in", duration(8 * kept / r.machine_network), "one machine's network"),
        ("cost", f"{usd(kept / 1e9 * r.usd_gb_month)} a month", "object storage"),
    ]


def processes(r):
    return math.ceil(r.viewers / r.connections_per_process)


def serving(r):
    sessions = r.viewers / r.session_seconds  # begun in a second
    reads = sessions * r.session_faces
    groups = patches(r) * r.groups_per_patch
    state = r.connection_bytes + groups / 8 + r.session_faces * r.held_face_bytes
    tables = patches(r) * r.patch_table_bytes
    store = r.images * image_bytes(r) * r.store_overhead
    frames = sessions * r.session_views
    return ("serving", "", "how"), [
        ("choosing what to send", f"{number(sessions * r.session_cpu_seconds)} cores",
         f"{duration(r.session_cpu_seconds)} of CPU a session"),
        ("TLS", f"{number(sessions * r.session_bytes / r.tls_bytes_per_core_second)} cores", ""),
        ("store", f"{number(reads)} reads/s", f"{number(reads * r.get_cpu_seconds)} cores"),
        ("processes", number(processes(r)), f"{number(r.connections_per_process)} viewers each, the default"),
        ("memory for sessions", size(r.viewers * state), f"{size(state)} each: connection, groups and faces held"),
        ("memory for tables", f"{size(tables)} a process", f"{size(tables * processes(r))} in all"),
        ("store in memory", f"{min(1.0, r.machine_memory / store):.0%}",
         f"of {size(store)} in {size(r.machine_memory)}"),
        ("machines", number(machines(r)), f"of {number(r.machine_cores)} cores; two at least"),
        ("cost", f"{usd(machines(r) * r.machine_cores * r.usd_core_hour * 730)} a month", "running day and night"),
        ("exact frames, if on", f"{number(frames * r.frame_cpu_seconds)} cores",
         f"{number(frames)} frames/s by software GL"),
    ]


def machines(r):
    sessions = r.viewers / r.session_seconds
    cores = sessions * (r.session_cpu_seconds + r.session_bytes / r.tls_bytes_per_core_second)
    network = 8 * max(sessions * r.session_bytes, r.viewers * r.first_view_bytes / 60) / r.machine_network
    return max(2, math.ceil(cores / r.machine_cores), math.ceil(network))


def sessions_a_month(r):
    return r.viewers * r.busy_hours * 3600 / r.session_seconds


def bandwidth(r):
    sessions = r.viewers / r.session_seconds
    month = sessions_a_month(r) * r.session_bytes
    frames = sessions_a_month(r) * r.session_views * r.frame_bytes
    return ("bandwidth", "", "how"), [
        ("a viewer", f"{8 * r.session_bytes / r.session_seconds / 1e3:.3g} kbit/s",
         "on average; as fast as the link goes after a move"),
        ("all", bits(8 * sessions * r.session_bytes), "on average"),
        ("all open it within a minute", bits(8 * r.viewers * r.first_view_bytes / 60),
         f"{size(r.first_view_bytes)} each until the first view is complete"),
        ("a month", size(month), f"{number(sessions_a_month(r))} sessions"),
        ("cost", f"{usd(month / 1e9 * r.usd_gb_out)} a month", ""),
        ("exact frames, if on", f"{bits(8 * sessions * r.session_views * r.frame_bytes)} more",
         f"{usd(frames / 1e9 * r.usd_gb_out)} a month more"),
    ]


def requests(r):
    per_session = r.session_faces / r.faces_per_read
    sessions = r.viewers / r.session_seconds
    month = sessions_a_month(r) * per_session
    puts = math.ceil(r.images * image_bytes(r) / r.pack_bytes)
    read_bytes = r.faces_per_read * image_bytes(r)
    return ("object store", "", "how"), [
        ("reads without a cache", f"{number(sessions * per_session)} /s",
         f"{number(per_session)} a session, {size(read_bytes)} each"),
        ("cost", f"{usd(month / 1e6 * r.usd_million_gets)} a month", ""),
        ("reads behind servers with a cache", f"{number(sessions * per_session * (1 - r.cache_hits))} /s",
         f"{r.cache_hits:.0%} hits"),
        ("cost", f"{usd(month * (1 - r.cache_hits) / 1e6 * r.usd_million_gets)} a month", ""),
        ("out of the store", bits(8 * sessions * per_session * (1 - r.cache_hits) * read_bytes), "to the servers"),
        ("writes", f"{number(puts)} once", usd(puts / 1e6 * r.usd_million_puts)),
    ]


def access(r):
    file = r.images * r.access_row_bytes
    return ("access counts", "", "how"), [
        ("file", size(file), "once every image was sent"),
        ("rewritten", f"{size(file / r.access_interval)}/s", "by each process that keeps one, while anybody looks"),
        ("one file for all processes", f"{size(processes(r) * file / r.access_interval)}/s",
         f"{number(processes(r))} processes"),
    ]


TABLES = {
    "rates": rates_table,
    "hierarchy": hierarchy,
    "images": bake,
    "storage": storage,
    "serving": serving,
    "bandwidth": bandwidth,
    "requests": requests,
    "access": access,
}


def markdown(table):
    head, rows = table
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines)


def with_tables(text, rates):
    """The document with the tables between its marks as they are now."""
    for name, table in TABLES.items():
        begin, end = f"<!-- table: {name} -->", f"<!-- end: {name} -->"
        if text.count(begin) != 1 or text.count(end) != 1:
            sys.exit(f"scale.py: the document needs '{begin}' and '{end}', once each")
        pattern = re.escape(begin) + r".*?" + re.escape(end)
        filled = begin + "\n" + markdown(table(rates)) + "\n" + end
        text = re.sub(pattern, lambda _, filled=filled: filled, text, flags=re.DOTALL)
    return text


def set_rate(name, value):
    if name not in RATES:
        sys.exit(f"scale.py: no rate is called '{name}'; run it without arguments to see them all")
    try:
        value = float(value)
    except (TypeError, ValueError):
        sys.exit(f"scale.py: {name}: '{value}' is no number")
    if not math.isfinite(value) or value < 0 or (value == 0 and not name.startswith("usd") and name != "cache_hits"):
        sys.exit(f"scale.py: {name}: {value} is not above 0")
    RATES[name] = (value, RATES[name][1], "given")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="another value for a rate")
    parser.add_argument("--rates", metavar="FILE", help="JSON object of such values")
    parser.add_argument("--write", metavar="DOCUMENT", help="put the tables into it")
    parser.add_argument("--check", metavar="DOCUMENT", help="exit status 1 when its tables are others")
    arguments = parser.parse_args()
    if arguments.rates:
        try:
            with open(arguments.rates, encoding="utf-8") as file:
                given = json.load(file)
        except (OSError, ValueError) as error:
            sys.exit(f"scale.py: {arguments.rates}: {error}")
        if not isinstance(given, dict):
            sys.exit(f"scale.py: {arguments.rates}: not an object of names and values")
        for name, value in given.items():
            set_rate(name, value)
    for word in arguments.set:
        set_rate(*(word.split("=", 1) if "=" in word else (word, None)))
    rates = Rates({name: value for name, (value, _, _) in RATES.items()})

    document = arguments.write or arguments.check
    if not document:
        print("\n\n".join(markdown(table(rates)) for table in TABLES.values()))
        return 0
    with open(document, encoding="utf-8") as file:
        before = file.read()
    after = with_tables(before, rates)
    if arguments.write:
        with open(document, "w", encoding="utf-8") as file:
            file.write(after)
    elif after != before:
        old, new = before.splitlines(), after.splitlines()
        line = next((i for i, (a, b) in enumerate(zip(old, new)) if a != b), min(len(old), len(new)))
        print(f"{document}:{line + 1}: another table than the rates give; run tools/scale.py --write {document}")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
