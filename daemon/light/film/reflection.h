/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Which of the lamps are mirror images of other lamps. A smooth dielectric polarizes what it
 * mirrors by Fresnel's equations, and the image lies where the law of reflection puts it. For each
 * lamp the hypotheses are: a lamp; light that is polarized by itself (sky, screen); the image of a
 * stronger lamp in a floor or table; the image in an upright surface (window, picture). Bayes' rule
 * over the polarization, the place and the strength gives their probabilities.
 *
 * Mirrors are near and so may the lamps be: seen from the probe the lamp lies on the arc between
 * its image and the image's mirrored direction, at the far end of it if it is far away. The frame's
 * +Y points up. Pure functions.
 */
#ifndef LP_LIGHT_FILM_REFLECTION_H
#define LP_LIGHT_FILM_REFLECTION_H

#include <stdbool.h>

#include "light/film/polarization.h"

/* Reflectance for unpolarized light, and the degree of polarization of what is reflected, of a
 * dielectric of index 1.5 (Born and Wolf, Principles of Optics, 1.5.2). cosine: of the angle of
 * incidence, 0..1. */
struct lp_fresnel {
	float reflectance;
	float dolp; /* across the plane of incidence */
};
struct lp_fresnel lp_fresnel(float cosine);

enum lp_lamp_class { LP_CLASS_UNSURE, LP_CLASS_LAMP, LP_CLASS_REFLECTION };

struct lp_suspect {
	float direction[3];
	float irradiance; /* luminance */
	bool is_bound;	  /* it clips: it may be stronger by any factor */
	float radius_deg;
	struct lp_polarization polarization; /* used only if `known` */
};

struct lp_verdict {
	enum lp_lamp_class kind; /* UNSURE: neither is more likely than 0.9 */
	float reflection;	 /* probability, 0..1 */
};

/* Suspects come strongest first, as far as it is known. */
void lp_tell_reflections(const struct lp_suspect *suspects, int count, struct lp_verdict *verdicts);

/* How much likelier the polarization of images in floors is if the film has been put in a quarter
 * turn wrong, so that they seem upright. 1: nothing is mirrored that tells. */
double lp_film_turned_evidence(const struct lp_suspect *suspects, int count);

#endif
