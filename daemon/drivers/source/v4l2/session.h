/* SPDX-License-Identifier: Apache-2.0 */
/* One camera while it is open: from its node to a running stream with its controls held. */
#ifndef LP_SOURCE_V4L2_SESSION_H
#define LP_SOURCE_V4L2_SESSION_H

#include "drivers/source/v4l2/controls.h"
#include "drivers/source/v4l2/nodes.h"
#include "drivers/source/v4l2/offers.h"
#include "drivers/source/v4l2/settings.h"
#include "include/source.h"

struct lp_v4l2_stream;

struct lp_v4l2_session {
	char object[96]; /* "v4l2: /dev/video0", for messages */
	struct lp_v4l2_node node;
	struct lp_offer_choice choice;
	struct lp_v4l2_stream *stream;
	struct lp_v4l2_controls controls;
};

/* Why a camera could not be opened, for whoever reads the log. */
struct lp_v4l2_fault {
	enum lp_source_state
		state; /* DOWN: trying again is of no use before something is plugged in */
	const char *stage;
	char reason[400]; /* with the next step */
};

/* 0; or -errno, with `*fault` filled in and nothing left open. Not logged. */
int lp_v4l2_session_open(struct lp_v4l2_session *session, const struct lp_v4l2_node *node,
			 const struct lp_v4l2_settings *settings, struct lp_v4l2_fault *fault);

/* Puts the controls back. Frames need not be back. */
void lp_v4l2_session_close(struct lp_v4l2_session *session);

#endif
