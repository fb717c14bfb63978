/* SPDX-License-Identifier: Apache-2.0 */
/* The query of the URIs of ws: and wss:. */
#ifndef LP_WEBSOCKET_OPTIONS_H
#define LP_WEBSOCKET_OPTIONS_H

#include "drivers/publisher/share.h"

struct lp_params;

struct lp_websocket_options {
	struct lp_share share;
	char root[1024];
	char origins[1024];
	char connect[1024];
	char pair[1024];
};

extern const struct lp_params lp_ws_params, lp_wss_params;

/* A folder, or none (""). -ENOTDIR, logged under `object`. */
int lp_websocket_check_root(const char *object, const char *root);

#endif
