#!/bin/sh
# Kills runs at random moments with a signal that nobody can catch, goes on from their checkpoints, and compares the
# mesh with that of a run that nobody disturbed: the bytes must be the same.
#
#   tests/kill.sh [PROGRAM [ROUNDS [SEED]]]
#
# PROGRAM is target/release/bijective-sdf unless given; 60 rounds take some minutes. In each round the run is killed
# again and again, after 0.05 s up to as long as a whole run takes, until it ends by itself; every third round the
# signal is SIGTERM, to which the program answers with a checkpoint of its own. Exits with 1 at the first difference.
set -eu
program=${1:-target/release/bijective-sdf}
rounds=${2:-60}
seed=${3:-1}
case $program in /*) ;; *) program=$PWD/$program ;; esac
dir=$(mktemp -d)
child=
trap 'test -z "$child" || kill -9 "$child" 2>/dev/null || :; rm -rf "$dir"' EXIT
trap 'exit 130' INT TERM
cd "$dir"

# 80 points spread over a torus. The options make a run of all three phases that takes seconds.
awk 'BEGIN { for (i = 0; i < 80; i++) { u = i * 2.399963; v = 6.283185 * i / 80
    printf "%.6f %.6f %.6f\n", (2 + cos(u)) * cos(v), (2 + cos(u)) * sin(v), sin(u) } }' > cloud.xyz
options='--seed 5 --threads 2 --quiet --resolution 32 --set field.width=16 --set field.depth=2 --set bsp.channels=8
    --set bsp.heads=2 --set bsp_pretrain=40 --set stages=12:60,16:60'

now() { date +%s%N; }
began=$(now)
# shellcheck disable=SC2086
"$program" reconstruct cloud.xyz -o whole.ply $options
whole=$(( ($(now) - began) / 1000000 ))
echo "a run takes $whole ms"

# A random number below $1.
random() { seed=$(( (seed * 1103515245 + 12345) % 2147483648 )); drawn=$(( seed / 65536 * $1 / 32768 )); }

kills=0
resumed=0
round=1
while [ "$round" -le "$rounds" ]; do
    rm -f mesh.ply mesh.ply.* state
    signal=KILL
    [ $((round % 3)) -ne 0 ] || signal=TERM
    while :; do
        resume=
        if [ -e state ]; then
            resume='--resume state'
            resumed=$((resumed + 1))
        fi
        # shellcheck disable=SC2086
        "$program" reconstruct cloud.xyz -o mesh.ply $options --checkpoint state --checkpoint-every 0 $resume \
            2> log & child=$!
        random "$((whole + whole / 4))"
        sleep "$(printf '%d.%03d' $(((drawn + 50) / 1000)) $(((drawn + 50) % 1000)))"
        if kill -s "$signal" "$child" 2> /dev/null; then kills=$((kills + 1)); fi
        code=0
        { wait "$child" || code=$?; } 2> /dev/null
        child=
        case $code in
            0) break ;;
            # Ended by the signal, or by itself after it.
            137 | 143 | 130) ;;
            *) echo "round $round: exit code $code"; cat log; exit 1 ;;
        esac
        # What stands there is whole, whenever the run was killed.
        if [ -e state ] && ! "$program" info state > log 2>&1; then
            echo "round $round: the checkpoint is damaged"; cat log; exit 1
        fi
    done
    if ! cmp -s mesh.ply whole.ply; then
        echo "round $round: another mesh than without kills"; exit 1
    fi
    round=$((round + 1))
done
# Nothing may be left of runs that were killed once others have ended by themselves.
left=$(ls -A | grep -v -x -e cloud.xyz -e whole.ply -e mesh.ply -e state -e log -e 'state\.lock' || :)
if [ -n "$left" ]; then echo "left behind: $left"; exit 1; fi
echo "$rounds rounds, $kills kills, $resumed resumed: the same bytes each time"
