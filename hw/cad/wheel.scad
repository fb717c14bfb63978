// SPDX-License-Identifier: Apache-2.0
// The wheel: front (film and gear), comb, back (rim on rollers, spigot that clamps the film), and the servo's gear.
// All drawn in the wheel frame at wheel angle 0; z = 0 is the side that lies on the printer's bed.
include <gear.scad>

module ring_of(outer, inner) {
	difference() {
		circle(outer);
		circle(inner);
	}
}

module wheel_screws(diameter) for (a = wheel_screw_angles) at(wheel_screw_radius, a) circle(diameter / 2, $fn = 24);

// Front face down: as it is seen from the room.
module wheel_front() {
	bore = film_diameter / 2 + gap;
	linear_extrude(film_lip) difference() {
		spur_gear(wheel_gear_teeth);
		circle(lip_radius);
		axis_marks();
	}
	translate([0, 0, film_lip]) linear_extrude(wheel_front_thickness - film_lip) difference() {
		spur_gear(wheel_gear_teeth);
		circle(bore);
		wheel_screws(wheel_screw_hole);
	}
}

// Two notches: the film's transmission axis lies along them.
module axis_marks() for (a = [0, 180]) rotate(a) translate([lip_radius + 1.2, 0]) square([4, 1.2], center = true);

module wheel_comb() {
	linear_extrude(comb_thickness) difference() {
		union() {
			circle(comb_root);
			for (i = [0 : comb_teeth + comb_extra - 1]) sector(comb_radius, tooth_deg(i));
			for (i = [-sensor_skip : -1]) sector(comb_split, tooth_deg(i));
		}
		circle(film_diameter / 2 + gap);
		wheel_screws(wheel_screw_clear);
	}
}

module sector(radius, angle) {
	h = comb_tooth_deg / 2;
	steps = [for (k = [-4 : 4]) angle + h * k / 4];
	polygon(concat([[0, 0]], [for (a = steps) radius * [cos(a), sin(a)]]));
}

// Back face up in the box, down on the bed: mirrored, so that the angles are right once it is turned over.
module wheel_back() mirror([0, 1, 0]) {
	spigot = film_diameter / 2 - gap;
	bore = lip_radius - 0.5;
	chamfer = (rim_thickness - rim_flat) / 2;
	difference() {
		union() {
			rotate_extrude($fn = 180) polygon([
				[bore, 0], [rim_radius - chamfer, 0], [rim_radius, chamfer], [rim_radius, chamfer + rim_flat],
				[rim_radius - chamfer, rim_thickness], [wheel_screw_radius + 3, rim_thickness],
				[wheel_screw_radius + 3, rim_thickness + rim_shoulder], [spigot, rim_thickness + rim_shoulder],
				[spigot, spigot_end()], [bore, spigot_end()]]);
		}
		translate([0, 0, -1]) linear_extrude(30) wheel_screws(wheel_screw_clear);
		translate([0, 0, -1]) linear_extrude(2.6 + 1) wheel_screws(5); // heads
		translate([0, 0, -1]) linear_extrude(30) for (a = gauge_angles) at(gauge_radius, gauge_deg - a) circle(gauge_hole / 2, $fn = 24);
	}
}
// From the bed to where the spigot meets the film.
function spigot_end() = rim_thickness + rim_shoulder + comb_thickness + wheel_front_thickness - film_lip - film_thickness;

module servo_gear() {
	linear_extrude(servo_gear_thickness) difference() {
		spur_gear(servo_gear_teeth);
		circle(horn_centre_hole / 2);
		for (a = [0 : 45 : 315]) at(horn_hole_radius, a) circle(horn_hole / 2, $fn = 24);
		gear_windows();
	}
}

// Lighter, and less to turn: a rim, a hub and six spokes remain.
module gear_windows() difference() {
	circle(servo_gear_radius - 1.25 * gear_module - gear_rim);
	circle(horn_hole_radius + 5);
	for (a = [30 : 60 : 330]) rotate(a) translate([0, -gear_spoke / 2]) square([servo_gear_radius, gear_spoke]);
}
