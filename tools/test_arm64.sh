#!/usr/bin/env bash
# The robot's tests on an emulated 64-bit Arm computer, as a Cortex-A57 (that of a Jetson Nano).
#   sudo tools/test_arm64.sh [pytest arguments]
# Needs debootstrap and qemu-user-static of Debian or Ubuntu, and 2 GB; made once, kept in ROOT.
# Property tests try few examples here: emulation takes ten to twenty times as long.
# The packages are unpacked, not configured: hours of emulated dpkg, and Python runs without it.
set -euo pipefail
ROOT=${ROOT:-/var/tmp/duckpilot-arm64}
PYTHON=${PYTHON:-.venv/bin/python}
cd "$(dirname "$0")/.."

say() { echo "test_arm64: $*" >&2; }
[ "$(id -u)" = 0 ] || { say "expected root, which chroot needs; try: sudo $0"; exit 2; }
for tool in debootstrap qemu-aarch64-static; do
  command -v "$tool" >/dev/null || { say "expected $tool; try: apt install debootstrap qemu-user-static"; exit 2; }
done
handlers=/proc/sys/fs/binfmt_misc
[ -e $handlers/register ] || mount -t binfmt_misc none $handlers
[ -e $handlers/qemu-aarch64 ] || cat /usr/lib/binfmt.d/qemu-aarch64*.conf >$handlers/register

if [ ! -e "$ROOT/.unpacked" ]; then
  say "downloading Debian for 64-bit Arm into $ROOT"
  mkdir -p "$ROOT"
  debootstrap --arch=arm64 --download-only --variant=minbase --include=python3,libgomp1,ca-certificates \
    bookworm "$ROOT" http://deb.debian.org/debian >/dev/null
  for package in "$ROOT"/var/cache/apt/archives/*.deb; do dpkg-deb -x "$package" "$ROOT"; done
  touch "$ROOT/.unpacked"
fi

if [ ! -e "$ROOT/opt/.installed" ] || [ constraints-nano.txt -nt "$ROOT/opt/.installed" ]; then
  say "installing the Nano's versions of the wheels"
  rm -rf "$ROOT/opt/packages"
  platforms=$(printf -- '--platform manylinux_2_%s_aarch64 ' 17 27 28)
  # shellcheck disable=SC2086  # Every package by name: pip resolves for the computer it runs on.
  "$PYTHON" -m pip install --quiet --no-deps --target "$ROOT/opt/packages" $platforms --platform manylinux2014_aarch64 \
    --python-version 3.11 --implementation cp --abi cp311 --abi abi3 --abi none --only-binary=:all: \
    --constraint constraints-nano.txt \
    numpy opencv-python-headless onnxruntime flatbuffers protobuf packaging pyyaml smbus2 pyzmq \
    mcap lz4 zstandard pytest pytest-timeout pluggy iniconfig pygments hypothesis sortedcontainers
  touch "$ROOT/opt/.installed"
fi
echo /opt/packages >"$ROOT/usr/lib/python3/dist-packages/packages.pth"  # for programs under test, too

rm -rf "$ROOT/work"
mkdir -p "$ROOT"/{work,proc,dev,tmp}
git ls-files -z robot localizer_node sim_pybullet tools tests docs pyproject.toml | tar -c --null -T - | tar -x -C "$ROOT/work"
export ROOT QEMU_CPU=${QEMU_CPU:-cortex-a57}
# In a mount table of its own, so that nothing is left mounted, however this ends.
exec unshare --mount --propagation private bash -c '
  mount -t proc proc "$ROOT/proc" && mount --rbind /dev "$ROOT/dev"
  exec chroot "$ROOT" env -i PATH=/usr/bin:/bin HOME=/tmp LANG=C.UTF-8 QEMU_CPU="$QEMU_CPU" \
    PYTHONDONTWRITEBYTECODE=1 HYPOTHESIS_PROFILE=quick PYTHONPATH=/work \
    sh -c "cd /work && exec python3 -m pytest -p no:cacheprovider -q \"\$@\"" pytest "$@"' test_arm64 \
  "${@:-tests/robot}"
