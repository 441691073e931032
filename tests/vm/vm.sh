# Sourced by tests/vm/run and tests/vm/rt: a throw-away QEMU guest on a Debian kernel that is unpacked and never installed.
# The guest's root is this machine's, read-only over 9p under an overlay in its memory; so the build tree's programs run in it
# as they are. Emulated (TCG) and counted in instructions (-icount), so that the guest's time does not depend on what else
# this machine does. KVM is not chosen because /dev/kvm exists: there are machines where it opens and boots nothing.

readonly vm=$root/build/vm
vm_devices=()  # what else the guest has, as arguments of QEMU
vm_shift=1     # an instruction takes 2^shift ns of guest time

# A test that cannot run is neither passed nor failed: it says so, and the exit code is 77.
vm_skip() {
  echo "SKIPPED: $1"
  exit 77
}

# Packages of the host; installed if this is root, else asked for.
vm_need_packages() {
  local missing=() p sudo=()
  for p in qemu-system-x86 busybox-static cpio kmod xz-utils can-utils iproute2; do
    [ "$(dpkg-query -W -f='${Status}' "$p" 2>/dev/null)" = "install ok installed" ] || missing+=("$p")
  done
  [ ${#missing[@]} -eq 0 ] && return 0
  [ "$(id -u)" -eq 0 ] || sudo=(sudo -n)
  "${sudo[@]}" true 2>/dev/null || vm_skip "needs the packages ${missing[*]}"
  { "${sudo[@]}" apt-get update -q &&
    "${sudo[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -q -y --no-install-recommends "${missing[@]}"; } \
    >"$vm/apt.log" 2>&1 || vm_skip "the packages ${missing[*]} cannot be installed ($vm/apt.log)"
}

# vm_kernel METAPACKAGE: fetches and unpacks the kernel that it names (linux-image-amd64), once. Sets release, kernel (an uncompressed vmlinux:
# booted by PVH it is there in half the time), modules, initrd.
vm_kernel() {
  local package folder offset
  mkdir -p "$vm"
  package=$(apt-cache depends "$1" 2>/dev/null | sed -n 's/^ *Depends: \(linux-image-[0-9].*\)/\1/p' | head -n 1)
  [ -n "$package" ] || vm_skip "no package $1 is known here (apt-get update?)"
  release=${package#linux-image-}
  folder=$vm/$package
  modules=$folder/lib/modules/$release
  kernel=$folder/vmlinux
  if [ ! -s "$kernel" ]; then
    ls "$vm/$package"_*.deb >/dev/null 2>&1 || (cd "$vm" && apt-get download -q "$package") >"$vm/apt.log" 2>&1 ||
      vm_skip "$package cannot be downloaded ($vm/apt.log)"
    rm -rf "$folder"
    dpkg-deb -x "$(ls "$vm/$package"_*.deb | tail -n 1)" "$folder"
    depmod -b "$folder" "$release"
    # The kernel inside the boot image is an xz stream; what follows it is not part of it, so xz's complaint about that is expected.
    offset=$(grep -abo $'\xfd7zXZ' "$folder/boot/vmlinuz-$release" | head -n 1 | cut -d: -f1)
    tail -c +$((offset + 1)) "$folder/boot/vmlinuz-$release" | xz -dcq --single-stream >"$kernel.part" 2>/dev/null || true
    [ "$(head -c 4 "$kernel.part")" = $'\x7fELF' ] || { echo "FAIL: $package holds no kernel that can be unpacked"; exit 1; }
    mv "$kernel.part" "$kernel"
  fi
  initrd=$vm/initrd-$release.gz
  [ "$initrd" -nt "${BASH_SOURCE[0]}" ] || vm_initrd
}

# busybox and the few modules that lead to the root.
vm_initrd() {
  local folder module file number=100
  folder=$(mktemp -d)
  mkdir -p "$folder"/{bin,proc,sys,dev,lower,upper,root,m}
  cp /bin/busybox "$folder/bin/"
  local -A taken=()
  take() {
    local file=$1 needed
    [ -z "${taken[$file]:-}" ] || return 0
    taken[$file]=1
    for needed in $(sed -n "s|^$file: *||p" "$modules/modules.dep"); do take "$needed"; done
    number=$((number + 1))
    cp "$modules/$file" "$folder/m/$number-$(basename "$file")"
  }
  for module in virtio_pci 9pnet_virtio 9p overlay; do
    file=$(grep -o "^[^:]*/$module\.ko[^:]*" "$modules/modules.dep") && take "$file"
  done
  cat >"$folder/init" <<'END'
#!/bin/busybox sh
b=/bin/busybox
$b mount -t devtmpfs d /dev; $b mount -t proc p /proc; $b mount -t sysfs s /sys
for m in /m/*; do $b insmod $m; done
p9=trans=virtio,version=9p2000.L,msize=512000
$b mount -t 9p -o ro,cache=loose,$p9 host /lower || { echo no root; $b poweroff -f; }
$b mount -t tmpfs -o size=60% t /upper; $b mkdir /upper/u /upper/w
$b mount -t overlay -o lowerdir=/lower,upperdir=/upper/u,workdir=/upper/w o /root
$b mkdir -p /root/out; $b mount -t 9p -o rw,cache=none,$p9 out /root/out
for m in proc sys dev; do $b mount --move /$m /root/$m; done
exec $b switch_root /root /bin/bash /out/init
END
  chmod +x "$folder/init"
  (cd "$folder" && find . | cpio -o -H newc --quiet | gzip -1 >"$initrd")
  rm -rf "$folder"
}

# vm_boot SECONDS COMMAND...: runs the command as root in the guest, in this folder; its exit code is this function's. The guest
# finds its kernel's name in KERNEL and can modprobe. Console, output and exit code are in $out afterwards.
vm_boot() {
  local limit_s=$1 code=0
  shift
  out=$vm/out-$(basename "$0")
  rm -rf "$out"
  mkdir -p "$out"
  cat >"$out/init" <<END
export PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root TERM=dumb KERNEL=$release
mkdir -p /lib/modules /dev/pts /dev/shm
mount -t tmpfs t /lib/modules; ln -s $modules /lib/modules/$release
mount -t devpts p /dev/pts; mount -t tmpfs t /dev/shm; mount -t tmpfs t /run
ip link set lo up
cd $(printf %q "$PWD")
$(printf '%q ' "$@") >/out/result 2>&1
echo \$? >/out/code
sync
/bin/busybox poweroff -f
END
  timeout --foreground "$limit_s" qemu-system-x86_64 -M pc -accel tcg,thread=single -cpu max -smp 1 -m 1024 \
    -icount "shift=$vm_shift,sleep=off,align=off" -nodefaults -no-user-config -no-reboot -display none -monitor none \
    -kernel "$kernel" -initrd "$initrd" -append "console=ttyS0 quiet panic=-1 nokaslr mitigations=off tsc=reliable" \
    -chardev "file,id=console,path=$out/console" -serial chardev:console \
    -fsdev local,id=host,path=/,security_model=none,readonly=on,multidevs=remap \
    -device virtio-9p-pci,fsdev=host,mount_tag=host \
    -fsdev "local,id=out,path=$out,security_model=none" -device virtio-9p-pci,fsdev=out,mount_tag=out \
    "${vm_devices[@]}" \
    </dev/null >"$out/qemu.log" 2>&1 || code=$?
  if [ ! -s "$out/code" ]; then
    echo "FAIL: the guest did not end by itself (QEMU's exit code $code)"
    tail -n 20 "$out/qemu.log" "$out/console" "$out/result" 2>/dev/null || true
    return 1
  fi
  cat "$out/result"
  return "$(cat "$out/code")"
}
