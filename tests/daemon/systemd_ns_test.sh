#!/bin/bash
# The unit as it is, started for real: systemd as PID 1 of namespaces of its own (an overlay of /, no VM), wholebodyd with
# the simulated plant as its Type=notify service. A hung daemon is restarted by the watchdog and is idle then; the sandbox
# is in force. Prints what it saw. Usage: systemd_ns_test.sh SOURCE_DIR BUILD_DIR. Exit code 77: skipped, and why.
set -euo pipefail
readonly source=$1 build=$2 skipped=77 patience_s=240

skip() { echo "SKIPPED: $1"; exit $skipped; }
fail() { echo "FAIL: $1"; sed 's/^/  | /' "$out/console" "$out/seen" 2>/dev/null | tail -n 60; exit 1; }

[ "$(id -u)" -eq 0 ] || skip "needs root"
[ -x /lib/systemd/systemd ] || skip "needs systemd"
unshare -m -p -f -n -i -u -C true 2>/dev/null || skip "namespaces are not allowed here"
cgroups=$(findmnt -nro TARGET -t cgroup2 | head -n 1)
[ -n "$cgroups" ] && [ -w "$cgroups" ] || skip "needs a writable cgroup2 hierarchy"
if nm -D "$build/daemon/wholebodyd" 2>/dev/null | grep -q '__asan_init\|__tsan_init'; then
  skip "a sanitizer needs what the sandbox forbids"
fi

out=$(mktemp -d)
readonly cgroup=$cgroups/wholebody_test.$$
mkdir "$cgroup" 2>/dev/null || skip "no cgroup can be made"
pid=
finish() {
  [ -z "$pid" ] || kill -KILL "$pid" 2>/dev/null || true
  wait "$pid" 2>/dev/null || true
  for _ in $(seq 50); do
    find "$cgroup" -depth -type d -exec rmdir {} \; 2>/dev/null || true
    [ -d "$cgroup" ] || break
    sleep 0.1
  done
  rm -rf "$out"
}
trap finish EXIT

# What `cmake --install` with the prefix /usr puts where (docs/how-to/real-time.md).
stage=$out/stage
mkdir -p "$stage"/{usr/bin,usr/lib/wholebody,etc/systemd/system} "$out/top"
cp "$build/daemon/wholebodyd" "$build/daemon/wbctl/wbctl" "$stage/usr/bin/"
cp "$build/drivers/libwb_driver_sim.so" "$stage/usr/lib/wholebody/"
cp -r "$source/config" "$stage/etc/wholebody"
cp "$source/systemd/wholebodyd.service" "$stage/etc/systemd/system/"
cat >"$stage/etc/systemd/system/check.target" <<'END'
[Unit]
DefaultDependencies=no
Wants=check.service wholebodyd.service
AllowIsolate=yes
END
# No sysinit.target in here, and its output where the test finds it.
mkdir "$stage/etc/systemd/system/wholebodyd.service.d"
printf '[Unit]\nDefaultDependencies=no\n[Service]\nStandardError=append:/run/wholebodyd.log\n' \
  >"$stage/etc/systemd/system/wholebodyd.service.d/here.conf"
printf '[Unit]\nDefaultDependencies=no\n[Service]\nType=oneshot\nExecStart=/bin/bash /out/check\n' \
  >"$stage/etc/systemd/system/check.service"

cat >"$out/check" <<'END'
exec >/out/seen 2>&1
unit=wholebodyd.service
property() { systemctl show -P "$1" $unit; }
wait_active() {  # and another process than $1
  for _ in $(seq 600); do
    main=$(property MainPID)
    [ "$main" != 0 ] && [ "$main" != "$1" ] && [ "$(systemctl is-active $unit)" = active ] && return 0
    sleep 0.05
  done
  echo "not active: $(property ActiveState) $(property Result)"; cat /run/wholebodyd.log; return 1
}
mode() { CYCLONEDDS_URI=file:///etc/wholebody/cyclonedds_loopback.xml wbctl status --json | grep -o '"mode": "[a-z]*"'; }
wait_active 0 || exit 1
first=$main
echo "init: $(cat /proc/1/comm)"
grep -E '^(NoNewPrivs|Seccomp|CapEff|CapBnd):' /proc/$first/status | tr -s '\t ' ' '
echo "uid: $(awk '/^Uid:/ {print ($2 != 0 && $3 != 0) ? "not root" : "root"}' /proc/$first/status)"
for file in /usr/forbidden /etc/forbidden /sys/forbidden; do
  nsenter -t $first -m touch $file 2>&1 | sed 's/^touch: //'
done
nsenter -t $first -m sh -c 'ls -A /home /root 2>&1 | tr "\n" " "; echo'
echo "before: $(mode)"
before=$(date +%s.%N)
kill -STOP "$first"
wait_active "$first" || exit 1
echo "restarted after $(awk "BEGIN {printf \"%.2f\", $(date +%s.%N) - $before}") s, restarts: $(property NRestarts)"
echo "after: $(mode)"
systemctl stop $unit
echo "stopped: $(property Result) $(property ExecMainStatus)"
grep -oE 'Watchdog timeout.*' /out/console | head -n 1
echo end
END

cat >"$out/inside" <<END
set -e
mount --make-rprivate /
mount -t tmpfs t $out/top
mkdir $out/top/{up,work,root}
mount -t overlay -o lowerdir=/,upperdir=$out/top/up,workdir=$out/top/work o $out/top/root
cd $out/top/root
mount -t proc p proc
mount -t sysfs -o ro s sys
mount -t cgroup2 c sys/fs/cgroup
mount -t tmpfs -o mode=755 d dev
mkdir dev/shm dev/pts
mount -t devpts -o newinstance,ptmxmode=0666,mode=620 p dev/pts
ln -s pts/ptmx dev/ptmx
ln -s /proc/self/fd dev/fd
for n in null zero full random urandom tty; do touch dev/\$n; mount --bind /dev/\$n dev/\$n; done
touch dev/console
mount --bind \$(tty) dev/console
mount -t tmpfs t run
mount -t tmpfs t tmp
mkdir -p out
# Before the copy: its source must not vanish beneath the overlay's own /tmp.
mount --bind $out out
rm -rf etc/systemd/system
mkdir -p etc/systemd/system
cp -a out/stage/. .
printf 'uninitialized\n' >etc/machine-id
ip link set lo up
ip link set lo multicast on
mkdir -p mnt/old
pivot_root . mnt/old
cd /
umount -l /mnt/old
exec env -i container=other PATH=/usr/sbin:/usr/bin:/sbin:/bin \
  /lib/systemd/systemd --system --unit=check.target --log-target=console --log-level=info --show-status=0
END

# systemd wants a terminal as its console; `script` makes one and keeps what was said there.
script -qefc "echo \$\$ >'$cgroup/cgroup.procs'; exec unshare -m -p -f -n -i -u -C --kill-child=KILL bash '$out/inside'" \
  "$out/console" </dev/null >/dev/null 2>&1 &
pid=$!
for ((i = 0; i < 10 * patience_s; ++i)); do
  tail -n 1 "$out/seen" 2>/dev/null | grep -qx end && break
  kill -0 "$pid" 2>/dev/null || fail "systemd did not stay"
  sleep 0.1
done
tail -n 1 "$out/seen" 2>/dev/null | grep -qx end || fail "not done after $patience_s s"

sees() { grep -qE -- "$1" "$out/seen" || fail "not seen: $1"; }
sees '^init: systemd$'
sees '^NoNewPrivs: 1$'
sees '^Seccomp: 2$'
sees '^CapEff: 0000000000804000$'  # CAP_SYS_NICE, CAP_IPC_LOCK
sees '^CapBnd: 0000000000804000$'
sees '^uid: not root$'
sees "'/usr/forbidden'.*Read-only file system"
sees "'/etc/forbidden'.*Read-only file system"
sees "'/sys/forbidden'.*(Read-only file system|Permission denied)"
sees '^before: "mode": "idle"$'
sees '^restarted after .* restarts: 1$'
sees '^after: "mode": "idle"$'
sees '^stopped: success 0$'
sees 'Watchdog timeout'
cat "$out/seen"
