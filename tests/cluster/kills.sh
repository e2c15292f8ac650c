#!/usr/bin/env bash
# Kills 20 builds (kill -9) at random moments of the images stage, with a reader beside them; committed images must be
# there, and the rerun must render the rest. It takes some minutes (each interruption is followed by `verify` of a copy,
# each scene is finished and compared) and needs python3 and, in build/release or $LUMIGRID_BUILD, bin/lumigrid and
# tests/store_reader. Everything is in a directory of its own under $TMPDIR. Prints PASS or FAIL on its last line.
exec python3 "$(dirname "$0")/lib/crash.py" kills
