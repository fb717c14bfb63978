/* SPDX-License-Identifier: Apache-2.0 */
/*
 * How fast a camera that seems to hold still may be turning: in the dark, or below a lamp in the
 * middle of a bare ceiling, every frame looks like the one before. Twice a second a frame is looked
 * at closely; where it would not show a turn, the next ones are, too: short exposures of a bracket
 * show only lamps. Plain data; zeroed is a new one. One thread.
 */
#ifndef LP_LIGHT_TURN_UNSEEN_TURN_H
#define LP_LIGHT_TURN_UNSEEN_TURN_H

#include <stdbool.h>

struct lp_unseen_turn {
	double wait_s;	   /* until the next frame is to be looked at */
	double blind_s;	   /* for how long frames have been looked at that would not */
	double rate_rad_s; /* 1 sigma of how fast the camera may turn; 0: that would be seen */
};

/* The next frame, elapsed_s after the one before: whether to look at it closely. */
bool lp_unseen_turn_is_due(struct lp_unseen_turn *unseen, double elapsed_s);

/* It has been looked at; information: per rad^2, of a turn, by its picture alone. */
void lp_unseen_turn_looked(struct lp_unseen_turn *unseen, const double information[3][3],
			   double elapsed_s);

#endif
