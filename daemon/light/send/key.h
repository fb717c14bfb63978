/* SPDX-License-Identifier: Apache-2.0 */
/*
 * KEY: one directional light out of smooth light, for engines that take few lights and cast no
 * shadow of their ambient light. Direction and strength are those of the first band of the SH
 * ("optimal linear direction", Sloan 2008, "Stupid Spherical Harmonics (SH) Tricks"), so that KEY
 * is a continuous function of the SH, without thresholds: a small change of light is a small change
 * of KEY. By value; no state.
 */
#ifndef LP_LIGHT_SEND_KEY_H
#define LP_LIGHT_SEND_KEY_H

#include "include/light_estimate.h"

/* How much of the first band KEY takes with it, 0..1, and the radius of a disc that throws shadows
 * as soft as smooth light does: docs/users/accuracy.md, "What belongs on the list". */
#define LP_KEY_SHARE 0.7F
#define LP_KEY_RADIUS_DEG 30.0F

/* Of radiance coefficients up to order 1 at least, probe frame. The light's id is 0. No direction
 * at all gives no irradiance, towards +Y. */
struct lp_light lp_key_light(const float (*sh)[3]);

/* Take KEY's own coefficients out: KEY + SH is what it was in every band. */
void lp_key_remove(int order, const struct lp_light *key, float (*sh)[3]);

#endif
