#!/usr/bin/env bash
# A Slurm cluster of two nodes on this machine builds a scene in 4 shards. One task is killed and one node dies, and
# the scene still equals, value by value, the one that a single process builds. It takes about a minute and needs
# root, the programs in build/release or $LUMIGRID_BUILD, and Debian's slurm-wlm and munge, which it installs.
# Everything is on 127.0.0.1, in a directory of its own, and is stopped by process id.
set -euo pipefail
name=slurm
root=$(cd "$(dirname "$0")/../.." && pwd)
lumigrid=${LUMIGRID_BUILD:-$root/build/release}/bin/lumigrid
fail() { echo "FAIL $name: $*"; exit 1; }
[ -x "$lumigrid" ] || fail "$lumigrid is not built"
[ "$(id -u)" = 0 ] || fail "needs root, to run slurmd and munged"
if ! command -v slurmctld munged >/dev/null; then
  apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -qq -y --no-install-recommends slurm-wlm \
    munge >/dev/null
fi

work=$(mktemp -d "${TMPDIR:-/tmp}/lumigrid-slurm.XXXXXX")
pids=() driver=
stop() { # a process by its id, and wait until it is gone
  kill "$1" 2>/dev/null || return 0
  for _ in $(seq 100); do kill -0 "$1" 2>/dev/null || return 0; sleep 0.1; done
  kill -9 "$1" 2>/dev/null || true
}
clean_up() {
  local status=$?
  [ -z "$driver" ] || stop "$driver"
  command -v scancel >/dev/null && SLURM_CONF=$work/slurm.conf timeout 10 scancel --user=root 2>/dev/null || true
  for ((i = ${#pids[@]} - 1; i >= 0; --i)); do stop "${pids[i]}"; done
  for pid in $(steps_of node1 node2); do kill -9 "$pid" 2>/dev/null || true; done
  if [ $status -eq 0 ] || [ -z "${KEEP:-}" ]; then rm -rf --one-file-system "$work"; else echo "kept $work"; fi
}
# Lists the processes of the nodes' tasks, which their environment identifies.
steps_of() {
  for node in "$@"; do
    for process in /proc/[0-9]*; do
      if tr '\0' '\n' <"$process/environ" 2>/dev/null | grep -qx "SLURM_CONF=$work/slurm.conf" &&
        tr '\0' '\n' <"$process/environ" 2>/dev/null | grep -qx "SLURMD_NODENAME=$node"; then
        echo "${process#/proc/}"
      fi
    done
  done 2>/dev/null
}
trap clean_up EXIT
chmod 755 "$work"
pid_in() { for _ in $(seq 100); do [ -s "$1" ] && { cat "$1"; return; }; sleep 0.1; done; fail "no $1"; }
until_true() { # SECONDS COMMAND...
  local end=$(($(date +%s) + $1))
  shift
  until "$@"; do [ "$(date +%s)" -lt "$end" ] || return 1; sleep 0.05; done
}

# --- The cluster
mkdir -p "$work"/munge "$work"/state "$work"/spool-node1 "$work"/spool-node2
head -c 128 /dev/urandom >"$work/munge/key"
chown -R munge: "$work/munge"
chmod 700 "$work/munge"; chmod 400 "$work/munge/key"; chmod 711 "$work/munge"
setpriv --reuid=munge --regid=munge --clear-groups munged --key-file="$work/munge/key" --socket="$work/munge/socket" \
  --pid-file="$work/munge/pid" --log-file="$work/munge/log" --seed-file="$work/munge/seed"
pids+=("$(pid_in "$work/munge/pid")")
port=${SLURM_TEST_PORT:-26817}
host=$(hostname -s)
cat >"$work/slurm.conf" <<CONF
ClusterName=lumigrid-test
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=$port
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket=$work/munge/socket
CredType=cred/munge
StateSaveLocation=$work/state
SlurmdSpoolDir=$work/spool-%n
SlurmctldPidFile=$work/slurmctld.pid
SlurmdPidFile=$work/slurmd-%n.pid
SlurmctldLogFile=$work/slurmctld.log
SlurmdLogFile=$work/slurmd-%n.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
MpiDefault=none
ReturnToService=2
SlurmdTimeout=10
KillWait=2
SchedulerType=sched/backfill
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
NodeName=node1 NodeHostname=$host NodeAddr=127.0.0.1 Port=$((port + 1)) CPUs=2 State=UNKNOWN
NodeName=node2 NodeHostname=$host NodeAddr=127.0.0.1 Port=$((port + 2)) CPUs=2 State=UNKNOWN
PartitionName=all Nodes=node1,node2 Default=YES MaxTime=INFINITE State=UP
CONF
export SLURM_CONF=$work/slurm.conf
slurmctld -f "$work/slurm.conf"
pids+=("$(pid_in "$work/slurmctld.pid")")
declare -A slurmd
for node in node1 node2; do
  slurmd -N $node -f "$work/slurm.conf" || fail "slurmd of $node: $(tail -3 "$work/slurmd-$node.log")"
  slurmd[$node]=$(pid_in "$work/slurmd-$node.pid")
  pids+=("${slurmd[$node]}")
done
both_idle() { [ "$(sinfo --noheader --Node --format=%t 2>/dev/null | grep -c '^idle$')" = 2 ]; }
until_true 60 both_idle || fail "the cluster did not come up: $(sinfo 2>&1; tail -3 "$work"/slurmctld.log)"

# --- A single process builds the scene
options=(--grid 13 --face 128 --supersampling 2 --batch 50)
"$lumigrid" sample --triangles 20000 -o "$work/mesh.ply" 2>/dev/null
"$lumigrid" build "$work/mesh.ply" -o "$work/whole" "${options[@]}" --quiet >/dev/null || fail "the undivided build"

# --- Tasks choose their shard by Slurm's variables
small=(--grid 5 --face 64 --quiet)
"$lumigrid" build "$work/mesh.ply" -o "$work/small" "${small[@]}" >/dev/null || fail "the small undivided build"
srun --quiet --ntasks=3 "$lumigrid" build "$work/mesh.ply" -o "$work/ranks" "${small[@]}" --shard auto \
  >"$work/ranks.log" 2>&1 ||
  fail "srun --shard auto: $(cat "$work/ranks.log")"
sbatch --quiet --wait --array=4-10:2 --output="$work/array-%a.log" \
  --wrap="'$lumigrid' build '$work/mesh.ply' -o '$work/array' ${small[*]} --shard auto" || fail \
    "--array with --shard auto: $(cat "$work"/array-*.log)"
digest() { "$lumigrid" info --digest "$1" | sed -n 's/^ *SHA-256 of all values //p'; }
[ -d "$work/ranks/images/shard-0002-of-0003" ] && [ -d "$work/array/images/shard-0003-of-0004" ] || fail \
  "--shard auto chose other shards"
for scene in ranks array; do
  [ -n "$(digest "$work/small")" ] && [ "$(digest "$work/$scene")" = "$(digest "$work/small")" ] || fail \
    "--shard auto: $scene differs"
done
echo "srun and a job array with --shard auto: the same as undivided"

# --- The driver, with one task killed and one node lost
scene=$work/scene
"$root/tools/slurm/build.sh" -o "$scene" --shards 4 --poll 1 --lumigrid "$lumigrid" "$work/mesh.ply" -- \
  "${options[@]}" \
  >"$work/driver.log" 2>&1 &
driver=$!
store() { echo "$scene/images/shard-000$1-of-0004"; }
node_of() { squeue --noheader --array --states=RUNNING --format='%K %N' | sed -n "s/^$1 //p"; }
# Shards are halted on the way, so that none ends before it is killed.
pid_of() { cat "$(store "$1")/writer.lock" 2>/dev/null; }
halted=()
halt_on_the_way() { # all shards that run and have committed something
  for shard in 0 1 2 3; do
    [[ " ${halted[*]-} " != *" $shard "* ]] || continue
    [ "$(stat -c %s "$(store $shard)/data.mdb" 2>/dev/null || echo 0)" -gt 100000 ] || continue
    kill -STOP "$(pid_of $shard)" 2>/dev/null && halted+=($shard)
  done
  [ ${#halted[@]} -ge 3 ]
}
until_true 120 halt_on_the_way || fail "three shards were not seen running: $(cat "$work/driver.log")"

# One task is killed.
killed=${halted[0]}
[ -n "$(node_of "$killed")" ] || fail "shard $killed is not in the queue: $(squeue)"
echo "killing the task of shard $killed on $(node_of "$killed")"
kill -9 "$(pid_of "$killed")"

# The node of another shard dies: its daemon and all processes that ran on it.
victim=${halted[1]}
node=$(node_of "$victim")
[ -n "$node" ] || fail "shard $victim is not in the queue: $(squeue)"
echo "$node dies, with shard $victim on it"
kill -9 "${slurmd[$node]}"
for pid in $(steps_of "$node"); do kill -9 "$pid" 2>/dev/null || true; done
asked=0
"$lumigrid" build --missing -o "$scene" >"$work/missing.txt" || asked=$?
[ $asked = 3 ] || fail "nothing was missing after the node had died: this test proved nothing"
sed -n 's/^shards: /missing now: shards /p' "$work/missing.txt"
for shard in "${halted[@]}"; do kill -CONT "$(pid_of "$shard")" 2>/dev/null || true; done

status=0
wait "$driver" || status=$?
driver=
sed 's/^/  /' "$work/driver.log"
[ $status -eq 0 ] || fail "the driver ended with status $status"
rounds=$(grep -c -- '--array=' "$work/driver.log")
[ "$rounds" -ge 2 ] || fail "one round was enough: this test proved nothing"
[ "$(sinfo --noheader --Node --nodes="$node" --format=%T | tr -d '*')" = down ] || fail "$node should be down: $(sinfo)"

# --- Both scenes are equal, value by value
"$lumigrid" build --missing -o "$scene" >/dev/null || fail "something is missing"
"$lumigrid" verify "$scene" || fail "verify"
[ -n "$(digest "$scene")" ] || fail "no digest"
[ "$(digest "$scene")" = "$(digest "$work/whole")" ] || fail "the result differs from the undivided build"
cmp -s "$scene/patch.lgp" "$work/whole/patch.lgp" || fail "the hierarchies differ"
echo "PASS $name: 4 shards, a killed task and a dead node: complete after $rounds arrays, $(digest "$scene")"
