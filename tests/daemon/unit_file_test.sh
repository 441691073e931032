#!/bin/bash
# The unit file is valid and stays confined: `systemd-analyze verify` says nothing at all (it returns 0 on misspelt
# directives, so only silence counts), and the exposure stays under a bound. A misspelt copy must be found out.
# Usage: unit_file_test.sh UNIT DAEMON; a daemon that is not built yet is replaced by /bin/true.
set -euo pipefail

unit=$1
daemon=$2
[ -x "$daemon" ] || daemon=/bin/true
# Measured 1.9 (2026); the bound leaves room for one directive that a driver may need to give up. In tenths of a level.
readonly exposure_max=22

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
copy=$folder/wholebodyd.service
sed "s|^ExecStart=[^ ]*|ExecStart=$daemon|" "$unit" >"$copy"
grep -q "^ExecStart=$daemon --config " "$copy" || { echo "FAIL: no ExecStart to replace"; exit 1; }

said=$(systemd-analyze verify --man=no "$copy" 2>&1) || { echo "FAIL: verify: $said"; exit 1; }
[ -z "$said" ] || { echo "FAIL: verify said: $said"; exit 1; }

sed 's|^WatchdogSec=|WatchdogSecs=|' "$copy" >"$folder/misspelt.service"
said=$(systemd-analyze verify --man=no "$folder/misspelt.service" 2>&1) || true
[ -n "$said" ] || { echo "FAIL: verify did not see a misspelt directive"; exit 1; }

systemd-analyze security --offline=true --threshold=$exposure_max --no-pager "$copy" >"$folder/security" 2>&1 ||
  { cat "$folder/security"; echo "FAIL: exposure above $exposure_max tenths"; exit 1; }
tail -n 1 "$folder/security"
