/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What the ring read while the camera turned: the light is the same, and each sensor sees it from
 * elsewhere. One reading for each of some poses that are apart. Plain data; zeroed has none.
 */
#ifndef LP_LIGHT_RING_RING_POSES_H
#define LP_LIGHT_RING_RING_POSES_H

#include <stdbool.h>

#include "include/ring_sample.h"
#include "light/clipped/ring_fusion.h"
#include "light/math/rotation.h"

struct lp_ring_poses {
	int count;
	struct lp_ring_pose {
		struct lp_rotation to_panorama;
		struct lp_ring_sample sample;
	} list[LP_RING_POSES]; /* newest first */
};

/* A reading takes the place of those of about the same pose, once they are old. Readings without a
 * time (t_ns 0) are not kept. */
void lp_ring_poses_keep(struct lp_ring_poses *poses, const struct lp_rotation *to_panorama,
			const struct lp_ring_sample *sample);

/* Whether the reading counts beside one of another pose, now_ns. */
bool lp_ring_pose_counts(const struct lp_ring_pose *pose, const struct lp_rotation *to_panorama,
			 int64_t now_ns);

float lp_ring_pose_age_s(const struct lp_ring_pose *pose, int64_t now_ns);

/* The panorama's frame of reference is another. */
void lp_ring_poses_turn(struct lp_ring_poses *poses, const struct lp_rotation *turn);

/* The light may be another. */
void lp_ring_poses_forget(struct lp_ring_poses *poses);

#endif
