#!/usr/bin/env python3
"""Measures a server whose scene lies behind a slow network: its requests for a view, and the time until it is complete.

  far_serve.py --bin DIR [--bin DIR ...] [--round-trip 50] [--views 8] SCENE

Publishes the scene into a temporary directory, serves that by nginx behind a proxy that delays every piece by half the
round trip each way, and starts `lumigrid serve` of it with an empty cache. A new viewer (`lumigrid-view --headless`)
for each view of a tour then waits for its view; nothing is sent ahead of need. Medians over the views, of each --bin in
turn, so that builds can be compared on a busy machine.
"""
import argparse
import asyncio
import json
import os
import re
import statistics
import subprocess
import sys
import tempfile
import threading
import time


def run(*command):
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"{' '.join(map(str, command))}: status {done.returncode}: {done.stderr.strip()}")
    return done.stdout


class DelayProxy:
    """Forwards bytes in their order, `delay` seconds later."""

    def __init__(self, to_port, delay):
        self.to_port, self.delay = to_port, delay
        self.loop = asyncio.new_event_loop()
        self.port = None
        ready = threading.Event()
        threading.Thread(target=self.work, args=(ready,), daemon=True).start()
        ready.wait()

    def work(self, ready):
        asyncio.set_event_loop(self.loop)
        server = self.loop.run_until_complete(asyncio.start_server(self.serve, "127.0.0.1", 0))
        self.port = server.sockets[0].getsockname()[1]
        ready.set()
        self.loop.run_forever()

    async def serve(self, reader, writer):
        await asyncio.sleep(2 * self.delay)  # of the connection itself
        there, to = await asyncio.open_connection("127.0.0.1", self.to_port)
        await asyncio.gather(self.pipe(reader, to), self.pipe(there, writer))

    async def pipe(self, reader, writer):
        queue = asyncio.Queue()

        async def send():
            while True:
                due, data = await queue.get()
                await asyncio.sleep(max(0.0, due - self.loop.time()))
                if not data:
                    break
                writer.write(data)
                await writer.drain()
            writer.close()

        task = asyncio.ensure_future(send())
        try:
            while data := await reader.read(65536):
                queue.put_nowait((self.loop.time() + self.delay, data))
        except OSError:
            pass
        queue.put_nowait((self.loop.time() + self.delay, b""))
        try:
            await task
        except OSError:
            pass


class Nginx:
    def __init__(self, root, work):
        self.log = os.path.join(work, "access.log")
        self.port = None
        for port in range(20000 + os.getpid() % 20000, 60000):
            conf = os.path.join(work, "nginx.conf")
            temporary = "".join(f"{kind}_temp_path {work}/{kind};" for kind in
                                ("client_body", "proxy", "fastcgi", "uwsgi", "scgi"))
            with open(conf, "w") as f:
                f.write(f"daemon off; master_process off; pid {work}/nginx.pid; error_log {work}/error.log; "
                        f"events {{}} http {{ access_log {self.log}; {temporary} "
                        f"server {{ listen 127.0.0.1:{port}; root {root}; }} }}")
            self.process = subprocess.Popen(["/usr/sbin/nginx", "-e", f"{work}/error.log", "-c", conf],
                                            stderr=subprocess.DEVNULL)
            time.sleep(0.5)
            if self.process.poll() is None:
                self.port = port
                return
        sys.exit("nginx does not start")

    def faces(self):
        """Counts the requests for images and index so far."""
        with open(self.log) as f:
            return sum(1 for line in f if re.search(r"(pack|index)-", line))


def measure(programs, url, path, views, work, nginx):
    with tempfile.TemporaryDirectory(dir=work) as cache:
        command = [os.path.join(programs, "lumigrid"), "serve", url, "--port", "0", "--json", "--no-frames",
                   "--prefetch", "0", "--cache", cache]
        server = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        there, text = None, ""
        while there is None:
            text += server.stdout.readline()
            try:
                there = json.loads(text)["url"]
            except ValueError:
                pass
        requests, seconds = [], []
        for view in range(views):
            one = os.path.join(work, "one.json")
            document = json.load(open(path))
            frames = document if isinstance(document, list) else document["frames"]
            with open(one, "w") as f:
                json.dump([frames[view]] if isinstance(document, list) else {**document, "frames": [frames[view]]}, f)
            before = nginx.faces()
            run(os.path.join(programs, "lumigrid-view"), there, "--headless", "--path", one,
                "--out", os.path.join(work, "v"))
            frame = json.loads(open(os.path.join(work, "v", "frames.jsonl")).readline())
            if not frame["complete"]:
                sys.exit(f"view {view} of {programs} was not complete")
            seconds.append(frame["seconds"])
            time.sleep(0.2)  # nginx writes its log after its answer
            requests.append(nginx.faces() - before)
        server.terminate()
        server.wait()
        return requests, seconds


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("--bin", action="append", required=True, help="directory with lumigrid and lumigrid-view")
    parser.add_argument("--round-trip", type=float, default=50.0, help="milliseconds")
    parser.add_argument("--views", type=int, default=8)
    a = parser.parse_args()
    with tempfile.TemporaryDirectory() as work:
        site = os.path.join(work, "site")
        os.chmod(work, 0o755)
        run(os.path.join(a.bin[0], "lumigrid"), "publish", a.scene, os.path.join(site, "scene"), "--viewer", "off",
            "--quiet")
        path = os.path.join(work, "tour.json")
        run(os.path.join(a.bin[0], "lumigrid"), "tour", a.scene, "--frames", a.views, "--size", 640, 480, "-o", path)
        nginx = Nginx(site, work)
        proxy = DelayProxy(nginx.port, a.round_trip / 2000.0)
        for programs in a.bin:
            requests, seconds = measure(programs, f"http://127.0.0.1:{proxy.port}/scene", path, a.views, work, nginx)
            print(f"{programs}: {a.round_trip:g} ms round trip: {statistics.median(requests):g} requests for "
                  f"images and index a view ({requests}), {statistics.median(seconds):.2f} s to a complete view "
                  f"({[round(s, 2) for s in seconds]})", flush=True)
        nginx.process.terminate()


if __name__ == "__main__":
    main()
