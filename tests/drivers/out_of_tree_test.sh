#!/bin/bash
# A vendor's way, with nothing of this tree but what is installed: install the component `driver`, configure and build the
# example of the how-to against it, and check the plugin. A copy that says another ABI must be found out.
# Usage: out_of_tree_test.sh BUILD EXAMPLE
set -euo pipefail

build=$1
example=$2
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
fail() { echo "FAIL: $1"; exit 1; }

cmake --install "$build" --component driver --prefix "$folder/usr" >"$folder/log" 2>&1 || { cat "$folder/log"; fail "install"; }
[ -f "$folder/usr/include/wholebody/driver.h" ] || fail "driver.h is not installed"
[ ! -e "$folder/usr/bin/wholebodyd" ] || fail "the component brings the daemon"

cp -r "$example" "$folder/example"
cd "$folder/example"
{ cmake -S . -B build -DCMAKE_PREFIX_PATH="$folder/usr" && cmake --build build; } >"$folder/log" 2>&1 ||
  { cat "$folder/log"; fail "the example does not build"; }
plugin=build/libwb_driver_motor.so
[ "$(nm -D --defined-only "$plugin" | awk '{print $3}')" = wb_driver_entry ] || fail "more than the entry symbol leaves the plugin"

check=$folder/usr/bin/wb-driver-check
"$check" "$plugin" --config motor.yaml || fail "the example does not conform"
"$check" "$plugin" --config motor.yaml --json | grep -q '"conforms": true' || fail "--json"

sed -i 's/\.abi = WB_DRIVER_ABI/.abi = 2/' motor.c
cmake --build build >"$folder/log" 2>&1
code=0
said=$("$check" "$plugin" --config motor.yaml) || code=$?
[ "$code" = 1 ] || fail "exit code $code for another ABI, expected 1"
grep -q "the plugin has ABI 2, this suite checks ABI 1" <<<"$said" || fail "the numbers are not named: $said"
code=0
"$check" no_such_plugin.so --config motor.yaml 2>/dev/null || code=$?
[ "$code" = 2 ] || fail "exit code $code for a plugin that is not there, expected 2"
