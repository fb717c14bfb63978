// SPDX-License-Identifier: Apache-2.0
// Holds a Raspberry Pi 3, 4 or 5 on a tripod's leg or column, with two straps. Its back is the bed, the leg's groove in it;
// x along the leg, the Pi's sockets at +x; origin in the middle of its four holes. An ear at -x holds LED (+y) and button (-y).
include <derived.scad>

function pi_posts() = [for (x = [-1, 1], y = [-1, 1]) [x * pi_holes_long / 2, y * pi_holes_across / 2]];

// Middle of the ear, from the middle of the holes beside it: 10 mm are the button's nut and the edge of the board.
pi_ear_x = -pi_ear / 2 - 6;

module pi_mount() difference() {
	union() {
		linear_extrude(pi_plate) offset(3) square([pi_holes_long + 4, pi_holes_across + 4], center = true);
		linear_extrude(pi_plate) offset(3) translate([pi_ear_x - pi_holes_long / 2, 0])
			square([pi_ear + 4, pi_holes_across + 4], center = true);
		for (p = pi_posts()) translate(p) cylinder(h = pi_plate + pi_post, r = 3.4, $fn = 48);
	}
	for (p = pi_posts()) translate([p.x, p.y, wall_min]) cylinder(h = 40, d = wheel_screw_hole, $fn = 24);
	// A round leg lies on the two edges of this groove and does not roll.
	translate([-80, 0, 0]) rotate([90, 0, 90]) linear_extrude(160)
		polygon([[-pi_groove / 2, -0.01], [pi_groove / 2, -0.01], [pi_groove / 2 - 2, 2], [2 - pi_groove / 2, 2]]);
	for (hole = [[pi_ear_hole, led_hole], [-pi_ear_hole, button_hole]])
		translate([pi_ear_x - pi_holes_long / 2, hole[0], -1]) cylinder(h = 40, d = hole[1], $fn = 48);
	for (x = [-1, 1], y = [-1, 1]) translate([x * (strap_width / 2 + 3), y * pi_strap, -1]) linear_extrude(40)
		square([strap_width, strap_slot], center = true);
}
