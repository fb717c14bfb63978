/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Polarized light through a flat polarizing sheet in front of the lens, and what several angles of
 * the sheet tell of it.
 *
 * The sheet has the normal n and the transmission axis p. Light from direction d that passes is
 * polarized along e = d x (n x p). With psi the angle of e in the direction's own frame (x = d x
 * up, y = x x d; +X at the poles), t the transmission and D the diattenuation:
 *
 *     I = t/2 (S0 + D (S1 cos 2 psi + S2 sin 2 psi))
 *
 * (first row of a diattenuator's Mueller matrix: Goldstein, Polarized Light, ch. 5). Pure
 * functions and plain data; any thread.
 */
#ifndef LP_LIGHT_POLARIZATION_H
#define LP_LIGHT_POLARIZATION_H

#include <stdbool.h>

#include "light/rotation.h"

#ifdef __cplusplus
extern "C" {
#endif

#define LP_MAX_SHEETS 4

/* Equal sheets, one in front of each lens, turned together. */
struct lp_film {
	float gain;	     /* of unpolarized light: t/2; 0: there is no film */
	float diattenuation; /* D = (r - 1) / (r + 1), r the extinction ratio */
	float offset_deg;    /* from the wheel's angle to the transmission axis */
	float rest_s;	     /* that it stays at one angle between sweeps */
	int sheet_count;
	struct lp_rotation lens[LP_MAX_SHEETS]; /* lens frame to probe frame */
};

/* A film at one angle of the wheel, in the frame in which directions are given. */
struct lp_film_view {
	float diattenuation;
	float rest_s;
	int sheet_count;
	float normal[LP_MAX_SHEETS][3]; /* away from the camera */
	float across[LP_MAX_SHEETS][3]; /* n x p */
};

/* The frame of Stokes parameters of light from a unit direction: right = d x up, horizontal (+X at
 * the poles), and up = right x d. */
void lp_stokes_frame(const float direction[3], float right[3], float up[3]);

/* One sheet across the probe's forward axis, also for the half behind (equirectangular cameras). */
struct lp_film lp_film_of_one_sheet(float transmission, float extinction_ratio);

/* How much of unpolarized light passes three such sheets at 90, 45 and 0 degrees: t/2 twice more,
 * and less what the first leaves of its own polarization (product of their Mueller matrices). */
float lp_film_stack_gain(float transmission, float extinction_ratio);

/* wheel_deg: angle of the wheel (docs/users/conventions.md); to_frame: from the probe's frame to
 * that of the directions. */
struct lp_film_view lp_film_seen(const struct lp_film *film, float wheel_deg,
				 const struct lp_rotation *to_frame);

/* D (cos 2 psi, sin 2 psi) along a unit direction. False: the sheet is seen edge-on, more than 75
 * degrees off its normal, where real sheets fail; axis is then left as it is. */
bool lp_film_axis(const struct lp_film_view *view, const float direction[3], float axis[2]);

/* ---------------------------------------------------------------- Stokes parameters */

/*
 * S0, S1, S2 of one lamp or cell by weighted least squares over all readings so far, which count
 * the less the older they are. Normal equations: normal = sum w h h', right = sum w h I, with h =
 * (1, axis), I = reading / gain. Zeroed: nothing is known.
 */
struct lp_stokes {
	float normal[6]; /* xx xy xz yy yz zz */
	float right[3];
	float scale;  /* the brightest reading: what S0 may be while little is known */
	float misfit; /* squared deviation of readings, in their variances, as a moving mean */
	bool doubted; /* the reading before contradicted what is known, and was left out */
};

struct lp_stokes_reading {
	float intensity; /* behind the film, divided by its gain */
	float sigma;	 /* of it */
	float axis[2];	 /* lp_film_axis() */
	/* How far the readings of a new series may be off, squared, in their variances, until they
	 * have shown it: 1, and more where a turning camera may look beside what is measured. */
	float misfit;
	float rest_s; /* readings are remembered for longer where the film rests in between */
};

/* What is known. q = S1/S0, u = S2/S0. */
struct lp_polarization {
	float s0;			/* NAN: nothing is known */
	float q, u, qq, qu, uu;		/* and their covariance */
	float dolp, dolp_sigma;		/* 0..1, freed of the bias that noise brings */
	float aolp_deg, aolp_sigma_deg; /* 0..180, counter-clockwise from x as seen from the sensor;
					   sigma 90: not known */
	bool known;			/* three angles that differ enough have told q and u */
};

/* A reading, elapsed_s after the one before. One that contradicts what is known is left out; if the
 * next one does so, too, all before it is forgotten and true is returned. Readings <= 0 or not
 * finite are left out. */
bool lp_stokes_correct(struct lp_stokes *stokes, const struct lp_stokes_reading *reading,
		       float elapsed_s);

/* Until the readings tell S1 and S2, they are taken as 0 with a sigma of half of S0. */
struct lp_polarization lp_stokes_polarization(const struct lp_stokes *stokes);

/* Fill in dolp, aolp_deg, their sigmas and `known` from q, u and their covariance. */
void lp_polarization_complete(struct lp_polarization *polarization);

/* How much of S0 a film passes, by what is known: 1 + axis (q, u), and its sigma. */
void lp_film_factor(const struct lp_polarization *polarization, const float axis[2], float *factor,
		    float *sigma);

/* What is seen along `direction` is turned: the angle to hand to lp_stokes_turn(), and to take from
 * AoLP, to describe it in the frame of the turned direction. */
float lp_stokes_frame_turn(const struct lp_rotation *turn, const float direction[3]);

/* Express S1, S2 in a frame whose x axis is turned counter-clockwise by turn_rad. */
void lp_stokes_turn(struct lp_stokes *stokes, float turn_rad);
void lp_polarization_turn(struct lp_polarization *polarization, float turn_rad);

#ifdef __cplusplus
}
#endif

#endif
