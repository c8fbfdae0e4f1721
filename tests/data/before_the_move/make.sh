#!/bin/sh
# Makes the recordings of this folder again: `sh make.sh OUT HOOPD`, with HOOPD of the checkout 96d3d18.
# In lock-step the same seed gives the same bytes: `sha256sum` of OUT is that of figures.json.
set -eu
out=$(realpath "$1")
hoopd=$(realpath "$2")
cd "$(dirname "$0")"
work=$(mktemp -d)
camera="--camera direct"
trap 'rm -r "$work"' EXIT

run() { # NAME SECONDS SEED [options]
  name=$1 seconds=$2 seed=$3
  shift 3
  mkdir "$work/$name"
  "$hoopd" --sim --speed max $camera --set log.level=error --set telemetry.enabled=false \
    --set commands.enabled=false --duration "$seconds" --seed "$seed" --record "$work/$name" "$@" >/dev/null
  mv "$work/$name/run-0001.mcap" "$out/$name.mcap"
}

experiment() { # NAME KIND SECONDS SEED [options]
  name=$1 kind=$2 seconds=$3 seed=$4
  shift 4
  "$hoopd" experiment "$kind" --sim --speed max $camera --set log.level=error --set telemetry.enabled=false \
    --set commands.enabled=false --duration "$seconds" --seed "$seed" --out "$out/$name.mcap" "$@" >/dev/null
}

run 01-lqg 4 1 \
  --set 'sim.commands=[{at_s: 1.6, name: reference, value: 0.1}, {at_s: 2.8, name: reference, value: 0.02}]'
run 02-pid-thesis 3 2 --set control.file=controllers/pid.yaml --set sim.model=models/thesis.yaml --set sim.psi_rad=-0.1
run 03-lead-noisy-line 3.5 3 --set control.file=controllers/lead.yaml --set sim.psi_rad=0.1 \
  --set 'sim.faults=[{kind: bit_flips, at_s: 1.5, for_s: 1.5, params: {rate: 0.003}},
    {kind: garbage, at_s: 1.5, for_s: 1.5, params: {every: 9}}, {kind: ball_gone, at_s: 2.5, for_s: 0.08}]'
run 04-arx-commands 4 4 --set control.file=controllers/arx.yaml \
  --set 'sim.commands=[{at_s: 1.4, name: reference, value: 0.15}, {at_s: 2.0, name: tune, key: no_such_gain, value: 1.0},
    {at_s: 2.4, name: disarm}, {at_s: 2.6, name: arm}, {at_s: 3.2, name: stop}]'
run 05-hidden-effects 4 5 \
  --set 'sim.effects=[{name: hoop.coulomb_friction, parameters: {Fc: 0.008}}, {name: camera.latency, parameters: {d: 0.02}},
    {name: ball.slip, parameters: {mu: 0.05}}]' \
  --set 'sim.commands=[{at_s: 2, name: reference, value: 0.1}, {at_s: 2.2, name: tune, key: k_psi, value: 0.15}]'
run 06-effects-written-back 4 6 --set device.model=effects.yaml --set sim.model=effects.yaml \
  --set 'sim.commands=[{at_s: 2, name: reference, value: 0.1}]'
run 07-late-pictures 3.5 7 \
  --set 'sim.faults=[{kind: late_pictures, at_s: 1.5, for_s: 1.0, params: {delay_s: 0.05}},
    {kind: camera_stall, at_s: 3.0, for_s: 0.2}]'
run 08-line-lost 4 8 --set 'sim.faults=[{kind: board_silent, at_s: 1.5, for_s: 0.2}, {kind: board_reset, at_s: 3.6}]' \
  --set 'sim.commands=[{at_s: 3.1, name: arm}]'
camera=
run 09-pictures 2 9
camera="--camera direct"
experiment 10-prbs prbs 2 10
experiment 11-hoop-only multisine 2 11 --no-ball
run 12-own-law 3 12 --set control.law=law.py \
  --set 'sim.commands=[{at_s: 1.4, name: reference, value: 0.1}, {at_s: 2, name: tune, key: k_i, value: 0.05}]'
for form in csv h5 mat; do
  "$hoopd" convert "$out/06-effects-written-back.mcap" "$out/06-effects-written-back.$form" >/dev/null
done
