#!/bin/sh
# The package's life in a root of its own: install, verify, enable, fly, upgrade with an edited configuration, remove, purge.
#   test-life.sh PACKAGE NEWER_PACKAGE
# Needs root. The root is built by mmdebstrap where that is installed, else it is this computer's own root under an overlay,
# so that nothing here is touched.
set -eu
old=$(realpath "$1") new=$(realpath "$2")
if [ "${FSS_OWN_MOUNTS:-}" != yes ]; then
    FSS_OWN_MOUNTS=yes exec unshare --mount "$0" "$old" "$new"
fi
work=$(mktemp -d)
root=$work/root
mkdir "$root"
mount -t tmpfs tmpfs "$work"
mkdir -p "$root"
if command -v mmdebstrap > /dev/null; then
    mmdebstrap --variant=minbase --include=systemd "${FSS_SUITE:-stable}" "$root"
else
    mkdir "$work/upper" "$work/work"
    mount -t overlay overlay -o "lowerdir=/,upperdir=$work/upper,workdir=$work/work" "$root"
fi
mount -t tmpfs tmpfs "$root/tmp"
mount -t tmpfs tmpfs "$root/run"
mkdir -p "$root/dev/shm"
mount -t tmpfs tmpfs "$root/dev"
mkdir "$root/dev/shm"
mount -t tmpfs tmpfs "$root/dev/shm"
for device in null:3 zero:5 urandom:9; do
    mknod -m 666 "$root/dev/${device%:*}" c 1 "${device#*:}"
done
mount -t proc proc "$root/proc"
cp "$old" "$root/tmp/old.deb"
cp "$new" "$root/tmp/new.deb"
in_root() { chroot "$root" /usr/bin/env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin LC_ALL=C DEBIAN_FRONTEND=noninteractive "$@"; }
say() { printf '== %s\n' "$*"; }
fail() { echo "FAILED: $*" >&2; exit 1; }
state() {
    in_root find /etc /usr /var/lib -xdev \( -path /var/lib/dpkg -o -path /usr/share/mime \) -prune -o -print |
        grep -v -E '^/etc/(passwd|group|shadow|gshadow|subuid|subgid)-?$|/man/index.db' | sort
    in_root getent passwd fss || true
}

state > "$work/before"
say install
in_root dpkg -i /tmp/old.deb
in_root getent passwd fss > /dev/null || fail "there is no user fss"
[ "$(in_root stat -c '%U %a' /etc/fss/link.key)" = "fss 600" ] || fail "the key is not its user's own"
in_root systemd-analyze verify --man=no /usr/lib/systemd/system/fss@.service > "$work/verify" 2>&1 || true
if [ -s "$work/verify" ]; then cat "$work/verify"; fail "systemd-analyze verify complains"; fi

say enable
in_root systemctl enable fss@hold.service
in_root test -L /etc/systemd/system/multi-user.target.wants/fss@hold.service || fail "not enabled"

say fly
in_root setpriv --reuid fss --regid fss --clear-groups sh -c \
    'cd /var/lib/fss && fss run /etc/fss/missions/hold.toml --fast --quiet --plant /etc/fss/plants/fss.toml > /dev/null'
in_root test -s /var/lib/fss/out/hold/run.mcap || fail "no log"
for program in fss fss-ground fss-bridge; do
    in_root "$program" --version > /dev/null || fail "$program does not run"
done
in_root test -x /usr/bin/fss-fmu || fail "no fss-fmu"
in_root fss plant export-fmu /etc/fss/plants/fss.toml --out /tmp/vehicle.fmu > /dev/null || fail "no plant as an FMU"
in_root test -s /usr/include/fss.h || fail "libfss has no header"
if in_root sh -c 'command -v python3' > /dev/null; then
    in_root python3 -c 'import fss.service; fss.service._load()' || fail "Python does not find libfss"
fi
in_root fss host check --launch /etc/fss/launch/vehicle.toml > /dev/null || true

say "upgrade with an edited configuration"
in_root sh -c 'echo "# edited" >> /etc/fss/launch/vehicle.toml'
key=$(in_root sha256sum /etc/fss/link.key)
in_root dpkg -i --force-confdef --force-confold /tmp/new.deb
in_root grep -q '# edited' /etc/fss/launch/vehicle.toml || fail "the edited launch file is lost"
[ "$(in_root sha256sum /etc/fss/link.key)" = "$key" ] || fail "the key is lost"
in_root test -L /etc/systemd/system/multi-user.target.wants/fss@hold.service || fail "no longer enabled"

say remove
in_root dpkg -r fss
in_root test ! -e /usr/bin/fss || fail "the program is still there"
in_root grep -q '# edited' /etc/fss/launch/vehicle.toml || fail "removal took the configuration"

say purge
in_root dpkg -P fss
state > "$work/after"
diff "$work/before" "$work/after" || fail "something was left behind"
say "the package has lived and gone"
