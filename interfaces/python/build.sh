#!/usr/bin/env bash
# Makes the wheel of the module fss and of the programs fss, fss-ground and fss-bridge.
#   interfaces/python/build.sh OUT [--dev] [--no-extras] [--programs DIR]
# --dev           builds without long optimising, as the tests do
# --no-extras     leaves out fss-ground and fss-bridge
# --programs DIR  takes the programs and libfss.so from a folder where they are built already
# Needs Rust, a C compiler, and maturin (pip install maturin).
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
top=$here/../..
[ $# -ge 1 ] || { sed -n 2,7p "$0" | cut -c3- >&2; exit 2; }
out=$(mkdir -p "$1" && cd "$1" && pwd); shift
profile=release programs="" extras="fss-ground fss-bridge"
while [ $# -gt 0 ]; do
    case $1 in
        --dev) profile=dev ;;
        --no-extras) extras="" ;;
        --programs) programs=$(cd "$2" && pwd); shift ;;
        *) echo "unknown option $1" >&2; exit 2 ;;
    esac
    shift
done

cd "$top"
target=${CARGO_TARGET_DIR:-target}/$([ $profile = dev ] && echo debug || echo "$profile")
if [ -z "$programs" ]; then
    # shellcheck disable=SC2086
    cargo build --profile $profile -p fss -p fss-c --features fss/parquet $(printf -- '-p %s ' $extras)
    programs=$target
fi
rm -rf "$here/data" "$here"/fss/*.so
mkdir -p "$here/data/scripts"
for program in fss $extras; do
    install -m 755 "$programs/$program" "$here/data/scripts/$program"
done
# Services in Python call the same library as those in C.
install -m 644 "$programs/libfss.so" "$here/fss/libfss.so"
strip --strip-debug "$here"/data/scripts/* "$here"/fss/libfss.so 2> /dev/null || true
cd "$here"
features=$([ $profile = dev ] && echo "--features as-tested" || true)
module=$([ $profile = release ] && echo module || echo $profile)
# shellcheck disable=SC2086
maturin build --profile "$module" $features --strip --out "$out"
ls -l "$out"/fss-*.whl
