/* SPDX-License-Identifier: Apache-2.0 */
#include "serve/poses/pose_sender.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>

#include "base/clock.h"
#include "include/orientation.h"

/* A pose is of no use when it is older, and of another clock when it is of later. */
#define OLDEST_NS LP_NS_PER_S
#define FUTURE_NS (20 * LP_NS_PER_MS)

int lp_pose_sender_sample(struct lp_pose_sender *sender, const struct lp_client_pose *pose,
			  int64_t now_ns, struct lp_orientation_sample *sample, char *fault,
			  size_t fault_bytes)
{
	int64_t sigma_ns;

	lp_client_clock_heard(&sender->clock, pose->time_ns, now_ns, false);
	*sample = (struct lp_orientation_sample){.kind = LP_ATTITUDE, .sigma = pose->sigma_rad};
	memcpy(sample->quaternion, pose->quaternion, sizeof(sample->quaternion));
	memcpy(sample->position_m, pose->position_m, sizeof(sample->position_m));
	sample->position_sigma_m = pose->position_sigma_m;
	sample->t_ns = lp_client_clock_ours_ns(&sender->clock, pose->time_ns, &sigma_ns);
	sample->time_sigma_s = (double)sigma_ns / 1e9;
	const int64_t age_ns = now_ns - sample->t_ns;

	if (age_ns <= OLDEST_NS && age_ns >= -FUTURE_NS - 3 * sigma_ns)
		return 0;
	(void)snprintf(fault, fault_bytes,
		       "orientation: time: a pose is %.3f s old by the client's pings, 0 to 1 s "
		       "can be — stamp poses with the clock of the pings",
		       (double)age_ns / 1e9);
	return -ETIME;
}

bool lp_pose_sender_is_in_order(const struct lp_pose_sender *sender,
				const struct lp_client_pose *pose)
{
	return sender->has_pose && pose->time_ns > sender->newest_ns;
}

void lp_pose_sender_counted(struct lp_pose_sender *sender, const struct lp_client_pose *pose)
{
	sender->has_pose = true;
	sender->newest_ns = pose->time_ns;
}

struct lp_pong lp_pose_sender_ping(struct lp_pose_sender *sender, const struct lp_client_ping *ping,
				   int64_t now_ns)
{
	if (ping->has_pong_time && sender->ponged_ns)
		lp_client_clock_answered(&sender->clock, sender->ponged_ns, ping->pong_time_ns,
					 now_ns);
	lp_client_clock_heard(&sender->clock, ping->time_ns, now_ns, true);
	sender->ponged_ns = lp_clock_ns();
	return (struct lp_pong){.ping_time_ns = ping->time_ns,
				.t_received_ns = now_ns,
				.t_sent_ns = sender->ponged_ns};
}

const char *lp_pose_refusal(int code)
{
	switch (code) {
	case -EOPNOTSUPP:
		return "poses are not used — start lightprobed with --orientation=client";
	case -EBUSY:
		return "another client's poses are used — one app at a time tells how the probe is "
		       "turned";
	case -ESTALE:
		return "time_ns: is not later than that of the pose before — send poses in the "
		       "order "
		       "of time";
	case -ETIME:
		return "time_ns: more than 1 s old, or not yet — stamp poses with the clock of the "
		       "pings";
	default:
		return "orientation: must be a unit quaternion of finite numbers, x y z w";
	}
}
