#!/bin/bash
# In the guest: the CAN interfaces that the tests expect, then the command.
set -e
for module in can can-raw vcan vxcan sch_netem kvaser_pci; do modprobe "$module" || echo "no module $module"; done
for pair in "vxa vxb" "vxc vxd" "vxe vxf"; do
  set -- $pair "$@"
  ip link add "$1" type vxcan peer name "$2"
  ip link set "$1" txqueuelen 256 up
  ip link set "$2" txqueuelen 256 up
  shift 2
done
exec "$@"
