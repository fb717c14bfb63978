// SPDX-License-Identifier: Apache-2.0
// One printable part as it lies on the bed: openscad -D 'part="comb"' part.scad
include <derived.scad>
use <wheel.scad>
use <plate.scad>
use <drum.scad>
use <pair.scad>
use <pi_mount.scad>

part = "wheel_front";

if (part == "wheel_front") wheel_front();
else if (part == "wheel_comb") wheel_comb();
else if (part == "wheel_back") wheel_back();
else if (part == "servo_gear") servo_gear();
else if (part == "plate") plate();
else if (part == "sensor_carrier") sensor_carrier();
else if (part == "cradle") cradle();
else if (part == "module_cradle") module_cradle();
else if (part == "module_pair") module_pair();
else if (part == "ring_cap") ring_cap();
else if (part == "base") base();
else if (part == "ring") ring();
else if (part == "lid") lid();
else if (part == "pi_mount") pi_mount();
else if (part == "headset_base") headset_base();
else assert(false, str("no such part: ", part));
