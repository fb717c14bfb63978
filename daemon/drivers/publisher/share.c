/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/publisher/share.h"

#include <limits.h>
#include <stdio.h>

#include "base/macros.h"
#include "base/param.h"

static const struct lp_param list[] = {
	{"clients", LP_PARAM_INT, offsetof(struct lp_share, clients), .initial = "0", .max = 4096,
	 .help = "maximum number of clients of this publisher; 0: as many as there are places"},
	{"per_peer", LP_PARAM_INT, offsetof(struct lp_share, per_peer), .initial = "0", .max = 4096,
	 .help = "maximum from one address or user, of all publishers; 0: half of --max-clients, "
		 "at least 8"},
};
const struct lp_params lp_share_params = LP_PARAMS(list);

void lp_share_complete(struct lp_share *share, int max_clients)
{
	if (share->clients == 0)
		share->clients = INT_MAX;
	if (share->per_peer == 0)
		share->per_peer = max_clients / 2 > 8 ? max_clients / 2 : 8;
}

const char *lp_share_refusal(const struct lp_share *share, const char *scheme, int same,
			     const char *peer, char *text, size_t size_bytes)
{
	if (share->taken >= share->clients)
		(void)snprintf(text, size_bytes, "%s has %d clients — raise its ?clients=", scheme,
			       share->taken);
	else if (same >= share->per_peer)
		(void)snprintf(text, size_bytes, "%d are from the same %s — raise ?per_peer=", same,
			       peer);
	else
		return NULL;
	return text;
}
