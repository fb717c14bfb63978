// SPDX-License-Identifier: Apache-2.0
// Involute spur gear, in the plane.
include <derived.scad>

// Point of the involute of a circle, `t` degrees unrolled.
function involute(base, t) = base * [cos(t) + t * PI / 180 * sin(t), sin(t) - t * PI / 180 * cos(t)];
function unrolled_deg(base, radius) = sqrt(pow(radius / base, 2) - 1) * 180 / PI;
// Polar angle of the involute where it reaches a radius.
function involute_deg(base, radius) =
	let (t = unrolled_deg(base, radius)) t - atan(t * PI / 180);

module spur_gear(teeth) {
	pitch = gear_module * teeth / 2;
	base = pitch * cos(gear_pressure_deg);
	tip = pitch + gear_module;
	root = pitch - 1.25 * gear_module;
	half_deg = 90 / teeth + involute_deg(base, pitch); // half a tooth at the base circle
	first = root > base ? unrolled_deg(base, root) : 0;
	flank = [for (i = [0 : 6]) involute(base, first + (unrolled_deg(base, tip) - first) * i / 6)];
	half = [for (p = flank) [[cos(half_deg), -sin(half_deg)], [sin(half_deg), cos(half_deg)]] * [p.x, -p.y]];
	tooth = concat([[root * 0.97, half[0].y]], half);
	mirrored = [for (i = [len(tooth) - 1 : -1 : 0]) [tooth[i].x, -tooth[i].y]];

	circle(root, $fn = 2 * teeth);
	for (i = [0 : teeth - 1]) rotate(360 * i / teeth) polygon(concat(tooth, mirrored));
}
