#!/bin/sh
# check_live_test.sh LIVE_TEST: which exit code live_test gives. Tests stop it as a host stops a machine.
live_test=$1
failures=0
expect() { # expect CODE COMMAND: in a shell
  output=$("$live_test" sh -c "$2")
  code=$?
  # On a machine that stands still, live_test may excuse any failure.
  [ "$code" = 77 ] && [ "$1" != 0 ] && echo "$output" | grep -q "stood still" && code=$1
  [ "$code" = "$1" ] && return
  echo "exit code $code instead of $1: $2"
  failures=1
}
stop='kill -STOP $PPID; sleep 0.2; kill -CONT $PPID;'
expect 0 "exit 0"
expect 0 "$stop exit 0"
expect 3 "sleep 0.1; exit 3"
expect 139 "sleep 0.1; kill -SEGV \$\$"
# A failure beside a stop gives three runs. The processes that a test leaves behind end.
runs=$("$live_test" sh -c "sleep 1000 & echo run \$!; $stop exit 1")
[ $? = 77 ] && [ "$(echo "$runs" | grep -c '^run')" = 3 ] || { echo "no three runs: $runs"; failures=1; }
for process in $(echo "$runs" | sed -n 's/^run //p'); do
  kill -0 "$process" 2> /dev/null && { echo "process $process lives"; failures=1; }
done
# So does a stop of one core. A program of the same priority takes the core as the host would.
hold='import time; end = time.monotonic() + 0.3
while time.monotonic() < end: pass'
core=$(sed -n 's/^Cpus_allowed_list:.*[^0-9]//p' /proc/self/status) # the last one
if chrt -f 99 taskset -c "$core" true 2> /dev/null; then
  runs=$(HOLD="$hold" "$live_test" sh -c "echo run; chrt -f 99 taskset -c $core python3 -c \"\$HOLD\"; exit 1")
  [ $? = 77 ] && [ "$(echo "$runs" | grep -c '^run')" = 3 ] || { echo "no three runs: $runs"; failures=1; }
else
  echo "left out: a stop of one core, because real-time priority is not permitted"
fi
# Stops that do not end are hopeless after three seconds.
hopeless=$(timeout 60 "$live_test" sh -c "while true; do $stop sleep 0.1; done")
[ $? = 77 ] && echo "$hopeless" | grep -q "stood still" || { echo "not ended: $hopeless"; failures=1; }
exit $failures
