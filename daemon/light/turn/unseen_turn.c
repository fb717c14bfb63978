/* SPDX-License-Identifier: Apache-2.0 */
#include "light/turn/unseen_turn.h"

#include <math.h>

#include "light/turn/motion.h"

#define DEG (M_PI / 180.0)
/* Chosen by hand, on bare rooms. */

/* Longer than the short exposures of a bracket last. Half as long it is not looked again. */
#define BLIND_S 1.0
/* A frame that would show a turn as small as this is enough. */
#define SHOWN_TURN (10.0 * DEG)
/* A frame is compared with the map, which shows how the camera was turned so long ago. */
#define MAP_AGE_S 0.3

bool lp_unseen_turn_is_due(struct lp_unseen_turn *unseen, double elapsed_s)
{
	unseen->wait_s = fmax(unseen->wait_s - elapsed_s, 0.0);
	return unseen->wait_s == 0.0;
}

void lp_unseen_turn_looked(struct lp_unseen_turn *unseen, const double information[3][3],
			   double elapsed_s)
{
	const double shown = lp_motion_shown_turn_rad(information);

	if (shown < SHOWN_TURN) {
		*unseen = (struct lp_unseen_turn){.wait_s = BLIND_S / 2.0};
		return;
	}
	unseen->blind_s += elapsed_s;
	if (unseen->blind_s > BLIND_S)
		unseen->rate_rad_s = fmin(shown / MAP_AGE_S, LP_HEAD_RATE);
}
