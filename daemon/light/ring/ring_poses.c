/* SPDX-License-Identifier: Apache-2.0 */
#include "light/ring/ring_poses.h"

#include <math.h>
#include <string.h>

/* Chosen by hand (docs/maintainers/constants.md). */

/* Poses are so far apart: half of a sensor's distance from the next one around. */
#define APART_RAD (M_PI / (LP_RING_SENSORS - 1))
#define KEPT_S 10.0F
/* A reading of the same pose is renewed when it is so old. */
#define RENEWED_S 1.0F

static bool are_apart(const struct lp_rotation *a, const struct lp_rotation *b)
{
	const struct lp_rotation back = lp_rotation_inverse(b);
	const struct lp_rotation turn = lp_rotation_product(a, &back);
	double vector[3];

	lp_rotation_vector(&turn, vector);
	return sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2]) >=
	       APART_RAD;
}

float lp_ring_pose_age_s(const struct lp_ring_pose *pose, int64_t now_ns)
{
	return (float)(now_ns - pose->sample.t_ns) / 1e9F;
}

bool lp_ring_pose_counts(const struct lp_ring_pose *pose, const struct lp_rotation *to_panorama,
			 int64_t now_ns)
{
	return lp_ring_pose_age_s(pose, now_ns) <= KEPT_S &&
	       are_apart(&pose->to_panorama, to_panorama);
}

static void take_out(struct lp_ring_poses *poses, int at)
{
	poses->count--;
	memmove(&poses->list[at], &poses->list[at + 1],
		(size_t)(poses->count - at) * sizeof(poses->list[0]));
}

void lp_ring_poses_keep(struct lp_ring_poses *poses, const struct lp_rotation *to_panorama,
			const struct lp_ring_sample *sample)
{
	if (!sample->t_ns)
		return;
	for (int p = poses->count - 1; p >= 0; p--) {
		if (are_apart(&poses->list[p].to_panorama, to_panorama))
			continue;
		if (lp_ring_pose_age_s(&poses->list[p], sample->t_ns) < RENEWED_S)
			return;
		take_out(poses, p);
	}
	if (poses->count == LP_RING_POSES)
		poses->count--;
	memmove(&poses->list[1], &poses->list[0], (size_t)poses->count * sizeof(poses->list[0]));
	poses->list[0] = (struct lp_ring_pose){*to_panorama, *sample};
	poses->count++;
}

void lp_ring_poses_turn(struct lp_ring_poses *poses, const struct lp_rotation *turn)
{
	for (int p = 0; p < poses->count; p++)
		poses->list[p].to_panorama = lp_rotation_product(turn, &poses->list[p].to_panorama);
}

void lp_ring_poses_forget(struct lp_ring_poses *poses)
{
	poses->count = 0;
}
