// SPDX-License-Identifier: Apache-2.0
// What follows from params.scad. Axial positions are z of the wheel frame: backwards.
include <params.scad>

film_z = -(camera_diameter / 2 + film_before_apex);
wheel_front_z = film_z - film_lip;
comb_z = wheel_front_z + wheel_front_thickness;
shoulder_z = comb_z + comb_thickness;
rim_z = shoulder_z + rim_shoulder;
plate_z = rim_z + rim_thickness / 2 + roller_width / 2 + plate_margin; // rollers are centred on the rim
plate_back_z = plate_z + plate_thickness;
comb_middle_z = comb_z + comb_thickness / 2;

// Teeth of the comb. Sensor A sees tooth 0 from comb_first_deg on; B sees tooth -sensor_skip one step later.
tooth_pitch_deg = 4 * comb_step_deg;
sensor_b_deg = sensor_a_deg + comb_step_deg + sensor_skip * tooth_pitch_deg;
function tooth_deg(i) = sensor_a_deg - comb_first_deg - comb_tooth_deg / 2 - tooth_pitch_deg * i;
comb_split = comb_radius - comb_zone;
comb_root = comb_radius - 2 * comb_zone;
beam_a = comb_radius - comb_zone / 2;
beam_b = comb_split - comb_zone / 2;
function seat_radius(beam) = beam - fork_beam + fork_height;

// The wheel is held by a drill through plate and rim: at 0, and where A's and B's signals change.
gauge_angles = [0, comb_first_deg + 20 * comb_step_deg, comb_first_deg + 29 * comb_step_deg];

// Screws of the wheel, unevenly spaced so that its parts fit in one way only.
wheel_screw_angles = [20, 110, 200, 280];

wheel_gear_radius = gear_module * wheel_gear_teeth / 2;
servo_gear_teeth = wheel_gear_teeth * wheel_travel_deg / servo_travel_deg;
servo_gear_radius = gear_module * servo_gear_teeth / 2;
axes_distance = wheel_gear_radius + servo_gear_radius + gear_backlash;
// Front of the board camera's board, so that its lens is where the ball's would be.
module_front_z = module_lens - camera_diameter / 2;
servo_gear_z = wheel_front_z + (wheel_front_thickness - servo_gear_thickness) / 2;

roller_distance = rim_radius + roller_radius - roller_groove + rim_flat / 2; // flanks of 45 degrees touch
roller_angles = [210, 330]; // fixed; the third is at 90 and slides

// [body length, body width, ears' hole distances along and across, shaft from the body's middle]
servo = servo_travel_deg == 180 ? [23, 12.5, 28, 0, 5.6] : [41, 20.6, 49.5, 10, 10];

// The plate ends below the servo; the drum below the servo's gear.
plate_crotch = -(axes_distance + servo[1] / 2 + 3);
plate_bottom = plate_crotch - plate_tab;
drum_bottom = -ceil(axes_distance + servo_gear_radius + gear_module + 2) - drum_floor;
tab_x = plate_half_width - 4;
tab_screw = plate_bottom + 4; // below the ring, so that a screwdriver reaches it through the base's back

// Base, ring and lid are held together where the servo's gear is not.
lid_screw_angles = [67.5, 112.5, 247.5, 292.5];

module in_box() rotate([90, 0, 0]) children();
module at(radius, angle) rotate(angle) translate([radius, 0]) rotate(-angle) children();

// Outline of drum, ring and lid: round, with eight flats for the sensors.
module outline(shrink = 0) {
	intersection() {
		circle(ring_radius - shrink);
		rotate(22.5) circle((ring_flat - shrink) / cos(22.5), $fn = 8);
	}
}
