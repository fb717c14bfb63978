/* SPDX-License-Identifier: Apache-2.0 */
/* A pair (pair.h) over time: it may not be valid yet, and may be made anew while it is in use. Loop
 * thread. */
#ifndef LP_WEBSOCKET_CERTIFICATE_H
#define LP_WEBSOCKET_CERTIFICATE_H

#include <stdbool.h>

#include "drivers/publisher/websocket/pair.h"

struct lp_certificate {
	const char *object, *folder; /* borrowed */
	struct lp_pair pair;	     /* in use, if it is valid */
	bool is_valid;
	struct lp_pair_stamp read; /* how the files looked that were read last */
	struct lp_pair_stamp seen; /* and when they were looked at last */
};

/* Read it for the first time. 0, also when it is not valid now; -EINVAL or -errno: nothing will
 * make it so but the user. Logged. */
int lp_certificate_begin(struct lp_certificate *certificate, const char *object,
			 const char *folder);

/* Look at it; every few seconds. True: there is another pair to use, the first one or a new one.
 * What cannot be used is logged, and the former stays. */
bool lp_certificate_look(struct lp_certificate *certificate);

void lp_certificate_finish(struct lp_certificate *certificate);

#endif
