// SPDX-License-Identifier: Apache-2.0
// Every dimension of the box, in mm and degrees; the only place for numbers.
//
// Box frame: x right, y forward (to where the wheel looks), z up, origin in the middle of the camera:
// the probe frame's (x, -z, y). Wheel frame: x right, y up, z backwards, so that angles count
// counter-clockwise seen from inside looking out, as the wheel's do; in_box() turns one into the other.
//
// tools/dimensions.py reads the lines `name = number;` of this file; tests measure the parts against them.

// --- printing
gap = 0.15;              // between parts that are pushed together, per side
wall_min = 1.2;          // three lines of a 0.4 mm nozzle
$fa = 3;
$fs = 0.5;

// --- camera: a ball with a plug below (Insta360 Air class)
camera_diameter = 37.6;
camera_plug_width = 13;  // of the cable's plug, along x
camera_plug_depth = 9;   // along y
pupil_behind_apex = 4.0; // of the front lens
film_before_apex = 2.0;

// --- instead of the ball: a board camera with a fisheye lens, which sees one hemisphere
module_board = 38;       // square
module_holes = 34;       // from hole to hole; 28 for boards of 32
module_hole = 1.7;       // M2, cuts its own thread
module_lens = 22;        // from the board's front to the lens's apex
module_lens_radius = 12; // with its holder
module_sheet = 3;
module_rib = 9;

// --- polarizing film and the wheel that carries it
film_diameter = 52;
film_thickness = 0.8;    // with a paper ring under it if thinner
film_lip = 0.8;          // before the film
lip_radius = 24;         // clear view
wheel_front_thickness = 6.0;
wheel_screw_radius = 29;
wheel_screw_hole = 2.1;  // M2.5, cuts its own thread
wheel_screw_clear = 2.8;
rim_radius = 37;         // tip of the V
rim_thickness = 4.0;
rim_flat = 1.0;          // width of the V's tip
rim_shoulder = 3.9;      // between rim and comb: room for the rollers' nuts
gauge_hole = 2.1;        // a 2 mm drill holds the wheel
gauge_radius = 33.6;
gauge_deg = 135;         // where the plate's gauge hole is

// --- comb: what firmware/README.md assumes; COMB_* of firmware/params.h
comb_first_deg = -16.5;
comb_step_deg = 3;       // edge to edge, both sensors together
comb_teeth = 17;         // that the firmware counts; comb_extra more, so that counting goes on above
comb_extra = 4;
comb_tooth_deg = 6;
sensor_skip = 2;         // sensors are 3 + 12 * skip degrees apart; that many teeth are short
sensor_a_deg = 40;
comb_thickness = 1.6;
comb_radius = 45;
comb_zone = 2.6;         // radial height of one sensor's zone: A outside, B inside

// --- slotted sensors (TCST2202 class)
fork_length = 25;        // with ears, across the slot
fork_body = 12.4;
fork_width = 6.4;
fork_height = 10.8;      // from seat to tips
fork_ear = 3.1;
fork_slot = 3.1;
fork_slot_depth = 7.2;
fork_beam = 2.5;         // below the tips
fork_hole_distance = 19;

// --- rollers: V623ZZ, 3 x 12 x 4
roller_bore = 3;
roller_radius = 6;
roller_width = 4;
roller_groove = 1.5;     // depth
roller_screw = 12;       // M3, from behind the plate
roller_nut = 2.4;
roller_play = 1.5;       // the top one slides so far up

// --- gears
gear_module = 1;
wheel_gear_teeth = 66;
gear_backlash = 0.15;    // added to the distance of the axes
gear_pressure_deg = 20;
wheel_travel_deg = 270;  // of the wheel for the servo's whole travel

// --- servo: 180 (geared 3:2 up) or 270 (straight)
servo_travel_deg = 180;
servo_gear_thickness = 4;
servo_case_above = 10;   // case beyond the ears, towards the gear
servo_case_below = 28;   // behind the ears
gear_rim = 3;            // of the servo's gear, below its teeth
gear_spoke = 5;
horn_hole_radius = 8;
horn_hole = 2.2;
horn_centre_hole = 8;

// --- plate
plate_thickness = 4;
plate_margin = 1;        // roller above the plate: a washer
plate_hole_radius = 31;
plate_half_width = 46;
plate_tab = 13;          // height of its two feet
m3_clear = 3.3;
m3_thread = 2.6;

// --- drum and ring
ring_radius = 60;
ring_flat = 59;          // distance of the sensors' faces from the axis
ring_height = 14;
ring_z = -77;            // of the eight sensors
drum_wall = 3;
drum_floor = 4;
lid_top = -48;
lid_top_radius = 43;
lid_screw_radius = 54;
lid_screw_seat = 4;      // of the heads, above the lid's lower edge
ldr_diameter = 5.6;      // GL5528: 5.1 x 4.3
ldr_depth = 2.2;
ldr_leads = 3.4;
ldr_lead_hole = 1.0;
ldr_top_z = 63;
board_width = 70;        // perforated board, 70 x 50
board_depth = 50;
board_y = -17;           // its middle
board_post = 8;
board_parts = 12;        // height of what stands on it
cable_width = 16;
cable_height = 10;

// --- mounts
tripod_nut_flats = 11.2; // 1/4-20: 7/16 inch
tripod_nut_height = 5.8;
tripod_hole = 6.7;
headset_length = 116;
headset_width = 74;
headset_y = -5;          // its middle
headset_thickness = 3;
headset_rib = 22;        // height of what stiffens the pillars
headset_window = 26;     // half width
strap_width = 26;
strap_slot = 4;

// --- the computer on a leg of the tripod: Raspberry Pi 3, 4, 5
pi_holes_long = 58;      // between the holes of its board
pi_holes_across = 49;
pi_plate = 4;
pi_post = 9;             // strap and solder pins below the board
pi_groove = 10;          // width, for legs and columns of 15 mm and more
pi_ear = 20;             // beyond its holes, for LED and button
pi_ear_hole = 21;        // of both, from the groove's middle: beside legs and columns up to 30 mm
led_hole = 5.1;          // a 5 mm LED up to its collar
button_hole = 7.3;       // thread of 7 mm
pi_strap = 12;           // the straps' slots from the groove's middle
