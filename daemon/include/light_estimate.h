/* SPDX-License-Identifier: Apache-2.0 */
/* The result: lamps, spherical harmonics for the rest, and how much of it to believe. By value. */
#ifndef LP_LIGHT_ESTIMATE_H
#define LP_LIGHT_ESTIMATE_H

#include <stdbool.h>
#include <stdint.h>

#include "proto/flags.h"

#define LP_MAX_LIGHTS 8
#define LP_MAX_SH_ORDER 4 /* on the wire */
#define LP_SH_COUNT(order) (((order) + 1) * ((order) + 1))
#define LP_MAX_SH_COUNT LP_SH_COUNT(LP_MAX_SH_ORDER)
#define LP_FINE_SH_COUNT LP_SH_COUNT(8) /* inside; light/math/sh.h */

/* How a lamp's light is polarized. Zeroed: nothing is known. */
struct lp_light_polarization {
	bool judged;	  /* whether it is a mirror image */
	bool known;	  /* dolp and aolp_deg */
	float reflection; /* probability that it is a mirror image of another lamp, 0..1 */
	float dolp;	  /* degree of linear polarization, 0..1 */
	float aolp_deg; /* angle of it, 0..180: 0 horizontal, counter-clockwise as seen from inside
			 */
	float dolp_sigma, aolp_sigma_deg;
};

/* One lamp. Unknown values are NAN. Directions are unit vectors towards the light, probe frame. */
struct lp_light {
	uint32_t id; /* stable while tracked; 0 before tracking */
	float direction[3];
	float irradiance[3]; /* RGB at normal incidence: integral of the radiance above its surround
			      */
	float angular_radius_deg; /* of the disc with the same solid angle */
	/* Area lights only (LP_LIGHT_EXTENDED): the ellipse with the same extent, longer axis
	 * first, and a unit vector along that. */
	float half_angle_deg[2];
	float axis[3];
	float direction_sigma_deg;
	float irradiance_sigma; /* relative, 1 sigma */
	float colour_sigma; /* 1 sigma of R, G and B, root mean square, over the luminance; 0: not
			       stated */
	float distance_m, distance_sigma; /* from the probe; 1 sigma, relative */
	float nearest_m; /* else: it is at least so far away, at 3 sigma; 0: nothing is known */
	float hidden; /* relative to irradiance: what clipping may hide, where lights are ranked */
	uint32_t flags; /* enum lp_light_flag */
	struct lp_light_polarization polarization;
};

/* How the probe was turned, and where it was, when a frame was captured. Zeroed: not known. */
struct lp_estimate_orientation {
	bool known;
	bool world;	      /* into the app's world; else into a frame that does not move */
	bool left_out;	      /* what was told of it contradicts the pictures */
	float xyzw[4];	      /* quaternion: turns the probe frame into the other */
	float sigma_deg;      /* 1 sigma about each axis */
	bool places_left_out; /* what is told of the position contradicts the pictures */
	bool has_position;
	float position_m[3]; /* of the probe, in the app's world; if has_position */
};

/* The room as a box (light/place/room.h): distances from the probe to its walls at -x +x -y +y -z
 * +z of its axes. Zeroed: not known. */
struct lp_estimate_room {
	bool known;
	float walls_m[6], walls_sigma_m[6];
	float xyzw[4]; /* turns the box's axes into the estimate's frame */
	/* By the order of the SH that are moved: 1 sigma per metre, relative to the mean irradiance
	 */
	float error_per_m[LP_MAX_SH_ORDER + 1];
	float bare_error_per_m[LP_MAX_SH_ORDER + 1]; /* where area lights are listed */
};

/*
 * The whole estimate. `sh_total` holds the light of everything; what a packet calls AMBIENT is
 * sh_total minus the projection of the lights that the packet lists (light/send/model.h), so that
 * AMBIENT + lights = TOTAL holds exactly in every band, whatever a subscriber asked for.
 */
struct lp_light_estimate {
	int64_t t_capture_ns; /* CLOCK_MONOTONIC, mid-exposure of the newest frame used */
	int64_t t_arrival_ns; /* CLOCK_MONOTONIC, arrival of that frame: latency is counted from
				 here */
	int64_t suspended_ns; /* lp_clock_suspended_ns() when the estimate was made */
	uint32_t sequence;
	uint32_t flags;			       /* enum lp_estimate_flag */
	int light_count, area_count;	       /* the last area_count of them are area lights */
	struct lp_light lights[LP_MAX_LIGHTS]; /* of each, highest lp_light_rank() first */
	float sh_total[LP_MAX_SH_COUNT][3];
	/* Luminance of all light to a higher order, probe frame: it is not turned with the rest,
	 * and only says what a smaller model leaves out. */
	float fine_sh[LP_FINE_SH_COUNT];
	/* Predicted relighting error of order l with the first k lights; relative to mean
	 * irradiance. */
	float predicted_error[LP_MAX_SH_ORDER + 1][LP_MAX_LIGHTS + 1];
	/* 1 sigma of the irradiance as measured, root mean square over normals, relative to its
	 * mean: noise, clipping, age and motion. What a small model leaves out is predicted_error.
	 */
	float relighting_sigma;
	float exposure_us; /* longest used; NAN: unknown */
	int exposure_count;
	float scale_sigma; /* relative, 1 sigma, against the first frames; NAN: exposures are known
			    */
	float cd_m2_per_unit;		  /* luminance of radiance 1; NAN: not known */
	float cd_m2_per_unit_sigma;	  /* relative, 1 sigma; NAN with it */
	float wheel_deg, wheel_sigma_deg; /* of the newest frame used (frame.h) */
	uint32_t unmeasured; /* grows with bright regions whose polarization is to be measured */
	struct lp_estimate_orientation orientation; /* at t_capture_ns */
	struct lp_estimate_room room;
};

#endif
