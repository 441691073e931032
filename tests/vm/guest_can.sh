#!/bin/bash
# In the guest: the CAN interfaces that the tests expect, then the program in $1 with its arguments. It, the plugin and the
# commands that the tests call lie in memory: a guest that waits for its 9p root is idle, and an idle guest's clock leaps.
set -e
for module in can can-raw vcan vxcan sch_netem kvaser_pci; do modprobe "$module" || echo "no module $module"; done
ip link add vxa type vxcan peer name vxb
ip link add vxc type vxcan peer name vxd
ip link add vxe type vxcan peer name vxf
ip link add vcan0 type vcan
cards=$(cd /sys/class/net && ls -d can[0-9] 2>/dev/null || true)  # where the guest has Kvaser cards
for interface in $cards; do ip link set $interface type can bitrate 1000000 restart-ms 100; done
for interface in vxa vxb vxc vxd vxe vxf vcan0 $cards; do ip link set $interface txqueuelen 256 up; done
memory=/run/memory
mkdir -p $memory/{proc,sys,dev}
for file in /bin/sh /sbin/ip /sbin/tc "$PWD/build/release/drivers/libwb_driver_can.so" "$PWD/$1"; do
  cp -L --parents "$file" $(ldd "$file" | grep -o '/[^ ]*') $memory
done
for folder in proc sys dev; do mount --rbind /$folder $memory/$folder; done
program=$PWD/$1
shift
exec chroot $memory "$program" "$@"
