/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Model only what a scene requires: a model is an SH order and a number of lights. What each leaves
 * out is predicted, and the smallest one under a subscriber's tolerance is sent.
 */
#ifndef LP_LIGHT_SEND_MODEL_H
#define LP_LIGHT_SEND_MODEL_H

#include "include/light_estimate.h"
#include "light/math/rotation.h"
#include "light/math/sh.h"

/*
 * Fill estimate->fine_sh, and estimate->predicted_error from the projection to order
 * LP_SH_MAX_ORDER and the lights listed. Error of order l with the first k lights, relative to the
 * mean irradiance over all normals: root mean square over normals of the irradiance in the bands
 * above l that the k lights do not bring (by Parseval; Ramamoorthi & Hanrahan 2001), plus
 * LP_SHADOW_SHARE of the shadow contrast that is lost with the lights left out.
 */
void lp_model_predict(const double (*total)[3], struct lp_light_estimate *estimate);

/* Share of what is looked at that a lamp's shadow covers: weighs a lost shadow against a shading
 * error. Chosen by hand: nobody has measured what people see (docs/maintainers/constants.md). */
#define LP_SHADOW_SHARE 0.1F

/* Mean irradiance over all normals (luminance), by estimate->sh_total. */
double lp_model_mean_irradiance(const struct lp_light_estimate *estimate);

/* How far apart the light of two estimates is, up to order LP_MAX_SH_ORDER: root mean square over
 * normals of the difference of their irradiances (luminance), relative to the mean irradiance of
 * the first; 0 when that is black. */
float lp_model_distance(const struct lp_light_estimate *estimate,
			const struct lp_light_estimate *other);

/* Bytes on the wire (proto/lightprobe.proto): three floats a coefficient; a light with all that an
 * ordinary one says. tests/unit/test_codec.c compares them with what is sent. */
#define LP_COEFFICIENT_BYTES 12
#define LP_LIGHT_BYTES 50

/* Smallest model, in bytes on the wire, whose predicted error is at most `tolerance`, within
 * max_order and max_lights; the most exact one when none is, or when tolerance is 0. */
void lp_model_choose(const struct lp_light_estimate *estimate, int max_order, int max_lights,
		     float tolerance, int *order, int *lights);

/* AMBIENT of a packet that lists the first `lights` lights: sh_total minus their projection, so
 * that AMBIENT + lights = TOTAL in every band. */
void lp_model_ambient(const struct lp_light_estimate *estimate, int order, int lights,
		      float (*ambient)[3]);

/* Describe one light in another frame: its direction, its axis and its angle of polarization. */
void lp_model_turn_light(struct lp_light *light, const struct lp_rotation *rotation);

/* Turn all directions, coefficients and the room into another frame; `sigma_deg` of the rotation
 * adds to that of each direction. Exactly as it was when the rotation is the identity. */
void lp_model_turn(struct lp_light_estimate *estimate, const struct lp_rotation *rotation,
		   float sigma_deg);

/* Luminance of its irradiance with what clipping may hide of it: by which lights are ordered, and
 * chosen where there are too many. */
float lp_light_rank(const struct lp_light *light);

/* Share of the light reaching a surface that faces light `index`; 0..1. */
float lp_facing_share(const struct lp_light_estimate *estimate, int index);

/* Irradiance (luminance) on a surface that faces up (+Y): of all lights exactly, and of what they
 * leave by its SH, where that is not negative. */
float lp_upward_irradiance(const struct lp_light_estimate *estimate);

/* Share of `upward` (lp_upward_irradiance()) that is the light's own, 0..1; NAN when there is none.
 * Those of all lights of an estimate add up to 1 at most. */
float lp_shadow_strength(const struct lp_light *light, float upward);

#endif
