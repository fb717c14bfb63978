/* SPDX-License-Identifier: Apache-2.0 */
/* What falls on the ring: sums of max(0, cosine) over the panorama. */
#include <math.h>
#include <stddef.h>

#include "include/panorama.h"
#include "light/clipped/ring_fusion.h"
#include "light/math/grid.h"
#include "light/math/rotation.h"

/* Sums in vectors of four. */
#define LANES 12

void lp_ring_direction(int sensor, float direction[3])
{
	const double azimuth = M_PI / 4.0 * sensor;
	const bool up = sensor == LP_RING_SENSORS - 1;

	direction[0] = up ? 0.0F : (float)cos(azimuth);
	direction[1] = up ? 1.0F : 0.0F;
	direction[2] = up ? 0.0F : (float)sin(azimuth);
}

void lp_ring_looks_along(const struct lp_ring_sample *sample, int sensor, float direction[3])
{
	const bool up = sensor == LP_RING_SENSORS - 1;
	const float *seat = sample->seat[sensor];
	float forward[3], length = 0.0F;

	lp_ring_direction(sensor, forward);
	/* right = forward x up; the one on top has +X to its right, and +Z up */
	const float right[3] = {up ? 1.0F : -forward[2], 0.0F, up ? 0.0F : forward[0]};
	const float upward[3] = {0.0F, up ? 0.0F : 1.0F, up ? 1.0F : 0.0F};

	for (int a = 0; a < 3; a++) {
		direction[a] = forward[a] + seat[0] * right[a] + seat[1] * upward[a];
		length += direction[a] * direction[a];
	}
	for (int a = 0; a < 3; a++)
		direction[a] /= sqrtf(length);
}

static void add_row(const float (*cells)[4], const struct lp_grid *grid, int row, int channel,
		    const float (*normals)[3], float sum[LANES])
{
	float up[LANES] = {0.0F}, x[LANES] = {0.0F}, z[LANES] = {0.0F};

	for (int k = 0; k < LP_RING_SENSORS; k++) {
		up[k] = normals[k][1] * grid->row_cos[row];
		x[k] = normals[k][0] * grid->row_sin[row];
		z[k] = -normals[k][2] * grid->row_sin[row];
	}
	for (int c = 0; c < grid->width; c++) {
		const float light = cells[c][channel];
		const float sine = grid->column_sin[c], cosine = grid->column_cos[c];

		for (int k = 0; k < LANES; k++) {
			const float weight = up[k] + x[k] * sine + z[k] * cosine;

			sum[k] += (weight > 0.0F ? weight : 0.0F) * light;
		}
	}
}

static void look_at_part(const struct lp_clipped_parts *parts, const struct lp_clipped_part *from,
			 int channel, const float (*normals)[3], struct lp_ring_part *part)
{
	double mean[LP_RING_SENSORS] = {0.0}, square[LP_RING_SENSORS] = {0.0}, total = 0.0;

	for (int i = from->first; i < from->first + from->count; i++) {
		const double omega = lp_grid_solid_angle_sr(parts->grid, parts->cells[i]);
		float d[3];

		lp_grid_direction(parts->grid, parts->cells[i], d);
		total += omega;
		for (int k = 0; k < LP_RING_SENSORS; k++) {
			const double cosine = (double)d[0] * normals[k][0] +
					      (double)d[1] * normals[k][1] +
					      (double)d[2] * normals[k][2];
			const double weight = cosine > 0.0 ? cosine : 0.0;

			mean[k] += omega * weight;
			square[k] += omega * weight * weight;
		}
	}
	part->bound = from->bound[channel];
	for (int k = 0; k < LP_RING_SENSORS; k++) {
		const double weight = mean[k] / total;

		part->weight[k] = (float)weight;
		part->spread[k] = (float)sqrt(fmax(square[k] / total - weight * weight, 0.0));
	}
}

void lp_ring_view_init(struct lp_ring_view *view, const struct lp_grid *grid,
		       const struct lp_panorama *panorama, const struct lp_clipped_parts *parts,
		       const struct lp_rotation *to_panorama, const struct lp_ring_sample *sample,
		       int channel)
{
	float normals[LP_RING_SENSORS][3];
	double seen[LP_RING_SENSORS] = {0.0};

	for (int k = 0; k < LP_RING_SENSORS; k++) {
		lp_ring_looks_along(sample, k, normals[k]);
		lp_rotate_direction(to_panorama, normals[k]);
	}
	for (int r = 0; r < grid->height; r++) {
		float sum[LANES] = {0.0F};

		add_row((const float(*)[4])panorama->cells + (size_t)r * grid->width, grid, r,
			channel, (const float(*)[3])normals, sum);
		for (int k = 0; k < LP_RING_SENSORS; k++)
			seen[k] += (double)sum[k] * grid->row_solid_angle_sr[r];
	}
	for (int k = 0; k < LP_RING_SENSORS; k++)
		view->seen[k] = (float)seen[k];
	view->count = parts->count;
	for (int j = 0; j < parts->count; j++)
		look_at_part(parts, &parts->list[j], channel, (const float(*)[3])normals,
			     &view->parts[j]);
}
