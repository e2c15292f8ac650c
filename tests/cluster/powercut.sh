#!/usr/bin/env bash
# Cuts the power (ext4 on a loop device, shutdown ioctl) 5 times at random moments of the images stage and 5 times in
# builds of hierarchies; finished scenes must equal uninterrupted builds. It takes some minutes and needs root, a loop
# device and mkfs.ext4, 512 MB under $TMPDIR, python3 and, in build/release or $LUMIGRID_BUILD, bin/lumigrid and
# tests/store_reader. Without root or a loop device it skips. Prints PASS, FAIL or SKIP on its last line.
exec python3 "$(dirname "$0")/lib/crash.py" powercut
