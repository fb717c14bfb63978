/* SPDX-License-Identifier: Apache-2.0 */
/* What the clients of a publisher get that cannot ask for anything. */
#ifndef LP_WISH_H
#define LP_WISH_H

#include <stdbool.h>

struct lp_wish {
	float rate_hz; /* 0: every estimate */
	int sh_order, max_lights;
	int health_period_ms; /* 0: none */
	int quiet_ms;	      /* between estimates that say nothing new; 0: all are sent */
	bool total;	      /* SH with the lights in it */
	bool key_light, area_lights;
};

#endif
