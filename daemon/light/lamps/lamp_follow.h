/* SPDX-License-Identifier: Apache-2.0 */
/*
 * One remembered lamp and what is seen of it: parts of light/lamps/lamp_memory.h, for its own files
 * only.
 */
#ifndef LP_LIGHT_LAMPS_LAMP_FOLLOW_H
#define LP_LIGHT_LAMPS_LAMP_FOLLOW_H

#include "light/lamps/lamp_memory.h"

/* Sigmas beyond which a measurement is a change, which is taken as it is. */
#define LP_LAMP_CHANGE_SIGMAS 5.0F

/* The chord between two directions as an angle in radians: exact for small ones. */
float lp_lamp_apart_rad(const float a[3], const float b[3]);

/* A sighting within so many radians of a known lamp is that lamp. */
float lp_lamp_gate_rad(const struct lp_lamp *lamp);

/* How many times its irradiance clipping may hide. */
float lp_lamp_hidden(const struct lp_lamp *lamp);

/* Time passes: what is known becomes less certain. */
void lp_lamp_age(struct lp_remembered_lamp *m, float elapsed_s);

/* Corrects what is known of the lamp by a sighting of it. */
void lp_lamp_follow(struct lp_remembered_lamp *m, const struct lp_lamp_sighting *s,
		    const struct lp_memory_times *times);

#endif
