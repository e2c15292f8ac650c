#!/usr/bin/env bash
# Builds a scene on a Slurm cluster: asks what is missing, submits that, waits, and asks again until nothing is missing.
set -euo pipefail

usage() {
  cat <<'TEXT'
usage: tools/slurm/build.sh -o SCENE --shards N [options] MESH... [-- lumigrid build options]

  -o SCENE          scene directory, on a file system that all nodes see
  --shards N        divide the images into N shards: the tasks of the job array
  --sbatch OPTION   an option for sbatch, such as --sbatch=--partition=gpu; may be repeated
  --tries N         stop after N rounds in a row that brought nothing (default 3)
  --poll SECONDS    how often the queue is looked at (default 10)
  --lumigrid FILE   the program, as the nodes see it (default: lumigrid)
  -- ...            options of lumigrid build that decide the scene, the same at each call: --grid 32 --face 512

Status 0: the scene is complete; 1: it is not; 2: wrong usage. Stopped at any moment, it goes on with the same command.
TEXT
}
wrong() { echo "build.sh: $1" >&2; usage >&2; exit 2; }
say() { echo "build.sh: $*"; }

scene= shards= tries=3 poll=10 lumigrid=lumigrid
meshes=() sbatch_options=() build_options=()
while [ $# -gt 0 ]; do
  case $1 in
    -o) scene=${2-}; shift ;;
    --shards) shards=${2-}; shift ;;
    --sbatch) sbatch_options+=("${2-}"); shift ;;
    --sbatch=*) sbatch_options+=("${1#--sbatch=}") ;;
    --tries) tries=${2-}; shift ;;
    --poll) poll=${2-}; shift ;;
    --lumigrid) lumigrid=${2-}; shift ;;
    -h | --help) usage; exit 0 ;;
    --) shift; build_options=("$@"); break ;;
    -*) wrong "unknown option $1" ;;
    *) meshes+=("$1") ;;
  esac
  [ $# -gt 0 ] || wrong "the last option needs a value"
  shift
done
[ -n "$scene" ] || wrong "say -o SCENE"
[[ $shards =~ ^[1-9][0-9]*$ ]] || wrong "say --shards N"
[[ $tries =~ ^[1-9][0-9]*$ ]] || wrong "--tries must be a number"
[[ $poll =~ ^[0-9]+(\.[0-9]+)?$ ]] || wrong "--poll must be a number"
command -v "$lumigrid" >/dev/null || { echo "build.sh: $lumigrid: no such program; say --lumigrid FILE" >&2; exit 1; }
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
export LUMIGRID=$lumigrid LUMIGRID_SHARDS=$shards

# Asks what is missing, into $missing; the status is that of --missing.
ask() {
  local status=0
  missing=$("$lumigrid" build "${meshes[@]}" -o "$scene" "${build_options[@]}" --shards "$shards" --missing) ||
    status=$?
  return $status
}

# Submits a job, into $job.
submit() {
  job=$(sbatch --parsable --output="$scene.slurm-%j.log" "${sbatch_options[@]}" "$@") || return 1
  job=${job%%;*}
  say "job $job: $*"
}

# Waits until no task of the job is left in the queue. A controller that does not answer is asked again.
wait_for() {
  local left error
  error=$(mktemp)
  while true; do
    if left=$(squeue --noheader --jobs="$1" --format=%T 2>"$error"); then
      [ -n "$left" ] || break
    elif grep -q "Invalid job id" "$error"; then
      break # ended so long ago that Slurm has forgotten it
    fi
    sleep "$poll"
  done
  rm -f "$error"
}

job=
trap '[ -z "$job" ] || scancel "$job" 2>/dev/null || true; exit 1' INT TERM
before= idle=0
while true; do
  status=0
  ask || status=$?
  if [ $status -eq 0 ]; then break; fi
  [ $status -eq 3 ] || exit 1 # said why on standard error
  if [ "$missing" = "$before" ]; then idle=$((idle + 1)); else idle=0; fi
  if [ $idle -ge "$tries" ]; then
    say "$tries rounds brought nothing; the logs are $scene.slurm-*.log, and this is still missing:"
    echo "$missing"
    exit 1
  fi
  before=$missing
  if grep -q '^hierarchy: missing' <<<"$missing"; then
    submit "$here/lumigrid.sbatch" "${meshes[@]}" -o "$scene" "${build_options[@]}" --methods patch --quiet
  elif ! grep -q '^shards: ' <<<"$missing"; then # whoever was last was killed before he declared the scene finished
    submit "$here/lumigrid.sbatch" -o "$scene" --methods patch,images "${build_options[@]}" --quiet
  else
    list=$(sed -n 's/^shards: //p' <<<"$missing")
    submit --array="$list" "$here/lumigrid.sbatch" -o "$scene" --methods patch,images "${build_options[@]}" --quiet
  fi || { idle=$((idle + 1)); sleep "$poll"; [ $idle -lt "$tries" ] || exit 1; continue; }
  wait_for "$job"
  job=
done
say "$scene: nothing is missing"
