/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A flat polarizing sheet in front of the lens, and what of the light passes it.
 *
 * The sheet has the normal n, the transmission axis p, a = n x p, and two surfaces of refractive
 * index N. Light from direction d meets them at theta and goes on inside at theta', sin theta = N
 * sin theta'. What passes the inside is polarized along d' x a, d' the refracted direction; each
 * surface lets sqrt(Ts) and sqrt(Tp) of an amplitude pass, sqrt(Ts / Tp) = cos(theta - theta')
 * (Fresnel). So what passes was polarized along
 *
 *     u = d x a + (cos theta' - cos theta / N) (a d) / N (n x d)
 *
 * With psi the angle of u in the direction's own frame (x = d x up, y = x x d; +X at the poles), t
 * the transmission on the axis of the sheet, D the diattenuation:
 *
 *     I = t/2 G (S0 + D (S1 cos 2 psi + S2 sin 2 psi))
 *
 * (first row of a diattenuator's Mueller matrix: Goldstein, Polarized Light, ch. 5). G is 1 on the
 * axis; off it the share of both surfaces, and of what they reflect to and fro (without
 * interference). What leaks across the axis takes the same G. N = 1 is an ideal sheet: G = 1, u =
 * d x a. Pure functions and plain data; any thread.
 */
#ifndef LP_LIGHT_FILM_SHEET_H
#define LP_LIGHT_FILM_SHEET_H

#include <stdbool.h>

#include "light/math/rotation.h"

#ifdef __cplusplus
extern "C" {
#endif

#define LP_MAX_SHEETS 4
/* Angles of incidence at which the mean over the angles of the wheel is kept. */
#define LP_FILM_STEPS 33

/* Equal sheets, one in front of each lens, turned together. */
struct lp_film {
	float gain;	     /* of unpolarized light, on the axis: t/2; 0: there is no film */
	float diattenuation; /* D = (r - 1) / (r + 1), r the extinction ratio */
	float index;	     /* N */
	float offset_deg;    /* from the wheel's angle to the transmission axis */
	float rest_s;	     /* that it stays at one angle between sweeps */
	/* Three at 90, 45 and 0 degrees, instead of a wheel; `gain` is that of all. G is that of
	 * their Mueller matrices' product, for unpolarized light. */
	bool is_stack;
	int sheet_count;
	struct lp_rotation lens[LP_MAX_SHEETS]; /* lens frame to probe frame */
	/* G over all angles of the wheel, its mean and relative deviation; by cosine of the angle
	 * of incidence, from edge-on to 1. */
	float mean[LP_FILM_STEPS], deviation[LP_FILM_STEPS];
};

/* A film at one angle of the wheel, in the frame in which directions are given. */
struct lp_film_view {
	const struct lp_film *film;	/* borrowed */
	bool angle_known;		/* false: `across` is that of 0 degrees */
	float normal[LP_MAX_SHEETS][3]; /* away from the camera */
	float across[LP_MAX_SHEETS][3]; /* n x p */
};

/* What of light from one direction passes. */
struct lp_film_pass {
	float axis[2];	  /* D (cos 2 psi, sin 2 psi); only if `polarizes` */
	float gain;	  /* G; beyond 75 degrees off the normal as there */
	float gain_sigma; /* of it, relative; 0: the wheel's angle is known */
	/* False: the wheel's angle is not known, or a stack, or the sheet is seen edge-on, more
	 * than 75 degrees off its normal, where real sheets fail. */
	bool polarizes;
};

/* The frame of Stokes parameters of light from a unit direction: right = d x up, horizontal (+X at
 * the poles), and up = right x d. */
void lp_stokes_frame(const float direction[3], float right[3], float up[3]);

/* One sheet across the probe's forward axis, also for the half behind (equirectangular cameras). */
struct lp_film lp_film_of_one_sheet(float transmission, float extinction_ratio, float index);

/* How much of unpolarized light passes three such sheets at 90, 45 and 0 degrees, on the axis: t/2
 * twice more, and less what the first leaves of its own polarization (product of their Mueller
 * matrices). */
float lp_film_stack_gain(float transmission, float extinction_ratio);

/* wheel_deg: angle of the wheel (docs/users/conventions.md), NAN: not known, or a stack; to_frame:
 * from the probe's frame to that of the directions. Borrows `film`. */
struct lp_film_view lp_film_seen(const struct lp_film *film, float wheel_deg,
				 const struct lp_rotation *to_frame);

/* Along a unit direction. */
struct lp_film_pass lp_film_pass(const struct lp_film_view *view, const float direction[3]);

/* q, u as which a sweep finds light that is not polarized, if the sheet stands a quarter turn from
 * where `view` has it: it is divided by the wrong gains. */
void lp_film_turned(const struct lp_film_view *view, const float direction[3], float stokes[2]);

#ifdef __cplusplus
}
#endif

#endif
