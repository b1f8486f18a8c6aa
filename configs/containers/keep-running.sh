#!/bin/sh
# The first process of a container of the gateway: `keep-running.sh ta2 run ...`.
#
# When the first process of a container ends, the kernel ends all others with it, also under `docker run --init`, which ends when
# its only child does. A guard that shall hold the robot for the next daemon needs a first process that stays: this one. It starts
# the daemon again when that died, and ends with its status when it ended well (0), was configured wrongly (2) or was asked to end.
ending=
trap 'ending=1; kill -TERM "$daemon" 2>/dev/null' TERM INT HUP
while :; do
    "$@" &
    daemon=$!
    [ -z "$ending" ] || kill -TERM "$daemon" 2>/dev/null # asked before it was there
    wait "$daemon"
    status=$?
    while kill -0 "$daemon" 2>/dev/null; do # a signal ended the wait, not the daemon
        wait "$daemon"
        status=$?
    done
    if [ -n "$ending" ] || [ "$status" -eq 0 ] || [ "$status" -eq 2 ]; then
        exit "$status"
    fi
    echo "the gateway ended with status $status: it is started again" >&2
    sleep 0.2
done
