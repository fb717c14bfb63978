// SPDX-License-Identifier: Apache-2.0
// The box put together from the rendered parts (build/hw/stl) and plain shapes for what is bought.
//   view = "box" | "open" (drum opened) | "headset" | "module" (a board camera in it) | "wheel" (taken apart) | "item" (the one named `item`, for the collision test)
include <derived.scad>
use <plate.scad>

stl = "../../build/hw/stl/"; // hw.mk says where
view = "box";
item = "";
ball = ["cradle", "camera", "camera_plug"];
board_camera = ["module_cradle", "module"];
hidden = concat(["screws"], view == "module" ? ball : board_camera,
	view == "open" || view == "module" ? ["ring", "lid", "ldrs", "headset_base"] :
	view == "headset" ? ["base", "ring", "lid", "ldrs", "ring_cap"] : ["headset_base"]);
wheel_items = ["wheel_front", "film", "wheel_comb", "wheel_back"];
apart = view == "wheel" ? 8 : 0;

black = [0.38, 0.38, 0.42];
orange = [0.95, 0.5, 0.1];
green = [0.2, 0.55, 0.35];
metal = [0.8, 0.8, 0.85];

// Where the wheel has a gap at the bottom, the servo's gear has a tooth on top.
mesh_deg = 360 / servo_gear_teeth * (0.5 - (0.75 * wheel_gear_teeth) % 1);

module part(name) import(str(stl, name, ".stl"), convexity = 8);
function is_in(name, names) = len([for (n = names) if (n == name) n]) > 0;

module place(name, colour) {
	shown = view == "item" ? name == item : view == "wheel" ? is_in(name, wheel_items) : !is_in(name, hidden);
	if (shown) color(colour) children();
}

// --- the wheel, in its frame
place("wheel_front", orange) in_box() translate([0, 0, wheel_front_z - 3 * apart]) part("wheel_front");
place("wheel_comb", [0.55, 0.57, 0.6]) in_box() translate([0, 0, comb_z - 0.5 * apart]) part("wheel_comb");
place("wheel_back", orange) in_box() translate([0, 0, rim_z + rim_thickness + apart]) rotate([180, 0, 0]) part("wheel_back");

// --- on the plate
place("plate", black) in_box() translate([0, 0, plate_z]) part("plate");
for (i = [0 : 2]) place(str("roller_", i), metal) in_box() at(roller_distance, concat(roller_angles, [90])[i]) roller();
for (i = [0 : 1]) {
	place(str("fork_", i), [0.1, 0.1, 0.1]) in_box() rotate(forks()[i][0]) translate([forks()[i][1], 0, comb_middle_z]) fork();
	place(str("sensor_carrier_", i), green) in_box() rotate(forks()[i][0]) translate([forks()[i][1], 0, plate_z]) rotate([180, 0, 0]) part("sensor_carrier");
}
place("servo", [0.12, 0.12, 0.3]) in_box() translate([servo[4], -axes_distance, plate_back_z]) servo_motor();
place("servo_gear", orange) in_box() translate([0, -axes_distance, servo_gear_z]) rotate(90 + mesh_deg) part("servo_gear");
place("cradle", green) in_box() translate([0, 0, plate_back_z]) part("cradle");
place("module_cradle", green) in_box() translate([0, 0, plate_back_z]) part("module_cradle");
place("module", [0.1, 0.35, 0.2]) in_box() translate([0, 0, module_front_z]) board_camera();
if (view == "module") color([0.2, 0.55, 0.9]) intersection() { lenses(); translate([-50, 0, -50]) cube(100); }
place("ring_cap", green) in_box() translate([0, cap_z(), plate_back_z]) part("ring_cap");
place("screws", metal) screws();
place("camera", [0.25, 0.25, 0.27]) camera();
if (view == "box" || view == "open" || view == "headset") color([0.2, 0.55, 0.9]) lenses();
place("camera_plug", [0.5, 0.5, 0.5]) translate([-5.5, -3.5, -45]) cube([11, 7, 26.5]);

// --- the drum
place("base", black) translate([0, 0, drum_bottom]) part("base");
place("headset_base", black) translate([0, 0, drum_bottom]) part("headset_base");
place("board", [0.1, 0.35, 0.2]) translate([-board_width / 2, board_y - board_depth / 2, drum_bottom + drum_floor + board_post]) board();
place("ring", [0.3, 0.31, 0.36]) translate([0, 0, ring_z - ring_height / 2]) part("ring");
place("lid", black) translate([0, 0, lid_top]) rotate([180, 0, 0]) part("lid");
place("ldrs", [0.9, 0.85, 0.6]) {
	for (k = [0 : 7]) rotate(-45 * k) translate([ring_flat - ldr_depth, 0, ring_z]) rotate([0, 90, 0]) cylinder(h = ldr_depth, d = 5);
	translate([0, -plate_back_z - 5, ldr_top_z - ldr_depth]) cylinder(h = ldr_depth, d = 5);
}

// What one looks through comes last: OpenSCAD draws what is behind it only if it came before.
place("film", [0.35, 0.4, 0.5, 0.25]) in_box() translate([0, 0, film_z - 1.5 * apart]) cylinder(h = film_thickness, r = film_diameter / 2);

module roller() {
	bearing();
	translate([0, 0, plate_back_z - roller_screw]) cylinder(h = roller_screw - plate_thickness, d = roller_bore);
	translate([0, 0, plate_z - plate_margin - roller_width - roller_nut]) cylinder(h = roller_nut, r = 3.2, $fn = 6);
}

// Shafts of 3 mm where they pass, heads where they are sunk, and the way of the screwdriver to the plate's feet.
module screws() {
	in_box() {
		for (f = forks()) rotate(f[0]) translate([f[1], 0, 0]) {
			for (s = [-1, 1]) translate([carrier_screw().x, s * carrier_screw().y, plate_z - 4]) cylinder(h = 10, d = 3);
			translate([-fork_ear - 1, 0, comb_middle_z - fork_hole_distance / 2]) rotate([0, 90, 0]) cylinder(h = 10, d = 3);
		}
		for (s = [-1, 1]) {
			translate([s * cap_screw(), cap_z(), plate_z - 2]) cylinder(h = 10, d = 3);
			translate([s * cap_screw(), cap_z(), plate_back_z + 3]) cylinder(h = 3, d = 5.7);
			translate([s * cradle_screw().x, cradle_screw().y, plate_z - 2]) cylinder(h = 10, d = 3);
			translate([s * tab_x, tab_screw, plate_z]) cylinder(h = plate_thickness + 0.1, d = 3);
			translate([s * tab_x, tab_screw, plate_back_z]) cylinder(h = 70, d = 5.7);
		}
	}
	for (a = lid_screw_angles) rotate(a) translate([lid_screw_radius, 0, 0]) {
		translate([0, 0, ring_z - ring_height / 2]) cylinder(h = ring_height + lid_screw_seat, d = 3);
		translate([0, 0, ring_z + ring_height / 2 + lid_screw_seat]) cylinder(h = 60, d = 5.7);
	}
}

module bearing() translate([0, 0, plate_z - plate_margin - roller_width]) rotate_extrude() difference() {
	square([roller_radius, roller_width]); // its screw fills the bore
	polygon([[roller_radius - roller_groove, roller_width / 2], [roller_radius + 1, -0.5], [roller_radius + 1, roller_width + 0.5]]);
}

// Seat at x = 0, tips towards the axis.
module fork() {
	difference() {
		translate([-fork_ear, -fork_width / 2, -fork_length / 2]) cube([fork_ear, fork_width, fork_length]);
		for (d = [-1, 1]) translate([-10, 0, d * fork_hole_distance / 2]) rotate([0, 90, 0]) cylinder(h = 20, d = 3.2);
	}
	difference() {
		translate([-fork_height, -fork_width / 2, -fork_body / 2]) cube([fork_height, fork_width, fork_body]);
		translate([-fork_height - 1, -fork_width / 2 - 1, -fork_slot / 2]) cube([fork_slot_depth + 1, fork_width + 2, fork_slot]);
	}
}

// From the plate's back: ears, body behind, its top through the plate.
module servo_motor() {
	translate([0, 0, 1.25]) cube([servo[2] + 4, servo[1] - 0.6, 2.5], center = true);
	translate([-servo[0] / 2 + 0.3, -servo[1] / 2 + 0.3, -servo_case_above]) cube([servo[0] - 0.6, servo[1] - 0.6, servo_case_above + servo_case_below]);
	translate([-servo[4], 0, -servo_case_above - 5]) cylinder(h = 6, r = 3);
}

module camera() {
	sphere(camera_diameter / 2 - 1.5, $fn = 32);
	lenses();
}
// Its board, what stands on both sides, its lens.
module board_camera() {
	linear_extrude(1.6) square(module_board, center = true);
	translate([0, 0, 1.6]) linear_extrude(6) square(module_board - 10, center = true);
	translate([0, 0, 2 - module_lens]) cylinder(h = module_lens - 1, r = module_lens_radius - 1);
}
module lenses() for (s = [-1, 1]) rotate([-90 * s, 0, 0]) intersection() {
	translate([0, 0, camera_diameter / 2 - 11]) sphere(11, $fn = 48);
	translate([0, 0, camera_diameter / 2 - 3.5]) cylinder(h = camera_diameter, r = 10);
}

module board() {
	cube([board_width, board_depth, 1.6]);
	translate([4, 4, 0]) cube([board_width - 8, board_depth - 8, 1.6 + board_parts]); // what stands on it
}
