#!/bin/sh
# Makes this computer the robot's: sh install.sh CHECKOUT PYTHON MODEL. Each step may be done again.
# The robot's environment is made of PYTHON; a configuration that is there stays as it is.
set -eu
umask 022
checkout=$1 python=$2 model=$3
root=${4:-} # where the files lie, for a test
files=$(dirname "$0")
opt=$root/opt/duckpilot etc=$root/etc/duckpilot state=$root/var/lib/duckpilot
pip="$opt/venv/bin/python -I -m pip install --upgrade"
put() { # whole or not at all: what a full disk cut off would stay
    cp "$1" "$2.new"
    mv "$2.new" "$2"
}
set -x

for group in i2c video gpio; do
    getent group $group || groupadd --system $group
done
id duckpilot || useradd --system --user-group --home-dir /var/lib/duckpilot --shell /usr/sbin/nologin duckpilot
usermod --append --groups i2c,video,gpio duckpilot

install -d "$opt"
install -d -o duckpilot -g duckpilot "$etc" "$state" # calibration replaces files in it
install -d -m 700 -o duckpilot -g duckpilot "$etc/keys"
"$python" -m venv "$opt/venv"
$pip pip # Ubuntu 18.04's is too old to know the wheels of onnxruntime
$pip --constraint "$checkout/constraints-nano.txt" "$checkout"

# Another one than the shipped was asked for; else what a person put there stays.
test "$model" = "$checkout/robot/models/lane_sight.onnx" -a -e "$opt/lane.onnx" || put "$model" "$opt/lane.onnx"
put "$files/../models/sight.onnx" "$opt/sight.onnx"
test -e "$etc/robot.yaml" || put "$files/robot.yaml" "$etc/robot.yaml"
cp "$files/99-duckpilot-i2c.rules" "$root/etc/udev/rules.d/"
udevadm control --reload
udevadm trigger --subsystem-match=i2c-dev
cp "$files/duckpilot-robot.service" "$root/etc/systemd/system/"
systemctl daemon-reload
systemctl enable duckpilot-robot.service
