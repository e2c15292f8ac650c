#!/usr/bin/env bash
# 20 x kill -9 of builds at random moments of the images stage, with a reader beside them. One line at the end: PASS or FAIL.
exec python3 "$(dirname "$0")/lib/crash.py" kills
