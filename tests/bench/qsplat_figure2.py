#!/usr/bin/env python3
"""Makes figure 2 of Streaming QSplat (Rusinkiewicz and Levoy 2001) with a real nginx: the pictures of a slow link by
second.

  qsplat_figure2.py --bin DIR [--bandwidth 384kbit] [--latency 100ms] [--seconds 0,1,10,60] [--pictures DIR] SCENE

Serves the scene (`lumigrid build ... --methods qsplat`) with nginx (Debian: nginx-light), follows the second of
qsplat_stream_bench's views with `lumigrid-view --headless` over a link of that rate, and prints for each second after
the front of the file came: splats drawn, bytes, and PSNR against the same view from the same host without a limit, over
the pixels where either shows the model.
"""
import argparse
import json
import math
import os
import shutil
import socket
import struct
import subprocess
import sys
import tempfile
import time
import zlib

WIDTH, HEIGHT = 1280, 720
TURN, PITCH, RADII = 2.1, 0.9, 1.2
RATE = 2  # frames a second: a view asks for what it lacks when it is drawn
GREY, COVERED = 118, 128  # as in compare/accuracy.cpp and base/picture_error.h


def rows_of(path):
    """Of an RGBA PNG of 8 bits without interlace."""
    data = open(path, "rb").read()
    at, packed = 8, b""
    while at < len(data):
        length, kind = struct.unpack(">I4s", data[at:at + 8])
        if kind == b"IDAT":
            packed += data[at + 8:at + 8 + length]
        at += 12 + length
    raw, step, before = zlib.decompress(packed), 4 * WIDTH, bytearray(4 * WIDTH)
    for y in range(HEIGHT):
        kind, row = raw[y * (step + 1)], bytearray(raw[y * (step + 1) + 1:(y + 1) * (step + 1)])
        if kind == 1:
            for i in range(4, step):
                row[i] = (row[i] + row[i - 4]) & 255
        elif kind == 2:
            row = bytearray((a + b) & 255 for a, b in zip(row, before))
        elif kind == 3:
            for i in range(step):
                row[i] = (row[i] + (((row[i - 4] if i > 3 else 0) + before[i]) >> 1)) & 255
        elif kind == 4:
            for i in range(step):
                a, b, c = (row[i - 4], before[i], before[i - 4]) if i > 3 else (0, before[i], 0)
                p, q, r = abs(b - c), abs(a - c), abs(a + b - 2 * c)
                row[i] = (row[i] + (a if p <= q and p <= r else b if q <= r else c)) & 255
        yield row
        before = row


def psnr(truth, picture):
    squares = count = 0
    for a, b in zip(rows_of(truth), rows_of(picture)):
        for i in range(0, 4 * WIDTH, 4):
            if a[i + 3] < COVERED and b[i + 3] < COVERED:
                continue
            count += 3
            for c in range(i, i + 3):
                x = GREY + (a[c] - GREY) * a[i + 3] / 255
                y = GREY + (b[c] - GREY) * b[i + 3] / 255
                squares += (x - y) * (x - y)
    return 10 * math.log10(255 * 255 * count / squares) if squares else math.inf


def path_of(scene, frames, file):
    with open(os.path.join(scene, "qsplat.lgq"), "rb") as tree:
        x, y, z, radius = struct.unpack("<4f", tree.read(80)[64:])  # docs/formats/qsplat.md
    origin = json.load(open(os.path.join(scene, "scene.json")))["origin"]
    away = (math.cos(TURN) * math.cos(PITCH), math.sin(TURN) * math.cos(PITCH), math.sin(PITCH))
    camera = dict(position=[o + c + RADII * radius * a for o, c, a in zip(origin, (x, y, z), away)],
                  direction=[-a for a in away], up=[0, 0, 1])
    json.dump(dict(version=1, width=WIDTH, height=HEIGHT, frames=[camera] * frames), open(file, "w"))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", required=True)
    parser.add_argument("--bandwidth", default="384kbit")
    parser.add_argument("--latency", default="100ms")
    parser.add_argument("--seconds", default="0,1,10,60")
    parser.add_argument("--pictures", help="folder to copy the pictures to")
    parser.add_argument("scene")
    a = parser.parse_args()
    seconds = [int(s) for s in a.seconds.split(",")]
    scene = os.path.abspath(a.scene)
    viewer = os.path.join(a.bin, "lumigrid-view")
    nginx = next((p for p in ("/usr/sbin/nginx", "/usr/bin/nginx", "/usr/local/sbin/nginx") if os.path.exists(p)), None)
    if nginx is None:
        sys.exit("nginx is not installed (Debian: nginx-light)")
    with tempfile.TemporaryDirectory() as work:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        conf = os.path.join(work, "nginx.conf")
        with open(conf, "w") as out:
            temporary = " ".join(f"{kind}_temp_path {work}/{kind};"
                                 for kind in ("client_body", "proxy", "fastcgi", "uwsgi", "scgi"))
            out.write(f"daemon off; master_process off; pid {work}/pid; error_log {work}/error.log;\n"
                      f"events {{}}\nhttp {{ access_log off; {temporary}\n"
                      f"server {{ listen 127.0.0.1:{port}; root {scene}; }} }}\n")
        server = subprocess.Popen([nginx, "-e", f"{work}/error.log", "-p", work, "-c", conf])
        try:
            time.sleep(0.5)

            def view_path(name, frames, *options):
                path_of(scene, frames, f"{work}/{name}.json")
                done = subprocess.run([viewer, f"http://127.0.0.1:{port}/", "--headless", "--method", "qsplat",
                                       "--path", f"{work}/{name}.json", "--out", f"{work}/{name}", "--idle", "0",
                                       "--frame-rate", "0", *map(str, options)], capture_output=True, text=True)
                if done.returncode != 0:
                    sys.exit(f"lumigrid-view: {done.stderr.strip()}")
                return [json.loads(line) for line in open(f"{work}/{name}/frames.jsonl")]

            whole = view_path("whole", 1, "--settle", "300")[0]
            slow = view_path("slow", RATE * max(seconds) + 1, "--realtime", RATE, "--bandwidth", a.bandwidth,
                        "--latency", a.latency)
            truth = f"{work}/whole/frame_0000.png"
            print(f"without a limit: all after {whole['seconds']:.2f} s, {whole['splats']['drawn']} splats, "
                  f"{whole['bytes']['total'] / 1e6:.2f} MB")
            for second in seconds:
                line = slow[RATE * second]
                print(f"{line['seconds']:5.1f} s: {line['splats']['drawn']:8} splats, "
                      f"{line['bytes']['total'] / 1e6:6.3f} MB, "
                      f"{psnr(truth, f'{work}/slow/frame_{RATE * second:04}.png'):5.1f} dB", flush=True)
            if a.pictures:
                os.makedirs(a.pictures, exist_ok=True)
                shutil.copy(truth, os.path.join(a.pictures, "whole.png"))
                for second in seconds:
                    shutil.copy(f"{work}/slow/frame_{RATE * second:04}.png",
                                os.path.join(a.pictures, f"{second}_s.png"))
        finally:
            server.terminate()
            server.wait()


main()
