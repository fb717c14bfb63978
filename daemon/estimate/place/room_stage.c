/* SPDX-License-Identifier: Apache-2.0 */
#include "estimate/place/room_stage.h"

#include <math.h>
#include <string.h>

#include "include/light_estimate.h"
#include "include/luminance.h"
#include "include/panorama.h"
#include "light/find/detection.h"
#include "light/find/lamps.h"
#include "light/lamps/lamp_memory.h"
#include "light/math/grid.h"
#include "light/place/parallax.h"
#include "light/place/room.h"

/* Samples of a coarse cell, along each of its edges. */
#define SAMPLES 3

/* Direction (world) of a place in a cell of the coarse picture; 0..1 from its upper left corner. */
static void towards_of(int row, int column, double down, double right, double towards[3])
{
	const double polar = M_PI * (row + down) / LP_COARSE_ROWS;
	const double turn = 2.0 * M_PI * ((column + right) / LP_COARSE_COLUMNS - 0.5);

	towards[0] = sin(polar) * sin(turn);
	towards[1] = cos(polar);
	towards[2] = -sin(polar) * cos(turn);
}

/* Mean luminance of the panorama where it has no marks; NAN: there is no such place. */
static float look_at(const struct lp_panorama *panorama, const struct lp_grid *grid,
		     const struct lp_rotation *to_anchor, int cell)
{
	float sum = 0.0F, count = 0.0F;

	for (int k = 0; k < SAMPLES * SAMPLES; k++) {
		double towards[3], turned[3];

		towards_of(cell / LP_COARSE_COLUMNS, cell % LP_COARSE_COLUMNS,
			   (k / SAMPLES + 0.5) / SAMPLES, (k % SAMPLES + 0.5) / SAMPLES, towards);
		lp_rotate(to_anchor, towards, turned);
		const float along[3] = {(float)turned[0], (float)turned[1], (float)turned[2]};
		const int at = lp_grid_cell(grid, along);

		if (panorama->flags[at])
			continue;
		sum += panorama->cells[at][LP_LUMINANCE];
		count += 1.0F;
	}
	return count > 0.0F ? sum / count : NAN;
}

/* What is listed has a place of its own. */
static void take_out(const struct lp_lamp_finder *finder, const struct lp_lamp *lamp,
		     const struct lp_rotation *to_world, const struct lp_grid *coarse, float *cells)
{
	for (int i = 0; i < lamp->count; i++) {
		float towards[3];

		lp_grid_direction(finder->grid, finder->cells[lamp->first + i], towards);
		lp_rotate_direction(to_world, towards);
		cells[lp_grid_cell(coarse, towards)] = NAN;
	}
}

/* A lamp that detection misses in this frame still shines there. */
static void take_out_remembered(const struct lp_remembered_lamp *m,
				const struct lp_rotation *to_world, const struct lp_grid *coarse,
				float *cells)
{
	const float radius_rad =
		sqrtf(m->lamp.solid_angle_sr / (float)M_PI) + (float)M_PI / LP_COARSE_ROWS;
	float lamp[3], towards[3];

	memcpy(lamp, m->lamp.direction, sizeof(lamp));
	lp_rotate_direction(to_world, lamp);
	for (int k = 0; k < LP_COARSE_CELLS; k++) {
		lp_grid_direction(coarse, k, towards);
		if (towards[0] * lamp[0] + towards[1] * lamp[1] + towards[2] * lamp[2] >
		    cosf(fminf(radius_rad, (float)M_PI)))
			cells[k] = NAN;
	}
}

void lp_room_stage_look(struct lp_room *room, const struct lp_panorama *panorama,
			const struct lp_detection *detection, const struct lp_lamp_memory *memory,
			const struct lp_probe_pose *pose)
{
	const struct lp_lamp_finder *finder = detection->finder;
	const struct lp_rotation to_anchor = lp_rotation_inverse(&pose->rotation);
	float cells[LP_COARSE_CELLS], bare[LP_COARSE_CELLS];

	lp_room_work(room);
	if (!lp_room_wants(room, pose))
		return;
	for (int k = 0; k < LP_COARSE_CELLS; k++)
		cells[k] = look_at(panorama, finder->grid, &to_anchor, k);
	memcpy(bare, cells, sizeof(bare));
	for (int k = 0; k < finder->count; k++) {
		const struct lp_lamp *lamp = &finder->lamps[k];

		take_out(finder, lamp, &pose->rotation, lp_room_grid(room), bare);
		if (lp_detection_width_deg(detection, lamp) < LP_COMPACT_DEG)
			take_out(finder, lamp, &pose->rotation, lp_room_grid(room), cells);
	}
	for (int k = 0; k < LP_MAX_LAMPS; k++) {
		const struct lp_remembered_lamp *m = &memory->list[k];

		if (!m->id || m->seen)
			continue;
		take_out_remembered(m, &pose->rotation, lp_room_grid(room), bare);
		if (!m->wide)
			take_out_remembered(m, &pose->rotation, lp_room_grid(room), cells);
	}
	lp_room_see(room, pose, cells, bare);
}

void lp_room_stage_tell(const struct lp_room *room, const struct lp_probe_pose *pose,
			struct lp_estimate_room *told)
{
	const struct lp_rotation to_anchor = lp_rotation_inverse(&pose->rotation);
	struct lp_room_found found;
	double xyzw[4];

	*told = (struct lp_estimate_room){0};
	if (!lp_room_found(room, pose, &found))
		return;
	const struct lp_rotation yaw =
		lp_rotation_of_vector((const double[3]){0.0, found.box.yaw_rad, 0.0});
	const struct lp_rotation turn = lp_rotation_product(&to_anchor, &yaw);

	told->known = true;
	lp_rotation_quaternion(&turn, xyzw);
	for (int i = 0; i < 4; i++)
		told->xyzw[i] = (float)xyzw[i];
	for (int w = 0; w < 6; w++) {
		told->walls_m[w] = (float)found.box.wall_m[w];
		told->walls_sigma_m[w] = (float)found.wall_sigma_m[w];
	}
	for (int order = 0; order <= LP_MAX_SH_ORDER; order++) {
		told->error_per_m[order] = (float)found.error_per_m[order];
		told->bare_error_per_m[order] = (float)found.bare_error_per_m[order];
	}
}
