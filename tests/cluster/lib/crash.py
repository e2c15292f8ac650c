"""Kills builds and cuts their power. All committed values must be there, and the rerun must render the rest.

    crash.py kills | powercut      (through tests/cluster/kills.sh, powercut.sh)

LUMIGRID_BUILD names the build directory with bin/ and tests/; without it the first one that has them is used.
LUMIGRID_SEED repeats the moments of an earlier run.
"""

import fcntl
import glob
import json
import os
import random
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import time

ROOT = os.path.abspath(os.path.join(os.path.dirname(__file__), "..", "..", ".."))
KILLS = 20
CUTS = 5  # of the images, and as many of the hierarchy

# <linux/fs.h>, formerly <fs/ext4/ext4.h>, has EXT4_IOC_SHUTDOWN = _IOR('X', 125, __u32). With NOLOGFLUSH the journal is
# not written out first, as in a power cut.
EXT4_IOC_SHUTDOWN = 0x8004587D
EXT4_GOING_FLAGS_NOLOGFLUSH = 2


class Failure(Exception):
    pass


class Skip(Exception):
    pass


def find_build():
    for build in [os.environ.get("LUMIGRID_BUILD", ""), ROOT + "/build/release"] + sorted(glob.glob(ROOT + "/build/*")):
        if os.access(build + "/bin/lumigrid", os.X_OK) and os.access(build + "/tests/store_reader", os.X_OK):
            return build
    raise Failure("no built programs; run ./test first, or set LUMIGRID_BUILD")


class Programs:
    def __init__(self):
        build = find_build()
        self.lumigrid = build + "/bin/lumigrid"
        self.store_reader = build + "/tests/store_reader"

    def run(self, *words):
        done = subprocess.run([self.lumigrid, *words], capture_output=True, text=True)
        if done.returncode != 0:
            raise Failure(f"lumigrid {' '.join(words)}: status {done.returncode} {done.stderr.strip()}")
        return done.stdout

    def sample(self, path, triangles):
        self.run("sample", "--triangles", str(triangles), "-o", path)
        return path

    def build(self, mesh, scene, options):
        return json.loads(self.run("build", mesh, "-o", scene, "--quiet", "--json", *options))

    def values(self, scene):
        """Key code -> checksum of every value, all decoded."""
        done = subprocess.run([self.store_reader, scene + "/images", "--once"], capture_output=True, text=True)
        if done.returncode != 0:
            raise Failure(f"{scene}: a value is not whole: {done.stderr.strip()}")
        return parse_values(done.stdout)


def parse_values(text):
    # A reader that was killed may have been writing: only whole lines count.
    lines = [line for line in text.splitlines(keepends=True) if line.endswith("\n")]
    return dict(line.split() for line in lines)


def read(path):
    with open(path, "rb") as file:
        return file.read()


class WatchedBuild:
    """A build, and a process that reads its store all the while and notes each value when it can be seen."""

    def __init__(self, programs, mesh, scene, options, notes):
        self.notes = notes
        with open(notes + ".build", "w") as log:
            self.builder = subprocess.Popen(
                [programs.lumigrid, "build", mesh, "-o", scene, "--quiet", *options], stdout=log, stderr=log
            )
        with open(notes + ".seen", "w") as out, open(notes + ".reader", "w") as err:
            self.reader = subprocess.Popen([programs.store_reader, scene + "/images"], stdout=out, stderr=err)

    def seen(self):
        with open(self.notes + ".seen") as file:
            return parse_values(file.read())

    def running(self):
        if self.reader.poll() is not None:
            raise Failure("the reader beside the build: " + open(self.notes + ".reader").read().strip())
        status = self.builder.poll()
        if status not in (None, 0):
            raise Failure("the build: " + open(self.notes + ".build").read().strip())
        return status is None

    def wait_until_seen(self, count):
        """False when the build ended first."""
        while len(self.seen()) < count:
            if not self.running():
                return False
            time.sleep(0.002)
        return True

    def kill_builder(self):
        """True when it was killed, not finished."""
        self.builder.kill()
        return self.builder.wait() == -signal.SIGKILL

    def stop_reader(self, number=signal.SIGTERM):
        self.reader.send_signal(number)
        if self.reader.wait() not in (0, -number):
            raise Failure("the reader beside the build: " + open(self.notes + ".reader").read().strip())

    def end(self):
        for process in (self.builder, self.reader):
            if process.poll() is None:
                process.kill()
                process.wait()


def expect_kept(there, committed, whole, when):
    lost = committed.keys() - there.keys()
    if lost:
        raise Failure(f"{when}: {len(lost)} of {len(committed)} committed images are gone")
    for key, crc in there.items():
        if committed.get(key, crc) != crc or whole.get(key) != crc:
            raise Failure(f"{when}: image {key} is another than the uninterrupted build's")


def expect_rest_rendered(summary, there, whole, when):
    rendered, skipped = summary["images"]["rendered"], summary["images"]["skipped"]
    if rendered != len(whole) - len(there) or skipped != len(there):
        raise Failure(
            f"{when}: the rerun rendered {rendered} and skipped {skipped}; {len(there)} of {len(whole)} were there"
        )


class Interruptions:
    """Interrupts the images stage again and again, with `interrupt` as the blow; finishes each scene that gets near its
    end, and begins another until there were enough."""

    def __init__(self, programs, directory, place, options):
        self.programs, self.place, self.notes = programs, place, directory + "/notes"
        self.options = options
        self.mesh = programs.sample(directory + "/mesh.ply", 20000)
        reference = directory + "/reference"
        programs.build(self.mesh, reference, options)
        self.whole = programs.values(reference)
        self.patches = read(reference + "/patch.lgp")
        self.most_lost = 0
        self.scenes = 0

    def run(self, count, interrupt):
        done = 0
        while done < count:
            self.scenes += 1
            scene = f"{self.place}/scene{self.scenes}"
            committed = {}
            while done < count and not os.path.exists(scene + "/scene.json"):
                if not self.one(scene, committed, interrupt, f"interruption {done + 1}"):
                    break
                done += 1
            self.finish(scene, committed)

    def one(self, scene, committed, interrupt, when):
        """False when the build had ended before."""
        build = WatchedBuild(self.programs, self.mesh, scene, self.options, self.notes)
        try:
            more = random.randrange(len(self.whole) // 8)
            if not build.wait_until_seen(min(len(committed) + more, len(self.whole))):
                build.stop_reader()
                return False
            time.sleep(random.random() * 0.03)
            if not interrupt(build, scene):
                return False
        finally:
            build.end()
        committed.update(build.seen())
        if os.path.exists(scene + "/images/data.mdb"):
            there = self.values_or_none(scene)
            expect_kept(there, committed, self.whole, when)
            self.most_lost = max(self.most_lost, len(there) - len(committed))
            committed.update(there)
            self.verify(scene, there, when)
        elif committed:
            raise Failure(f"{when}: the whole store is gone")
        return True

    def values_or_none(self, scene):
        done = subprocess.run([self.programs.store_reader, scene + "/images", "--once"], capture_output=True, text=True)
        if done.returncode == 0:
            return parse_values(done.stdout)
        if "no image repository here" in done.stderr or "repository is empty" in done.stderr:
            return {}
        raise Failure(f"{scene}: a value is not whole: {done.stderr.strip()}")

    def verify(self, scene, there, when):
        """On a copy that calls itself finished: `verify` finds what is missing and nothing else."""
        if not there:
            return
        copy = self.notes + ".copy"
        shutil.copytree(scene, copy, ignore=shutil.ignore_patterns("*.work"))
        try:
            if os.path.exists(copy + "/building.json"):
                os.rename(copy + "/building.json", copy + "/scene.json")
            said = subprocess.run([self.programs.lumigrid, "verify", copy, "--json"], capture_output=True, text=True)
            faults = json.loads(said.stdout)["faults"]
            other = [fault for fault in faults if not fault.endswith(": missing") and "perhaps more" not in fault]
            if other:
                raise Failure(f"{when}: verify finds {other[0]}")
            if bool(faults) != (len(there) < len(self.whole)):
                raise Failure(f"{when}: {len(self.whole) - len(there)} images are missing, verify names {len(faults)}")
        finally:
            shutil.rmtree(copy)

    def finish(self, scene, committed):
        if not os.path.exists(scene + "/scene.json"):
            summary = self.programs.build(self.mesh, scene, self.options)
            expect_rest_rendered(summary, committed, self.whole, scene)
        if self.programs.values(scene) != self.whole:
            raise Failure(f"{scene}: the finished scene differs from an uninterrupted build")
        if read(scene + "/patch.lgp") != self.patches:
            raise Failure(f"{scene}: its hierarchy differs from an uninterrupted build's")
        self.programs.run("verify", scene)


IMAGE_OPTIONS = ["--grid", "8", "--face", "128", "--batch", "20"]


def kills(directory):
    programs = Programs()

    def kill(build, _):
        killed = build.kill_builder()
        build.stop_reader()
        return killed

    test = Interruptions(programs, directory, directory, IMAGE_OPTIONS)
    test.run(KILLS, kill)
    return (
        f"{KILLS} kills in {test.scenes} builds of {len(test.whole)} images: no committed image lost or changed, "
        "the reruns rendered what was missing and nothing else"
    )


class Disk:
    """An ext4 in a file, whose power can be cut."""

    def __init__(self, directory):
        self.mount_point = directory + "/disk"
        self.image = directory + "/disk.img"
        self.loop = None
        os.mkdir(self.mount_point)
        with open(self.image, "wb") as file:
            file.truncate(512 << 20)
        subprocess.run(["mkfs.ext4", "-q", "-F", self.image], check=True)

    def mount(self):
        # The device is the system's choice.
        attached = subprocess.run(["losetup", "--find", "--show", self.image], capture_output=True, text=True)
        if attached.returncode != 0:
            raise Skip("no loop device: " + attached.stderr.strip())
        self.loop = attached.stdout.strip()
        subprocess.run(["mount", "-t", "ext4", self.loop, self.mount_point], check=True)

    def mounted(self):
        with open("/proc/self/mounts") as mounts:
            return any(line.split()[1] == self.mount_point for line in mounts)

    def unmount(self):
        """True when nothing is mounted there any more."""
        for attempt in range(50):
            if not self.mounted():
                break
            subprocess.run(["umount", self.mount_point], capture_output=True)
            time.sleep(0.02 * attempt)
        if self.loop and not self.mounted():
            subprocess.run(["losetup", "--detach", self.loop], capture_output=True)
            self.loop = None
        return not self.mounted()

    def cut_power(self):
        directory = os.open(self.mount_point, os.O_RDONLY | os.O_DIRECTORY)
        try:
            fcntl.ioctl(directory, EXT4_IOC_SHUTDOWN, struct.pack("I", EXT4_GOING_FLAGS_NOLOGFLUSH))
        finally:
            os.close(directory)

    def power_up(self):
        if not self.unmount():
            raise Failure(f"{self.mount_point}: cannot unmount after the cut")
        self.mount()  # replays the journal


class Witness:
    """A new file written without fsync just before each cut. Its loss proves that there was a cut. (A file written over
    would not do: ext4 flushes a file that was emptied and written again.)"""

    def __init__(self, disk):
        self.directory = disk.mount_point
        self.path = None
        self.bytes = os.urandom(1 << 20)
        self.written = 0
        self.lost = 0

    def write(self):
        self.written += 1
        self.path = f"{self.directory}/witness{self.written}"
        with open(self.path, "wb") as file:
            file.write(self.bytes)

    def check(self):
        if not os.path.exists(self.path) or read(self.path) != self.bytes:
            self.lost += 1


def cut_images(programs, directory, disk, witness):
    def cut(build, _):
        witness.write()
        disk.cut_power()
        build.kill_builder()
        build.stop_reader(signal.SIGKILL)
        disk.power_up()
        witness.check()
        return True

    test = Interruptions(programs, directory, disk.mount_point, IMAGE_OPTIONS)
    test.run(CUTS, cut)
    return test


def cut_hierarchy(programs, directory, disk, witness):
    options = ["--methods", "patch"]
    mesh = programs.sample(directory + "/large.ply", 300000)
    reference = disk.mount_point + "/reference"
    begin = time.monotonic()
    programs.build(mesh, reference, options)
    seconds = time.monotonic() - begin
    patches, description = read(reference + "/patch.lgp"), read(reference + "/scene.json")

    cuts = 0
    scenes = 0
    while cuts < CUTS:
        scenes += 1
        scene = f"{disk.mount_point}/hierarchy{scenes}"
        while cuts < CUTS and not os.path.exists(scene + "/scene.json"):
            with open(directory + "/log", "w") as log:
                build = subprocess.Popen(
                    [programs.lumigrid, "build", mesh, "-o", scene, "--quiet", *options], stdout=log, stderr=log
                )
            try:
                time.sleep(random.random() * seconds)
                if build.poll() is not None:
                    break
                witness.write()
                disk.cut_power()
            finally:
                if build.poll() is None:
                    build.kill()
                build.wait()
            disk.power_up()
            witness.check()
            cuts += 1
            if os.path.exists(scene + "/patch.lgp") and read(scene + "/patch.lgp") != patches:
                raise Failure(f"cut {cuts}: patch.lgp is there, but not whole")
        rerun = not os.path.exists(scene + "/scene.json")
        if rerun:
            programs.build(mesh, scene, options)
        if read(scene + "/patch.lgp") != patches or read(scene + "/scene.json") != description:
            raise Failure(f"{scene}: differs from an uninterrupted build")
        # A cut just after scene.json appeared may bring back what was removed then.
        stayed = set(os.listdir(scene)) - {"patch.lgp", "scene.json"}
        stayed -= set() if rerun else {"building.json", "build.lock"}
        if stayed:
            raise Failure(f"{scene}: work files stayed: {sorted(stayed)}")
        programs.run("verify", scene)


def powercut(directory):
    if os.geteuid() != 0:
        raise Skip("only root may mount a disk")
    programs = Programs()
    disk = Disk(directory)
    try:
        disk.mount()
        witness = Witness(disk)
        test = cut_images(programs, directory, disk, witness)
        cut_hierarchy(programs, directory, disk, witness)
        if witness.lost != 2 * CUTS:
            raise Failure(f"only {witness.lost} of {2 * CUTS} cuts lost what was not synced: these were no power cuts")
    finally:
        if not disk.unmount():
            raise Failure(f"{disk.mount_point} stays mounted; unmount it and remove {directory}")
    return (
        f"{CUTS} power cuts in {test.scenes} builds of {len(test.whole)} images, {CUTS} in builds of the hierarchy: no "
        "committed image lost or changed, the reruns made what was missing and ended like uninterrupted builds"
    )


def main():
    name = sys.argv[1]
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # so that what is mounted is unmounted
    seed = int(os.environ.get("LUMIGRID_SEED", random.randrange(1 << 30)))
    random.seed(seed)
    directory = tempfile.mkdtemp(prefix=f"lumigrid-{name}-")
    try:
        print(f"PASS {name}: {({'kills': kills, 'powercut': powercut}[name])(directory)}")
        return 0
    except Skip as reason:
        print(f"SKIP {name}: {reason}")
        return 0
    except (Failure, OSError, subprocess.CalledProcessError) as failure:
        print(f"FAIL {name}: {failure} (LUMIGRID_SEED={seed})")
        return 1
    finally:
        # Never into anything that is mounted.
        with open("/proc/self/mounts") as mounts:
            if not any(line.split()[1].startswith(directory) for line in mounts):
                subprocess.run(["rm", "-rf", "--one-file-system", directory], check=False)


if __name__ == "__main__":
    sys.exit(main())
