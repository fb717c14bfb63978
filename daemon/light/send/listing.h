/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Which lamps one kind of subscription is told of. The list is the one that leaves out the least
 * light, but a change of it has a cost, so that lamps of nearly equal strength do not change places
 * from packet to packet. A lamp that enters or leaves the list moves its light between the list and
 * AMBIENT over LP_LISTING_FADE_S. AMBIENT + lights = TOTAL holds throughout. Plain data; zeroed is
 * a new one. One thread.
 */
#ifndef LP_LIGHT_SEND_LISTING_H
#define LP_LIGHT_SEND_LISTING_H

#include <stdbool.h>
#include <stdint.h>

#include "include/light_estimate.h"

#define LP_LISTING_FADE_S 0.3F

/* What a subscription allows. */
struct lp_listing_limits {
	int sh_order, lights;
	bool areas;		    /* area lights may be listed, too */
	float tolerance;	    /* of the predicted error; 0: everything that is allowed */
	bool leave_out_reflections; /* LP_LIGHT_REFLECTION: their light stays in AMBIENT */
};

struct lp_listed {
	uint32_t id; /* 0: this place is free */
	float share; /* of its irradiance that is in the list, 0..1 */
	bool leaves;
};

/* A lamp that is not in the list, and what that has cost. */
struct lp_outside {
	uint32_t id;  /* 0: none */
	float rank;   /* lp_light_rank() */
	float cost_s; /* share of all light, times seconds */
};

struct lp_listing {
	bool started;
	int64_t t_ns;	      /* of the estimate listed last */
	int sh_order, lights; /* the model in force */
	float unfit_s;	      /* how long another model would have done better */
	struct lp_outside outside[LP_MAX_LIGHTS];
	struct lp_listed place[LP_MAX_LIGHTS];
};

/*
 * The next estimate: `listed` becomes a copy of it whose lights are those of the list, each with
 * its share of irradiance, strongest first; returns the SH order to send. listed->predicted_error
 * at [order][listed->light_count] is that of the lamps wholly in the list.
 */
int lp_listing_update(struct lp_listing *listing, const struct lp_light_estimate *estimate,
		      const struct lp_listing_limits *limits, struct lp_light_estimate *listed);

/* A copy without the lights that are reflections. Its predicted errors are upper bounds: those with
 * the lights before the first one left out. */
void lp_leave_out_reflections(const struct lp_light_estimate *estimate,
			      struct lp_light_estimate *others);

#endif
