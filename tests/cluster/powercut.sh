#!/usr/bin/env bash
# Power cuts (ext4 on a loop device, shutdown ioctl) at random moments of builds of images and hierarchies; root only. One line
# at the end: PASS, FAIL or SKIP.
exec python3 "$(dirname "$0")/lib/crash.py" powercut
