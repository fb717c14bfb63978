// SPDX-License-Identifier: Apache-2.0
// The drum below the wheel: base with the circuit board, ring of eight sensors, lid; and the headset's base.
// All stand on the bed as in the box, in box coordinates x right, y forward.
include <derived.scad>
use <plate.scad>

ring_bottom = ring_z - ring_height / 2;
ring_top = ring_z + ring_height / 2;

module walls(height) linear_extrude(height) difference() {
	outline();
	outline(drum_wall);
}

module screw_columns(height, diameter, radius = 4) for (a = lid_screw_angles) rotate(a) translate([lid_screw_radius, 0]) difference() {
	linear_extrude(height) hull() {
		circle(radius);
		translate([3.5, 0]) square([0.01, 9], center = true);
	}
	translate([0, 0, -1]) cylinder(h = height + 2, d = diameter, $fn = 24);
}

// Floor down.
module base() {
	height = ring_bottom - drum_bottom;
	difference() {
		union() {
			linear_extrude(drum_floor) outline();
			walls(height);
			screw_columns(height, m3_thread);
			cylinder(h = drum_floor + tripod_nut_height, r = 11);
			board_posts();
			plate_pillars();
		}
		translate([0, 0, -1]) cylinder(h = 30, d = tripod_hole, $fn = 48);
		translate([0, 0, drum_floor]) cylinder(h = 30, d = tripod_nut_flats / cos(30), $fn = 6);
		// The screwdriver for the plate's screws, from the back: in front the servo's gear may be in its way.
		for (x = [-1, 1]) translate([x * tab_x, -10, tab_screw - drum_bottom]) rotate([90, 0, 0]) cylinder(h = 60, d = 6.5, $fn = 32);
		// Cables leave at the back.
		translate([-cable_width / 2, -ring_radius - 1, height - cable_height]) cube([cable_width, 10, cable_height + 1]);
	}
}

module board_posts() for (x = [-1, 1], y = [-1, 1])
	translate([x * (board_width / 2 - 3.5), board_y + y * (board_depth / 2 - 3.5), 0]) difference() {
		cylinder(h = drum_floor + board_post, r = 3.4);
		translate([0, 0, drum_floor]) cylinder(h = 20, d = m3_thread, $fn = 24);
	}

// The plate's feet are screwed to their back faces.
module plate_pillars() for (x = [-1, 1]) {
	depth = 9;
	top = plate_crotch - drum_bottom;
	translate([x * tab_x, -plate_z, 0]) difference() {
		translate([-5, 0, 0]) cube([10, depth, top]);
		translate([0, -1, tab_screw - drum_bottom]) rotate([-90, 0, 0]) cylinder(h = depth + 2, d = m3_thread, $fn = 24);
	}
}

// The ring of the eight equatorial sensors. Sensor k faces (cos 45k, -sin 45k) here.
module ring() difference() {
	union() {
		walls(ring_height);
		screw_columns(ring_height, m3_clear);
		for (k = [0 : 7]) rotate(-45 * k) translate([ring_flat - 3.4, -6, 0]) cube([3, 12, ring_height]);
	}
	for (k = [0 : 7]) rotate(-45 * k) translate([ring_flat, 0, ring_height / 2]) {
		rotate([0, -90, 0]) rotate(90) ldr_seat();
		translate([-0.6, 7, 0]) rotate([90, 0, 90]) linear_extrude(2) label(str(k));
	}
}

module label(t) text(t, size = 6, halign = "center", valign = "center", font = "Liberation Sans:style=Bold");

// A cone, so that the camera sees past it. Upside down on the bed.
lid_height = lid_top - ring_top;
module lid() rotate([180, 0, 0]) translate([0, 0, -lid_height]) {
	height = lid_height;
	difference() {
		union() {
			difference() {
				cone(0, height);
				translate([0, 0, -0.01]) cone(drum_wall, height - drum_wall);
			}
			intersection() {
				screw_columns(height, m3_clear, 5);
				cone(0, height);
			}
		}
		// Screws and their heads, through columns and wall.
		for (a = lid_screw_angles) rotate(a) translate([lid_screw_radius, 0, 0]) {
			translate([0, 0, -1]) cylinder(h = 40, d = m3_clear, $fn = 24);
			translate([0, 0, lid_screw_seat]) cylinder(h = 40, d = 6.5, $fn = 24);
		}
		translate([0, 0, -1]) linear_extrude(height + 2) lid_opening();
	}
}
module cone(shrink, height) hull() {
	linear_extrude(0.01) outline(shrink);
	translate([0, 0, height - 0.01]) cylinder(h = 0.01, r = lid_top_radius - shrink);
}

// Plate, wheel and gear stick out; camera cradle and cable pass.
module lid_opening() {
	front = -servo_gear_z + 3;
	back = -plate_back_z - 1;
	translate([-plate_half_width - 1, back]) square([2 * plate_half_width + 2, plate_thickness + 2]);
	translate([-servo_gear_radius - 3, back]) square([2 * servo_gear_radius + 6, front - back]);
	translate([-26, back - 20]) square([52, 21]);
}

// For a headset or helmet, in place of base, ring and lid: plate with wheel, board, straps through the slots, pads below.
headset_plates_screws_z = tab_screw - drum_bottom;
module headset_base() difference() {
	union() {
		linear_extrude(headset_thickness) headset_outline();
		board_posts();
		plate_pillars();
		for (x = [-1, 1]) translate([x * tab_x + 2, -plate_z + 8.9, 0]) rotate([0, -90, 0]) linear_extrude(4)
			polygon([[0, 0], [headset_thickness, 0], [headset_rib, 0], [headset_thickness, 16], [0, 16]]);
	}
	for (x = [-1, 1]) translate([x * tab_x, 0, headset_plates_screws_z]) rotate([90, 0, 0]) cylinder(h = 60, d = 6.5, $fn = 32);
}

module headset_outline() difference() {
	translate([0, headset_y]) offset(10) square([headset_length - 20, headset_width - 20], center = true);
	for (x = [-1, 1], y = [-1, 1]) translate([x * (headset_length / 2 - 6), headset_y + y * (headset_width / 2 - 21)])
		square([strap_slot, strap_width], center = true);
	// Lighter, and a way for the cables.
	for (y = [-1, 1]) translate([0, headset_y + y * (headset_width / 4 - 2)])
		offset(4) square([2 * headset_window - 8, headset_width / 2 - 20], center = true);
}
