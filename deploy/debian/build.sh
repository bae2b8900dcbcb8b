#!/bin/sh
# Builds the Debian package with nothing but dpkg-deb: build.sh [PROGRAM [FOLDER [VERSION]]]
#   PROGRAM   the fss to package, with the programs and libraries named below beside it; target/release/fss, which
#             cargo build --release --workspace --features fss/parquet makes
#   FOLDER    where the package goes; target/debian
#   VERSION   that of Cargo.toml
# DEB_LEVEL in the environment is how hard it compresses, 0 to 9; as dpkg-deb does by itself.
set -eu
here=$(cd "$(dirname "$0")/../.." && pwd)
program=${1:-$here/target/release/fss}
folder=${2:-$here/target/debian}
version=${3:-$(sed -n 's/^version = "\(.*\)"/\1/p' "$here/Cargo.toml" | head -n 1)}
beside=$(dirname "$program")
for each in "$program" "$beside/fss-ground" "$beside/fss-bridge" "$beside/fss-fmu" "$beside/libfss.so" "$beside/libfss_plant_fmu.so"; do
    [ -x "$each" ] || {
        echo "build.sh: $each is missing; cargo build --release --workspace --features fss/parquet makes it" >&2
        exit 1
    }
done

mkdir -p "$folder"
root=$(mktemp -d "$folder/stage.XXXXXX")
trap 'rm -rf "$root"' EXIT
umask 022
chmod 755 "$root"

put() { install -D -m "$1" "$2" "$root/$3"; }
put 755 "$program" usr/bin/fss
put 755 "$beside/fss-ground" usr/bin/fss-ground
put 755 "$beside/fss-bridge" usr/bin/fss-bridge
put 755 "$beside/fss-fmu" usr/bin/fss-fmu
put 644 "$beside/libfss.so" usr/lib/libfss.so
put 644 "$beside/libfss_plant_fmu.so" usr/lib/libfss_plant_fmu.so
put 644 "$here/interfaces/c/include/fss.h" usr/include/fss.h
for module in "$here"/interfaces/python/fss/*.py; do
    put 644 "$module" "usr/lib/python3/dist-packages/fss/$(basename "$module")"
done
strip --strip-unneeded "$root"/usr/bin/* "$root"/usr/lib/*.so 2>/dev/null || true
put 644 "$here/deploy/systemd/fss@.service" usr/lib/systemd/system/fss@.service
put 644 "$here/deploy/systemd/fss.sysusers" usr/lib/sysusers.d/fss.conf
put 644 "$here/deploy/systemd/fss.tmpfiles" usr/lib/tmpfiles.d/fss.conf
for kind in launch plants missions faults; do
    for file in "$here/deploy/etc/$kind"/*.toml; do
        put 644 "$file" "etc/fss/$kind/$(basename "$file")"
    done
done
for file in "$here/deploy/etc/layouts"/*; do
    put 644 "$file" "etc/fss/layouts/$(basename "$file")"
done
put 644 "$here/README.md" usr/share/doc/fss/README.md
put 644 "$here/deploy/debian/copyright" usr/share/doc/fss/copyright
put 644 "$here/CHANGELOG.md" usr/share/doc/fss/changelog
gzip -9n "$root/usr/share/doc/fss/changelog"

# Man pages and completions come from the program itself.
made=$(mktemp -d "$folder/made.XXXXXX")
trap 'rm -rf "$root" "$made"' EXIT
"$program" generate "$made"
for page in "$made"/*.1; do
    put 644 "$page" "usr/share/man/man1/$(basename "$page")"
done
gzip -9n "$root"/usr/share/man/man1/*.1
put 644 "$made/fss.bash" usr/share/bash-completion/completions/fss
put 644 "$made/_fss" usr/share/zsh/vendor-completions/_fss
put 644 "$made/fss.fish" usr/share/fish/vendor_completions.d/fss.fish

glibc=$(objdump -T "$root"/usr/bin/* "$root/usr/lib/libfss.so" | sed -n 's/.*GLIBC_\([0-9.]*\).*/\1/p' | sort -uV | tail -n 1)
mkdir "$root/DEBIAN"
(cd "$root" && find etc -type f -printf '/%p\n' | sort) > "$root/DEBIAN/conffiles"
sed -e "s/@VERSION@/$version/" -e "s/@ARCH@/$(dpkg --print-architecture)/" -e "s/@GLIBC@/$glibc/" \
    -e "s/@SIZE@/$(du -sk --exclude=DEBIAN "$root" | cut -f1)/" "$here/deploy/debian/control" > "$root/DEBIAN/control"
for script in postinst prerm postrm; do
    install -m 755 "$here/deploy/debian/$script" "$root/DEBIAN/$script"
done
# shellcheck disable=SC2086
dpkg-deb --root-owner-group ${DEB_LEVEL:+-z$DEB_LEVEL} --build "$root" "$folder/fss_${version}_$(dpkg --print-architecture).deb" >&2
echo "$folder/fss_${version}_$(dpkg --print-architecture).deb"
