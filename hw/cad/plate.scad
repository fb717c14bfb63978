// SPDX-License-Identifier: Apache-2.0
// The plate that carries everything; the two sensors' carriers, the camera's cradle, the top sensor's cap.
// The plate is drawn in the wheel frame; the others stand on their beds.
include <derived.scad>

function forks() = [[sensor_a_deg, seat_radius(beam_a)], [sensor_b_deg, seat_radius(beam_b)]]; // angle, seat
function carrier_screw() = [7, 8]; // from the seat outwards, and to both sides
carrier_play = 1.5;      // to both sides, mm
function cap_screw() = 6;          // to both sides
function cap_z() = 50;
function cradle_screw() = [18, -41];

module hole(d) circle(d / 2, $fn = 24);
module both_sides() for (s = [-1, 1]) scale([s, 1]) children();

module plate() linear_extrude(plate_thickness) difference() {
	plate_outline();
	circle(plate_hole_radius);
	translate([-camera_plug_width / 2, -46]) square([camera_plug_width, 46]);
	for (a = roller_angles) at(roller_distance, a) hole(m3_clear);
	hull() for (d = [0, roller_play]) at(roller_distance + d, 90) hole(m3_clear);
	at(gauge_radius, gauge_deg) hole(gauge_hole);
	for (f = forks()) rotate(f[0]) translate([f[1], 0]) carrier_cuts();
	translate([0, -axes_distance]) servo_cutout();
	if (servo_travel_deg == 180) both_sides() plate_window();
	both_sides() {
		translate([cap_screw(), cap_z()]) hole(m3_clear);
		translate(cradle_screw()) hole(m3_clear);
		translate([tab_x, tab_screw]) hole(m3_clear);
	}
}

module plate_outline() difference() {
	union() {
		circle(roller_distance + roller_radius);
		for (f = forks()) rotate(f[0]) translate([f[1] - 8, 0]) offset(2) square([23, 26], center = true);
		hull() for (x = [-9, 9], z = [40, cap_z()]) translate([x, z]) circle(5);
		hull() for (x = [-1, 1], p = [[34, -18], [39, -48], [39, plate_crotch + 10]]) translate([x * p[0], p[1]]) circle(4);
		translate([-plate_half_width, plate_bottom]) square([2 * plate_half_width, plate_tab + 19]);
	}
	// Below: two tabs, and the circuit board between them.
	translate([-tab_x + 4, plate_bottom - 1]) square([2 * tab_x - 8, plate_crotch - plate_bottom + 1]);
}

// Above a small servo there is room: lighter.
module plate_window() translate([16.5, -60]) offset(3) square([15, 12], center = true);

// In the plate, for one carrier: the sensor's lower ear, and slots for its screws.
module carrier_cuts() {
	ear_window();
	both_ways() hull() for (p = [-carrier_play, carrier_play])
		translate([carrier_screw().x, carrier_screw().y + p]) hole(m3_clear);
}
module both_ways() for (s = [-1, 1]) scale([1, s]) children();
module ear_window() translate([-fork_ear / 2 - 0.3, 0]) square([fork_ear + 1, fork_width + 2 * carrier_play + 1], center = true);

module servo_cutout() translate([servo[4], 0]) {
	square([servo[0] + 0.4, servo[1] + 0.4], center = true);
	for (x = [-1, 1], y = servo[3] > 0 ? [-1, 1] : [0])
		translate([x * servo[2] / 2, y * servo[3] / 2]) hole(servo[3] > 0 ? 4.3 : 2.0);
}

// One sensor's carrier; two are needed. Foot on the bed (and on the plate's front), the wheel's axis far to the left.
// The sensor's seat is the plane x = 0; its lower ear goes through the foot and the plate.
beam_height = plate_z - comb_middle_z;
carrier_height = beam_height + fork_length / 2;
module sensor_carrier() {
	foot = 3;
	cheek = fork_width / 2 + gap;
	linear_extrude(foot) difference() {
		union() {
			translate([-fork_ear - 2.5, -cheek - 3]) square([fork_ear + 10, 2 * cheek + 6]);
			hull() both_ways() translate([carrier_screw().x, carrier_screw().y]) circle(4);
		}
		translate([-fork_ear / 2 - 0.3, 0]) square([fork_ear + 1, fork_width + 2 * gap], center = true);
		translate([-10, -cheek]) square([10, 2 * cheek]); // the fork itself reaches lower than the foot's top
		both_ways() translate([carrier_screw().x, carrier_screw().y]) hole(m3_clear);
	}
	difference() {
		union() {
			translate([0, -cheek - 2, 0]) cube([3.2, 2 * cheek + 4, carrier_height]);
			both_ways() translate([-fork_ear, cheek, 0]) cube([fork_ear + 0.1, 2, carrier_height]);
			both_ways() translate([3, cheek, foot]) rotate([-90, 0, 0]) linear_extrude(2)
				polygon([[0, 0.1], [0, foot - carrier_height + 4], [8, 0.1]]);
		}
		translate([-1, 0, beam_height + fork_hole_distance / 2]) rotate([0, 90, 0]) cylinder(h = 6, d = m3_clear, $fn = 24);
		translate([-1, -2.6, beam_height - 4]) cube([6, 5.2, 8]); // legs and wires
	}
}

// Holds the ball camera from below and behind; screwed to the plate's back. Its back wall is the bed.
// Here x right, y up, z away from the plate (backwards); origin on the camera's axis, z = 0 the plate's back.
cradle_ball = camera_diameter / 2 + 0.4;
cradle_dish = 12;        // of the dish's rim above its bottom
module cradle() {
	centre_z = -plate_back_z; // the camera's middle; negative: inside the plate's hole
	shelf = 3;
	bottom = -cradle_ball - shelf;
	difference() {
		union() {
			// Wall.
			linear_extrude(3) difference() {
				translate([-cradle_screw().x - 6, cradle_screw().y - 6]) square([2 * cradle_screw().x + 12, bottom + 12 - cradle_screw().y + 6]);
				both_sides() translate(cradle_screw()) hole(m3_clear);
			}
			// Block for the dish.
			translate([-14, bottom, 0]) cube([28, cradle_dish + shelf, 17]);
		}
		translate([0, 0, centre_z]) sphere(cradle_ball, $fn = 120);
		// The plug, and the way out to the front for its cable.
		translate([-camera_plug_width / 2, cradle_screw().y - 20, centre_z - camera_plug_depth / 2]) cube([camera_plug_width, 60, camera_plug_depth]);
		translate([-camera_plug_width / 2, cradle_screw().y - 20, -1]) cube([camera_plug_width, 20 + bottom - cradle_screw().y, 10]);
		// A rubber cord over the ball, along the seam between the lenses.
		both_sides() translate([11, bottom - 1, max(3.5, centre_z - 1.5)]) cube([6, 3.2, 3]);
	}
}

// Holds a board camera instead; on the same screws. Its front (towards the plate) is the bed; axes as the cradle's.
module module_cradle() {
	half = module_board / 2 + 4;
	low = cradle_screw().y - 6;
	difference() {
		union() {
			linear_extrude(module_sheet) hull() {
				square(2 * half, center = true);
				both_sides() translate([cradle_screw().x + 2, low + 4]) circle(4);
			}
			for (x = [-1, 1], y = [-1, 1]) translate([x, y] * module_holes / 2)
				cylinder(h = module_front_z - plate_back_z, r = 3, $fn = 32);
			both_sides() translate([half - 2, low + 1, 0]) cube([2, half - low - 1, module_rib]);
		}
		translate([0, 0, -1]) cylinder(h = 20, r = module_lens_radius + 1);
		for (x = [-1, 1], y = [-1, 1]) translate([x * module_holes / 2, y * module_holes / 2, -1]) cylinder(h = 30, d = module_hole, $fn = 16);
		both_sides() translate([cradle_screw().x, cradle_screw().y, -1]) cylinder(h = 20, d = m3_clear, $fn = 24);
		both_sides() translate([cradle_screw().x, cradle_screw().y, module_sheet]) cylinder(h = 20, d = 6.5, $fn = 24);
	}
}

// The ninth sensor looks up from the highest point. Its back (towards the plate) is the bed.
module ring_cap() {
	height = ldr_top_z - cap_z();
	difference() {
		union() {
			linear_extrude(3) hull() {
				translate([-10, 0]) square([20, height]);
				both_sides() translate([cap_screw(), 0]) circle(4);
			}
			translate([0, height / 2 + 1, 5]) cube([ldr_diameter + 6, height - 2, 10], center = true);
		}
		translate([0, height, 5]) rotate([90, 0, 0]) ldr_seat();
		translate([-ldr_diameter / 2, 1.2, -1]) cube([ldr_diameter, height - 1.2 - ldr_depth - 1.6, 9.5]); // wires
		both_sides() translate([cap_screw(), 0, -1]) cylinder(h = 20, d = m3_clear, $fn = 24);
		both_sides() translate([cap_screw(), 0, 3]) cylinder(h = 20, d = 6.5, $fn = 24);
	}
}

// To be taken away for a light sensor: its face is the plane z = 0, its two wires leave at z > 0.
module ldr_seat() {
	translate([0, 0, -1]) cylinder(h = ldr_depth + 1, d = ldr_diameter, $fn = 48);
	for (s = [-1, 1]) translate([s * ldr_leads / 2, 0, 0]) cylinder(h = 8, d = ldr_lead_hole, $fn = 16);
}
