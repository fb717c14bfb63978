/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A client that tells how its head is turned: its poses on our clock. Pure logic; zeroed is a new
 * one.
 */
#ifndef LP_SERVE_POSES_POSE_SENDER_H
#define LP_SERVE_POSES_POSE_SENDER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "serve/codec/codec.h"
#include "serve/poses/client_clock.h"

struct lp_orientation_sample;

struct lp_pose_sender {
	struct lp_client_clock clock;
	int64_t ponged_ns; /* when its newest ping was answered; 0: none yet */
	bool has_pose;
	int64_t newest_ns; /* time of its newest pose that counted, on its own clock */
};

/* A pose that has just come. 0: `sample` is filled. -ETIME: its time cannot be, by the client's own
 * pings, and `fault` says so. */
int lp_pose_sender_sample(struct lp_pose_sender *sender, const struct lp_client_pose *pose,
			  int64_t now_ns, struct lp_orientation_sample *sample, char *fault,
			  size_t fault_bytes);

/* Whether a pose that comes out of order on our clock does not on the client's own: its pings have
 * just shown that its clock lies a little otherwise. And: a pose has counted. */
bool lp_pose_sender_is_in_order(const struct lp_pose_sender *sender,
				const struct lp_client_pose *pose);
void lp_pose_sender_counted(struct lp_pose_sender *sender, const struct lp_client_pose *pose);

/* A ping that has just come; what to answer. */
struct lp_pong lp_pose_sender_ping(struct lp_pose_sender *sender, const struct lp_client_ping *ping,
				   int64_t now_ns);

/* Why a pose was refused, next step included: by -ETIME, or what lp_orientation_pose() returns. */
const char *lp_pose_refusal(int code);

#endif
