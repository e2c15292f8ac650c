#!/usr/bin/env bash
# Runs a real S3 store on this machine: OpenStack Swift with s3api, three replicas on three storage nodes. It writes,
# lists, reads by range, mirrors and removes objects; expects wrong keys, buckets and names to be named errors;
# publishes a scene and serves it by two servers with a cache each; and kills one storage node under a reader and
# under viewers, who notice nothing. It takes about a minute and needs root (storage files carry extended attributes),
# build/release or $LUMIGRID_BUILD, and Debian's python3-swift and memcached, which it installs. Everything is on
# 127.0.0.1, in a directory of its own, and is stopped by process id.
set -euo pipefail
name=objectstore
root=$(cd "$(dirname "$0")/../.." && pwd)
probe=${LUMIGRID_BUILD:-$root/build/release}/tests/object_probe
fail() { echo "FAIL $name: $*"; exit 1; }
[ -x "$probe" ] || fail "$probe is not built"
python=/usr/bin/python3
if ! $python -c 'import swift.common.middleware.s3api' 2>/dev/null || ! command -v memcached >/dev/null; then
  [ "$(id -u)" = 0 ] || fail "needs root, to install python3-swift and memcached"
  apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -qq -y --no-install-recommends python3-swift \
    memcached >/dev/null
fi

work=$(mktemp -d "${TMPDIR:-/tmp}/lumigrid-objectstore.XXXXXX")
declare -A pids=()
stop() { # processes by their id, and wait until they are gone
  local pid
  for pid in "$@"; do
    kill "$pid" 2>/dev/null || continue
    for _ in $(seq 50); do kill -0 "$pid" 2>/dev/null || continue 2; sleep 0.1; done
    kill -9 "$pid" 2>/dev/null || true
  done
}
clean_up() {
  local status=$?
  stop "${pids[@]}"
  if [ $status -eq 0 ] || [ -z "${KEEP:-}" ]; then rm -rf --one-file-system "$work"; else echo "kept $work"; fi
}
trap clean_up EXIT
trap 'exit 130' INT TERM

# --- The store

mapfile -t ports < <($python - <<'PY'
import socket
held = [socket.socket() for _ in range(11)]
for s in held: s.bind(("127.0.0.1", 0))
for s in held: print(s.getsockname()[1])
PY
)
proxy_port=${ports[9]} memcached_port=${ports[10]}
mkdir "$work/etc"
cat >"$work/etc/swift.conf" <<END
[swift-hash]
swift_hash_path_suffix = lumigrid
[storage-policy:0]
name = three
default = yes
END
# Swift's own commands read /etc/swift; this one reads the test's configuration.
cat >"$work/swift_server.py" <<'END'
import sys
from swift.common import utils
directory, configuration, kind = sys.argv[1:]
utils.set_swift_dir(directory)
from swift.common.wsgi import run_wsgi
sys.exit(run_wsgi(configuration, kind))
END
ring() {
  $python -c 'import sys; from swift.cli.ringbuilder import main
sys.exit(main(["swift-ring-builder"] + sys.argv[1:]))' "$@" >/dev/null
}
start() { # start NAME KIND CONFIGURATION
  $python "$work/swift_server.py" "$work/etc" "$3" "$2" >"$work/$1.log" 2>&1 &
  pids[$1]=$!
  disown $!
}
kinds=(account container object)
for k in 0 1 2; do
  kind=${kinds[k]}
  ring "$work/etc/$kind.builder" create 4 3 0
  for node in 0 1 2; do
    ring "$work/etc/$kind.builder" add "r1z$node-127.0.0.1:${ports[3 * node + k]}/disk$node" 1
  done
  ring "$work/etc/$kind.builder" rebalance
  for node in 0 1 2; do
    mkdir -p "$work/node$node/disk$node"
    cat >"$work/etc/$kind$node.conf" <<END
[DEFAULT]
bind_ip = 127.0.0.1
bind_port = ${ports[3 * node + k]}
devices = $work/node$node
mount_check = false
workers = 0
user = $(id -un)
swift_dir = $work/etc
[pipeline:main]
pipeline = $kind-server
[app:$kind-server]
use = egg:swift#$kind
END
    start "$kind$node" "$kind-server" "$work/etc/$kind$node.conf"
  done
done
cat >"$work/etc/proxy.conf" <<END
[DEFAULT]
bind_ip = 127.0.0.1
bind_port = $proxy_port
workers = 0
user = $(id -un)
swift_dir = $work/etc
[pipeline:main]
pipeline = catch_errors gatekeeper listing_formats cache s3api tempauth copy bulk slo dlo versioned_writes proxy-server
[filter:catch_errors]
use = egg:swift#catch_errors
[filter:gatekeeper]
use = egg:swift#gatekeeper
[filter:listing_formats]
use = egg:swift#listing_formats
[filter:cache]
use = egg:swift#memcache
memcache_servers = 127.0.0.1:$memcached_port
[filter:copy]
use = egg:swift#copy
[filter:dlo]
use = egg:swift#dlo
[filter:versioned_writes]
use = egg:swift#versioned_writes
[filter:s3api]
use = egg:swift#s3api
[filter:tempauth]
use = egg:swift#tempauth
user_test_tester = testing .admin
user_test_guest = guest
[filter:bulk]
use = egg:swift#bulk
[filter:slo]
use = egg:swift#slo
[app:proxy-server]
use = egg:swift#proxy
account_autocreate = true
END
memcached -l 127.0.0.1 -p "$memcached_port" -U 0 -u "$(id -un)" &
pids[memcached]=$!
start proxy proxy-server "$work/etc/proxy.conf"

export HOME=$work no_proxy=127.0.0.1 AWS_ENDPOINT_URL=http://127.0.0.1:$proxy_port AWS_ACCESS_KEY_ID=test:tester \
  AWS_SECRET_ACCESS_KEY=testing
unset AWS_PROFILE AWS_SESSION_TOKEN AWS_REGION AWS_DEFAULT_REGION AWS_ENDPOINT_URL_S3 AWS_SHARED_CREDENTIALS_FILE \
  AWS_CONFIG_FILE
for _ in $(seq 60); do # storage servers take their time
  "$probe" make-bucket s3://scenes 2>"$work/made" && break
  sleep 0.5
done
"$probe" list s3://scenes "" >/dev/null || fail "the store does not start: $(cat "$work/made")"
echo "Swift with three storage nodes answers"

# Swift updates its lists with a delay, which is longer on a busy machine or without a node.
expect_list() { # what is there, or nothing; what it means if it is not
  local listed
  for _ in $(seq 60); do
    listed=$("$probe" list $place "")
    [ "$listed" = "$1" ] && return
    sleep 0.5
  done
  fail "$2: $listed"
}

# --- Writing and reading

place=s3://scenes/lab/skull
head -c 3000000 /dev/urandom >"$work/small"
head -c 12000000 /dev/urandom >"$work/large"
sha() { sha256sum "$1" | cut -d' ' -f1; }
"$probe" put $place "packs/one and a half.lgk" "$work/small" || fail "put"
"$probe" put-parts $place patch.lgp "$work/large" || fail "put in parts"
both="packs/one and a half.lgk
patch.lgp"
expect_list "$both" "list"
[ "$("$probe" list $place packs)" = "packs/one and a half.lgk" ] || fail "list of a folder"
[ "$("$probe" size $place patch.lgp)" = 12000000 ] || fail "size"
"$probe" check $place "packs/one and a half.lgk" "$work/small" 200 >/dev/null || fail "ranges"
"$probe" check $place patch.lgp "$work/large" 200 >/dev/null || fail "ranges of an object in parts"
"$probe" check $place patch.lgp "$work/large" 200 "$work/cache" >/dev/null || fail "ranges through the cache"
"$probe" mirror $place patch.lgp "$work/mirror" "$(sha "$work/large")" || fail "mirror"
cmp "$work/large" "$work/mirror/patch.lgp" || fail "the mirrored file"
echo "written, listed, read by range, cached and mirrored"

# --- Errors are named

expect_error() { # expect_error WORDS COMMAND...: status 1 and one line with the words
  local words=$1 line
  shift
  if line=$("$@" 2>&1 >/dev/null); then fail "no error: $*"; fi
  [ "$(wc -l <<<"$line")" = 1 ] || fail "more than one line: $line"
  grep -qF "$words" <<<"$line" || fail "'$words' is not in: $line"
  echo "  $line"
}
expect_error "look at AWS_SECRET_ACCESS_KEY" env AWS_SECRET_ACCESS_KEY=wrong "$probe" size $place patch.lgp
expect_error "look at AWS_SECRET_ACCESS_KEY" env AWS_SECRET_ACCESS_KEY=wrong "$probe" put $place x "$work/small"
expect_error "test:nobody" env AWS_ACCESS_KEY_ID=test:nobody "$probe" size $place patch.lgp
expect_error "access key test:guest may not do this here" env AWS_ACCESS_KEY_ID=test:guest \
  AWS_SECRET_ACCESS_KEY=guest "$probe" size $place patch.lgp
expect_error "no credentials" env -u AWS_ACCESS_KEY_ID -u AWS_SECRET_ACCESS_KEY "$probe" size $place patch.lgp
expect_error "no credentials" env -u AWS_ACCESS_KEY_ID -u AWS_SECRET_ACCESS_KEY "$probe" put $place x "$work/small"
expect_error "there is no bucket 'elsewhere'" "$probe" size s3://elsewhere/skull patch.lgp
expect_error "there is no bucket 'elsewhere'" "$probe" put s3://elsewhere/skull x "$work/small"
expect_error "no such object" "$probe" size $place nothing
expect_error "set AWS_REGION to us-east-1" env AWS_REGION=eu-west-1 "$probe" size $place patch.lgp
expect_list "$both" "what failed left something"

# --- A scene is published, and two servers that keep nothing but a cache serve it

bin=$(dirname "$(dirname "$probe")")/bin
scene=$work/scene tower=s3://scenes/lab/tower
"$bin/lumigrid" sample --triangles 20000 -o "$work/mesh.ply" 2>/dev/null >/dev/null || fail "sample"
"$bin/lumigrid" build "$work/mesh.ply" -o "$scene" --grid 5 --face 128 --quiet >/dev/null || fail "build"
expect_error "look at AWS_SECRET_ACCESS_KEY" env AWS_SECRET_ACCESS_KEY=wrong "$bin/lumigrid" publish "$scene" \
  $tower --quiet
expect_error "there is no bucket 'elsewhere'" "$bin/lumigrid" publish "$scene" s3://elsewhere/tower --quiet
"$bin/lumigrid" publish "$scene" $tower --quiet >/dev/null || fail "publish"
"$bin/lumigrid" verify $tower --quiet || fail "verify of the bucket"
expect_error "no such object" "$bin/lumigrid" verify s3://scenes/lab/none --quiet
"$bin/lumigrid" tour "$scene" --frames 24 --size 320 180 -o "$work/tour.json" || fail "tour"
expect_error "no such object" "$bin/lumigrid" serve s3://scenes/lab/none --port 0 --cache "$work/none"
declare -A url=()
for server in a b; do
  "$bin/lumigrid" serve $tower --port 0 --json --no-frames --no-access --cache "$work/cache-$server" \
    >"$work/serve-$server.out" 2>"$work/serve-$server.err" &
  pids[serve-$server]=$!
  for _ in $(seq 200); do [ -s "$work/serve-$server.out" ] && break; sleep 0.1; done
  url[$server]=$(sed -n 's/.*"url":"\([^"]*\)".*/\1/p' "$work/serve-$server.out")
  [ -n "${url[$server]}" ] || fail "serve: $(cat "$work/serve-$server.err")"
done
view() { # view SERVER NAME: every frame of the tour complete
  "$bin/lumigrid-view" "${url[$1]}" --headless --path "$work/tour.json" --out "$work/$2" >/dev/null \
    2>"$work/$2.err" || fail "viewer $2: $(cat "$work/$2.err")"
  [ "$(grep -c '"complete":true' "$work/$2/frames.jsonl")" = 24 ] || fail "viewer $2: frames are not complete"
}
view a first
echo "published, and served by two servers out of the store"

# --- A storage node dies under a reader, and under viewers

"$probe" check $place patch.lgp "$work/large" 800 >"$work/progress" 2>"$work/trouble" &
reader=$!
until [ -s "$work/progress" ]; do kill -0 $reader 2>/dev/null || break; sleep 0.05; done
kill -9 "${pids[object1]}" "${pids[container1]}" "${pids[account1]}"
echo "one storage node killed after $(tail -n 1 "$work/progress") of 800 reads"
view b second # its cache is empty: all of it comes from the two nodes that are left
grep -E "warning|error" "$work/serve-b.err" && fail "the server noticed"
view a third
stop "${pids[serve-a]}" "${pids[serve-b]}"
wait $reader || fail "the reader noticed: $(cat "$work/trouble")"
"$probe" put-parts $place again.lgp "$work/large" || fail "put without one node"
"$probe" check $place again.lgp "$work/large" 100 >/dev/null || fail "ranges without one node"

# --- Removing, and no store at all

"$bin/lumigrid" publish "$scene" $tower --quiet >/dev/null || fail "publish again"
for object in "packs/one and a half.lgk" patch.lgp again.lgp again.lgp; do
  "$probe" remove $place "$object" || fail "remove $object"
done
expect_list "" "not removed"
stop "${pids[proxy]}"
expect_error "no connection" "$probe" size $place patch.lgp
echo "PASS $name"
