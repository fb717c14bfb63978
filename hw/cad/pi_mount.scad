// SPDX-License-Identifier: Apache-2.0
// Holds a Raspberry Pi 3, 4 or 5 on a tripod's leg or column, with two straps. Its back is the bed, the leg's groove in it;
// x along the leg, the Pi's sockets at +x; origin in the middle of its four holes.
include <derived.scad>

function pi_posts() = [for (x = [-1, 1], y = [-1, 1]) [x * pi_holes_long / 2, y * pi_holes_across / 2]];

module pi_mount() difference() {
	union() {
		linear_extrude(pi_plate) offset(3) square([pi_holes_long + 4, pi_holes_across + 4], center = true);
		for (p = pi_posts()) translate(p) cylinder(h = pi_plate + pi_post, r = 3.4, $fn = 48);
	}
	for (p = pi_posts()) translate([p.x, p.y, wall_min]) cylinder(h = 40, d = wheel_screw_hole, $fn = 24);
	// A round leg lies on the two edges of this groove and does not roll.
	translate([-50, 0, 0]) rotate([90, 0, 90]) linear_extrude(100)
		polygon([[-pi_groove / 2, -0.01], [pi_groove / 2, -0.01], [pi_groove / 2 - 2, 2], [2 - pi_groove / 2, 2]]);
	for (x = [-1, 1], y = [-1, 1]) translate([x * (strap_width / 2 + 3), y * pi_strap, -1]) linear_extrude(40)
		square([strap_width, strap_slot], center = true);
}
