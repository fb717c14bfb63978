/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What several angles of a polarizing sheet (light/film/sheet.h) tell of the light that passes it.
 * Pure functions and plain data; any thread.
 */
#ifndef LP_LIGHT_FILM_POLARIZATION_H
#define LP_LIGHT_FILM_POLARIZATION_H

#include <stdbool.h>

#include "light/film/sheet.h"

#ifdef __cplusplus
extern "C" {
#endif

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
	float axis[2];	 /* lp_film_pass() */
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
 * next one does so, too, all before it is forgotten and true is returned. Readings <= 0, not
 * finite, or of light beyond 1e-15 .. 1e18 are left out. */
bool lp_stokes_correct(struct lp_stokes *stokes, const struct lp_stokes_reading *reading,
		       float elapsed_s);

/* Until the readings tell S1 and S2, they are taken as 0 with a sigma of half of S0. */
struct lp_polarization lp_stokes_polarization(const struct lp_stokes *stokes);

/* Fill in dolp, aolp_deg, their sigmas and `known` from q, u and their covariance. */
void lp_polarization_complete(struct lp_polarization *polarization);

/* How much of S0 a film passes, by what is known: 1 + axis (q, u), but no less than what tells
 * anything; and its sigma. */
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
