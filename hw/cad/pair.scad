// SPDX-License-Identifier: Apache-2.0
// Holds two board cameras back to back, on a tripod of their own. The front board's face is the bed;
// x right, y up, z along the lens's axis; origin on the axis.
include <derived.scad>

pair_depth = 2 * module_rib; // the boards' parts reach into the frame from both sides
pair_half = module_board / 2 + 2;
pair_foot = [28, tripod_nut_height + 10]; // width, height
module pair_hole(d) circle(d / 2, $fn = 24);

module module_pair() difference() {
	linear_extrude(pair_depth) difference() {
		union() {
			offset(3) square(2 * pair_half - 6, center = true);
			translate([-pair_foot.x / 2, -pair_half - pair_foot.y]) square([pair_foot.x, pair_foot.y + 5]);
		}
		square(module_board - 8, center = true);
		for (x = [-1, 1], y = [-1, 1]) translate([x, y] * module_holes / 2) pair_hole(module_hole);
	}
	// Both cables go out above.
	translate([-8, 0, 4]) cube([16, pair_half + 1, pair_depth]);
	// The tripod's screw from below, its nut from behind.
	translate([0, -pair_half - pair_foot.y - 1, pair_depth / 2]) rotate([-90, 0, 0]) cylinder(h = pair_foot.y - 2, d = tripod_hole, $fn = 48);
	translate([-tripod_nut_flats / 2 - 0.1, -pair_half - pair_foot.y + 5, pair_depth / 2 - tripod_nut_flats / sqrt(3) - 0.2])
		cube([tripod_nut_flats + 0.2, tripod_nut_height + 0.4, pair_depth]);
}
