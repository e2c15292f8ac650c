#!/usr/bin/env bash
# Runs one test file in the browser. Ends with 77 (skipped), and says what is missing, where the page or its tools were
# not set up; ./test sets them up.
here=$(cd "$(dirname "$0")" && pwd)
skip() { echo "skipped: $*"; exit 77; }
[ -n "${LUMIGRID_NODE:-}" ] && [ "${LUMIGRID_NODE##*-}" != NOTFOUND ] || skip "no node"
[ -x /usr/bin/chromium ] || skip "no chromium: tools/install_packages.sh"
[ -f "$LUMIGRID_SITE/index.html" ] || skip "no page at $LUMIGRID_SITE: cmake --preset web && cmake --build --preset web"
[ -d "$here/node_modules/playwright-core" ] || skip "no playwright-core: npm ci --prefix tests/web"
exec "$LUMIGRID_NODE" --test --test-reporter=spec "$1"
