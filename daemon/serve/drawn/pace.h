/* SPDX-License-Identifier: Apache-2.0 */
/* When a client that says what it draws needs its next reflection map: when the light has changed
 * by more than its tolerance, and once a second besides, as things move that change no light. */
#ifndef LP_SERVE_DRAWN_PACE_H
#define LP_SERVE_DRAWN_PACE_H

#include "serve/drawn/drawn.h"

/* The light when the last map was sent. Zeroed: none has been. */
struct lp_drawn_pace {
	int64_t t_ns;
	float sh[LP_MAX_SH_COUNT]; /* luminance of the total */
};

bool lp_drawn_pace_is_due(const struct lp_drawn_pace *pace,
			  const struct lp_light_estimate *estimate,
			  const struct lp_drawn *tolerance, int64_t now_ns);

/* A map of this estimate is sent. */
void lp_drawn_pace_note(struct lp_drawn_pace *pace, const struct lp_light_estimate *estimate,
			int64_t now_ns);

#endif
