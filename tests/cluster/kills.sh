#!/usr/bin/env bash
# Kills 20 builds (kill -9) at random moments of the images stage, with a reader beside them. Prints PASS or FAIL on its
# last line.
exec python3 "$(dirname "$0")/lib/crash.py" kills
