#!/usr/bin/env python3
"""Uniform grids against sampling by use: bytes and images against accuracy from held-out places.

  sampling.py --bin DIR --work DIR --chart FILE.svg [--grid 17] [--face 512] [--uniform 5,9,17]
              [--worths 0.85,0.93] [--budgets 2M,5M] MESH

Builds a scene of the mesh with `lumigrid build` for each (those in the work directory are taken as they are), looks at
16 views from random places for which no points were selected (`lumigrid tour --random`), as a client over a socket
(`lumigrid-compare`, without exact frames), and prints a row each: points, images, bytes, mean and worst PSNR on
foreground pixels. The chart has bytes on a logarithmic axis.
"""
import argparse
import csv
import json
import math
import os
import subprocess
import sys

VIEWS, SIZE = 16, ("640", "480")


def run(*command):
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"{' '.join(map(str, command))}: status {done.returncode}: {done.stderr.strip()}")
    return done.stdout


def measure(a, label, options):
    lumigrid, scene = os.path.join(a.bin, "lumigrid"), os.path.join(a.work, label.replace(" ", "_"))
    run(lumigrid, "build", a.mesh, "-o", scene, "--face", a.face, *options, "--quiet")
    views = os.path.join(a.work, "held_out.json")
    if not os.path.exists(views):
        run(lumigrid, "tour", scene, "--random", VIEWS, "--size", *SIZE, "-o", views)
    report = scene + "_report"
    run(os.path.join(a.bin, "lumigrid-compare"), scene, "--clock", "real", "--path", views, "--report", report,
        "--methods", "lumigraph", "--no-frames", "--proxy-tolerance", 4, "--no-pictures")
    images = json.loads(run(lumigrid, "info", scene, "--json"))["images"]
    rows = list(csv.DictReader(open(os.path.join(report, "results.csv"))))
    psnr = [float(r["psnr_db"]) for r in rows if r["method"] == "lumigraph"]
    proxy = [float(r["psnr_db"]) for r in rows if r["method"] == "proxy"]
    row = dict(label=label, points=images["points"], images=images["images"],
               bytes=images["jpeg_bytes"] + images["coverage_bytes"], mean=sum(psnr) / len(psnr), worst=min(psnr),
               proxy=sum(proxy) / len(proxy))
    print(f"{label:>14} {row['points']:6} points {row['images']:6} images {row['bytes'] / 1e6:8.2f} MB "
          f"{row['mean']:6.2f} dB, worst {row['worst']:5.2f} (proxy alone {row['proxy']:.2f})", flush=True)
    return row


def chart(rows, title, path):
    width, height, left, top, right, bottom = 640, 400, 60, 40, 20, 50
    xs = [math.log10(r["bytes"]) for r in rows]
    ys = [r["mean"] for r in rows]
    x0, x1 = min(xs) - 0.1, max(xs) + 0.1
    y0, y1 = math.floor(min(ys) - 0.3), math.ceil(max(ys) + 0.3)
    px = lambda x: left + (x - x0) / (x1 - x0) * (width - left - right)
    py = lambda y: height - bottom - (y - y0) / (y1 - y0) * (height - top - bottom)
    out = [f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" font-family="sans-serif" '
           f'font-size="12"><rect width="100%" height="100%" fill="white"/><text x="{left}" y="20" font-size="14">'
           f"{title}</text>"]
    for y in range(y0, y1 + 1):
        out.append(f'<line x1="{left}" x2="{width - right}" y1="{py(y):.1f}" y2="{py(y):.1f}" stroke="#ddd"/>'
                   f'<text x="{left - 8}" y="{py(y) + 4:.1f}" text-anchor="end">{y}</text>')
    for mb in (0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500):
        x = math.log10(mb * 1e6)
        if x0 <= x <= x1:
            out.append(f'<line x1="{px(x):.1f}" x2="{px(x):.1f}" y1="{top}" y2="{height - bottom}" stroke="#ddd"/>'
                       f'<text x="{px(x):.1f}" y="{height - bottom + 16}" text-anchor="middle">{mb:g}</text>')
    out.append(f'<text x="{width / 2}" y="{height - 12}" text-anchor="middle">MB of images and masks</text>'
               f'<text x="14" y="{height / 2}" transform="rotate(-90 14 {height / 2})" text-anchor="middle">'
               "mean PSNR of held-out views, dB</text>")
    kinds = (("uniform", "#1f77b4", "uniform grids: points along the longest side"),
             ("by use", "#2ca02c", "points by use: --worth"), ("budget", "#d62728", "points by use: --budget"))
    for n, (kind, color, meaning) in enumerate(kinds):
        mine = sorted((r for r in rows if r["label"].startswith(kind)), key=lambda r: r["bytes"])
        if not mine:
            continue
        out.append(f'<text x="{width - right - 10}" y="{height - bottom - 10 - 16 * n}" text-anchor="end" '
                   f'fill="{color}">'
                   f"{meaning}</text>")
        points = " ".join(f"{px(math.log10(r['bytes'])):.1f},{py(r['mean']):.1f}" for r in mine)
        out.append(f'<polyline points="{points}" fill="none" stroke="{color}" stroke-width="2"/>')
        for before, r in zip([mine[0]] + mine, mine):
            x, y = px(math.log10(r["bytes"])), py(r["mean"])
            beside = 18 if r["mean"] < before["mean"] else -8  # the label of a falling point stands below it
            out.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4" fill="{color}"/>'
                       f'<text x="{x:.1f}" y="{y + beside:.1f}" text-anchor="middle">'
                       f'{r["label"][len(kind):].strip()}</text>')
    open(path, "w").write("\n".join(out) + "\n</svg>\n")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("mesh")
    parser.add_argument("--bin", required=True, help="directory with lumigrid and lumigrid-compare")
    parser.add_argument("--work", required=True, help="directory for scenes and reports")
    parser.add_argument("--chart", required=True)
    parser.add_argument("--grid", default="17", help="the grid that points are selected from")
    parser.add_argument("--face", default="512")
    parser.add_argument("--uniform", default="5,9,17")
    parser.add_argument("--worths", default="0.85,0.93", help="--worth of points selected for random views")
    parser.add_argument("--budgets", default="", help="--budget of such points, e.g. 2M")
    parser.add_argument("--views", default="1000", help="the number of these views")
    a = parser.parse_args()
    os.makedirs(a.work, exist_ok=True)
    rows = [measure(a, "uniform " + n, ["--grid", n]) for n in a.uniform.split(",") if n]
    rows += [measure(a, f"by use {w}", ["--grid", a.grid, "--views", a.views, "--worth", w])
             for w in a.worths.split(",") if w]
    rows += [measure(a, f"budget {b}", ["--grid", a.grid, "--views", a.views, "--budget", b])
             for b in a.budgets.split(",") if b]
    chart(rows, f"{os.path.splitext(os.path.basename(a.mesh))[0]}: uniform grids, and points selected from a "
                f"grid of {a.grid}", a.chart)


if __name__ == "__main__":
    main()
