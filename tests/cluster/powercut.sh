#!/usr/bin/env bash
# Cuts the power (ext4 on a loop device, shutdown ioctl) at random moments of builds of images and hierarchies. Needs
# root. Prints PASS, FAIL or SKIP on its last line.
exec python3 "$(dirname "$0")/lib/crash.py" powercut
