/* SPDX-License-Identifier: Apache-2.0 */
#include "light/lamps/lamp_memory.h"

#include <math.h>
#include <string.h>

#include "include/light_estimate.h"
#include "light/lamps/lamp_follow.h"

#define RAD ((float)M_PI / 180.0F)
/* What the glow around a clipped lamp does to the middle of what is clipped: 1 sigma. */
#define GLOW_RAD (0.1F * RAD)

static float square(float x)
{
	return x * x;
}

/* The lamp nearest to a sighting of those whose pixels were seen; NULL: none within its gate. */
static const struct lp_remembered_lamp *nearest_by_pixels(const struct lp_lamp_memory *memory,
							  const struct lp_lamp *lamp)
{
	const struct lp_remembered_lamp *found = NULL;
	float best = lp_lamp_gate_rad(lamp);

	for (int p = 0; p < LP_MAX_LAMPS; p++) {
		const struct lp_remembered_lamp *m = &memory->list[p];
		const float apart = lp_lamp_apart_rad(m->lamp.direction, lamp->direction);

		if (m->id && m->by_pixels && apart < best) {
			best = apart;
			found = m;
		}
	}
	return found;
}

int lp_lamp_memory_landmarks(const struct lp_lamp_memory *memory,
			     const struct lp_lamp_sighting *sightings, int count, float sigma_rad,
			     double pull[3], double information[3][3])
{
	int used = 0;

	memset(pull, 0, 3 * sizeof(*pull));
	memset(information, 0, 3 * sizeof(*information));
	for (int k = 0; k < count; k++) {
		const struct lp_lamp *seen = &sightings[k].pixels;
		const struct lp_remembered_lamp *m =
			sightings[k].refined ? nearest_by_pixels(memory, seen) : NULL;
		const float glow = seen->flags & LP_LIGHT_CLIPPED ? GLOW_RAD : 0.0F;

		if (!m)
			continue;
		const float *d = seen->direction, *r = m->lamp.direction;
		const double variance = square(seen->direction_sigma_deg * RAD) + square(glow) +
					m->direction_variance;
		const float apart = lp_lamp_apart_rad(d, r);

		if (square(apart) > square(LP_LAMP_CHANGE_SIGMAS) * (variance + square(sigma_rad)))
			continue;
		used++;
		for (int a = 0; a < 3; a++) {
			const int b = (a + 1) % 3, c = (a + 2) % 3;

			pull[a] += ((double)d[b] * r[c] - (double)d[c] * r[b]) / variance;
			for (int e = 0; e < 3; e++)
				information[a][e] += ((a == e) - (double)d[a] * d[e]) / variance;
		}
	}
	return used;
}
