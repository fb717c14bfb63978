/* SPDX-License-Identifier: Apache-2.0 */
/*
 * How far away a lamp is, by how its direction changes as the probe goes from place to place. The
 * sightings of one lamp are kept as a few nodes along the way. To all of them are fitted the lamp's
 * direction and inverse distance, and by how much poses are late (Gauss-Newton; inverse depth:
 * Civera, Davison & Montiel 2008). Poses err alike for some seconds, which the sigma counts. Plain
 * data; zeroed is a new one. One thread.
 */
#ifndef LP_LIGHT_PLACE_PARALLAX_H
#define LP_LIGHT_PLACE_PARALLAX_H

#include <stdbool.h>
#include <stdint.h>

#include "light/math/rotation.h"

#define LP_PARALLAX_NODES 16
/* Poses err alike for so long: of trackers by camera and gyroscope. */
#define LP_POSE_MEMORY_S 2.0

/* How the probe was turned and where it was when a frame was captured, in the world of who tells
 * it. */
struct lp_probe_pose {
	int64_t t_ns;
	uint32_t world;		     /* a number: who else tells it, or jumps, has another one */
	struct lp_rotation rotation; /* anchor frame to the world */
	double position_m[3];
	double sigma_rad, sigma_m;	       /* 1 sigma about, and along, each axis */
	double late_sigma_s;		       /* of how late all poses are, alike */
	double rate_rad_s[3], velocity_m_s[3]; /* how fast it turns and goes, in the world */
};

/* Whether all of it is numbers of places and times that can be. Others are left out. */
bool lp_probe_pose_is_sane(const struct lp_probe_pose *pose);

/* What was seen of the lamp from one place: means. */
struct lp_parallax_node {
	double t_s, count;
	double direction[3], position_m[3]; /* world; a unit vector */
	double variance;		    /* rad^2, of the direction in the picture */
	double irradiance, radius_rad;	    /* of what is seen of the lamp; 0: not known */
	double strength_sigma;		    /* of the irradiance, relative */
	double pose_variance_rad2, pose_variance_m2;
	double rate_rad_s[3], velocity_m_s[3];
};

/* What the nodes say: from `here_m` the lamp is in this direction (world). */
struct lp_parallax_fit {
	double here_m[3], direction[3];
	double inverse_per_m, late_s; /* one over the distance; by how much poses are late */
};

struct lp_parallax {
	int count; /* nodes */
	uint32_t world;
	int misses;		    /* sightings in a row that the fit does not explain */
	struct lp_parallax_fit fit; /* if sigma_per_m > 0 */
	struct lp_parallax_node nodes[LP_PARALLAX_NODES]; /* oldest first */
	/* Inverse distance from where the probe is now, and 1 sigma; sigma 0: nothing is known. May
	 * be below 0, as noise has it. */
	double inverse_per_m, sigma_per_m;
	/* How often no single place explained what was seen, lately: fades within some seconds. */
	double doubt, t_doubt_s;
};

/* A lamp in a picture. */
struct lp_parallax_sighting {
	float direction[3]; /* anchor frame */
	float sigma_rad;    /* 1 sigma of it */
	/* Luminance, at normal incidence; angular radius. 0: not known, as of one that clips. Of a
	 * lamp that is weaker than from elsewhere a part is hidden: its middle lies aside. */
	float irradiance, radius_rad;
	float strength_sigma; /* 1 sigma of the irradiance, relative */
};

/* The lamp is seen by `pose`. A lamp that no single place explains has moved: what was known of it
 * is forgotten. */
void lp_parallax_see(struct lp_parallax *parallax, const struct lp_probe_pose *pose,
		     const struct lp_parallax_sighting *sighting);

/* Turns the direction (a unit vector) of a lamp that is 1 / inverse_per_m away into that after the
 * probe has gone by `way_m`, same frame. Returns the old distance over the new one. A way that
 * leads to the lamp, or is no number, changes nothing. */
double lp_nearer(const double way_m[3], double inverse_per_m, float direction[3]);

/* The probe has gone by `way_m`, anchor frame, 1 sigma along each axis: the lamp's direction
 * (likewise) follows, and its distance; *nearer: the old distance over the new one. Returns the
 * variance of that step, rad^2, about each axis. Nothing changes while the distance is not known.
 */
float lp_parallax_go(struct lp_parallax *parallax, const double way_m[3], double sigma_m,
		     float direction[3], float *nearer);

/* How often, lately, no single place has explained what was seen; and 1 while sighting after
 * sighting contradicts what is known. */
double lp_parallax_doubt(const struct lp_parallax *parallax);

/* From this doubt on, of one lamp or the mean of all, no distance is stated: the lamp moves, or the
 * probe's place is told wrongly. */
#define LP_PARALLAX_MOST_DOUBT 0.5

/* Metres, and 1 sigma of it, relative: where the inverse is LP_PARALLAX_SIGMAS sigmas from 0 and
 * several places agree on it; NAN: not known. `nearest_m`: else, that it is at least so far away,
 * at 3 sigma; 0: nothing is known. */
struct lp_lamp_distance {
	float distance_m, sigma, nearest_m;
};

#define LP_PARALLAX_SIGMAS 3.0

struct lp_lamp_distance lp_parallax_distance(const struct lp_parallax *parallax);

#endif
