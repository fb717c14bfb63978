/* SPDX-License-Identifier: Apache-2.0 */
#include "vision/map/radiance_map.h"

#include <cerrno>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <utility>

#include "include/panorama.h"
#include "vision/map/lookup.h"
#include "vision/map/radiance_map_cells.hpp"
#include "vision/picture/simd.hpp"

extern "C" {
#include "light/math/grid.h"
}

namespace
{

/* Sigmas beyond which an observation is a change of light, where only the number of such cells
 * counts; and every so many rows are looked at. */
constexpr float kSlightGate = 3.0F;
constexpr int kSampledRows = 4;

constexpr double kSphereSr = 4.0 * M_PI;

float share_of(double part, const sums &total)
{
	return static_cast<float>(total.all > 0.0 ? part / total.all : 0.0);
}

/* Correct all cells, of whose light `walk` is the relative variance of a change since the
 * observation before. */
sums learn(struct lp_radiance_map *map, const struct lp_observation *seen, const noise_model &noise,
	   float walk, bool unsettled)
{
	const struct lp_grid *grid = map->grid;
	const v_float32x4 walks = cv::v_setall_f32(walk);
	sums total = {};

	for (int r = 0; r < grid->height; r++) {
		row_sums row;

		for (int c = 0; c < grid->width; c += 4) {
			const size_t i = static_cast<size_t>(r) * grid->width + c;

			if (unsettled || !correct_plain(map, seen, noise, walks, i, row))
				correct(map, seen, noise, walks, unsettled, i, row);
		}
		row.add_to(total, grid->row_solid_angle_sr[r]);
	}
	return total;
}

/*
 * Relative variance of a change of all light, by the cells that the observation has not
 * contradicted: a lamp that is switched lights those, too; who walks by leaves them as they are.
 * Each counts by what it tells: the maximum of likelihood, of Gaussian differences. Negative: they
 * differ by less than they may; NAN: there are none.
 * The map has learned from the observation already, so a difference is what is left of it.
 */
double change_elsewhere(const struct lp_radiance_map *map, const struct lp_observation *seen,
			const noise_model &noise)
{
	constexpr float kLeft = 0.01F; /* less of a difference is left where it was contradicted */
	const struct lp_grid *grid = map->grid;
	const v_float32x4 zero = cv::v_setzero_f32(), one = cv::v_setall_f32(1.0F);
	double excess = 0.0, told = 0.0;

	for (int r = 0; r < grid->height; r++) {
		v_float32x4 row_excess = zero, row_told = zero;

		for (int c = 0; c < grid->width; c += 4) {
			const size_t i = static_cast<size_t>(r) * grid->width + c;
			const v_float32x4 light = luminance_of(seen->radiance + i);
			const v_float32x4 held = luminance_of(map->radiance + i);
			const v_float32x4 observed =
				cv::v_max(noise.of(light, i), cv::v_setall_f32(1e-36F));
			const v_float32x4 left = one - cv::v_load(map->variance + i) / observed;
			const v_float32x4 counts =
				(left > cv::v_setall_f32(kLeft)) &
				cv::v_reinterpret_as_f32((load_flags(seen->flags + i) |
							  load_flags(map->flags + i)) ==
							 cv::v_setzero_s32());
			const v_float32x4 share = cv::v_select(counts, left, one);
			const v_float32x4 both = observed / share;
			const v_float32x4 difference = (light - held) / share;
			const v_float32x4 ratio = held * held / both;

			row_excess =
				row_excess +
				cv::v_select(counts, ratio * (difference * difference / both - one),
					     zero);
			row_told = row_told + cv::v_select(counts, ratio * ratio, zero);
		}
		excess += cv::v_reduce_sum(row_excess) * grid->row_solid_angle_sr[r];
		told += cv::v_reduce_sum(row_told) * grid->row_solid_angle_sr[r];
	}
	return told > 0.0 ? excess / told : NAN;
}

template <typename T> bool allocate(T *&storage, size_t count)
{
	storage = static_cast<T *>(std::calloc(count, sizeof(T)));
	return storage != nullptr;
}

} /* namespace */

extern "C" void lp_radiance_map_destroy(struct lp_radiance_map *map)
{
	if (!map)
		return;
	std::free(map->before);
	std::free(map->turned_scale);
	std::free(map->turned_flags);
	std::free(map->turned_variance);
	std::free(map->turned);
	std::free(map->bound_scale);
	std::free(map->flags);
	std::free(map->variance);
	std::free(map->radiance);
	std::free(map);
}

extern "C" int lp_radiance_map_create(const struct lp_grid *grid, struct lp_radiance_map **map)
{
	/* vector loads may touch the cells beyond the last */
	const size_t cells = static_cast<size_t>(grid->width) * grid->height + 16;
	struct lp_radiance_map *m;

	if (!allocate(m, 1))
		return -ENOMEM;
	m->grid = grid;
	if (!allocate(m->radiance, cells) || !allocate(m->variance, cells) ||
	    !allocate(m->flags, cells) || !allocate(m->turned, cells) ||
	    !allocate(m->turned_variance, cells) || !allocate(m->turned_flags, cells) ||
	    !allocate(m->bound_scale, cells) || !allocate(m->turned_scale, cells) ||
	    !allocate(m->before, cells)) {
		lp_radiance_map_destroy(m);
		return -ENOMEM;
	}
	lp_radiance_map_forget(m);
	*map = m;
	return 0;
}

extern "C" void lp_radiance_map_forget_cell(struct lp_radiance_map *map, int cell)
{
	std::memset(map->radiance[cell], 0, sizeof(*map->radiance));
	map->flags[cell] = LP_CELL_UNSEEN;
	map->variance[cell] = LP_VARIANCE_UNKNOWN;
	map->bound_scale[cell] = 0.0F;
	map->before[cell].t_s = -1.0;
}

extern "C" void lp_radiance_map_forget(struct lp_radiance_map *map)
{
	for (int i = 0; i < map->grid->width * map->grid->height; i++)
		lp_radiance_map_forget_cell(map, i);
	map->remembered_s = -1.0;
}

extern "C" struct lp_map_update lp_radiance_map_observe(struct lp_radiance_map *map,
							const struct lp_observation *observation)
{
	map->t_s += observation->elapsed_s;
	const noise_model noise(*observation);
	sums total = learn(map, observation, noise, kWalk * kWalk * observation->elapsed_s, false);
	const float changed = share_of(total.changed, total);
	bool unsettled = changed > LP_MUCH_CHANGED;
	float walk = std::pow(std::min(kElsewhere * changed, kMostElsewhere), 2.0F);

	/* while the camera turns, where a cell looks is uncertain, and hides what the others tell
	 */
	if (unsettled && !observation->place_variance) {
		const double elsewhere = change_elsewhere(map, observation, noise);

		unsettled = !(elsewhere <= 0.0);
		walk = elsewhere > 0.0 ? static_cast<float>(elsewhere) : 0.0F;
	}
	if (unsettled)
		total = learn(map, observation, noise, walk, true);
	/* The mean of max(0, cos)^2 over all normals is 1/6; mean irradiance is a quarter of the
	 * flux. */
	return {changed,
		unsettled,
		static_cast<float>(total.clipped / kSphereSr),
		static_cast<float>(total.unseen / kSphereSr),
		static_cast<float>(total.filled / kSphereSr),
		share_of(4.0 * std::sqrt(total.variance / 6.0), total),
		share_of(total.clipped_light, total)};
}

extern "C" float lp_radiance_map_contradicting(const struct lp_radiance_map *map,
					       const struct lp_observation *observation)
{
	const struct lp_grid *grid = map->grid;
	const noise_model noise(*observation);
	const v_float32x4 zero = cv::v_setzero_f32(), one = cv::v_setall_f32(1.0F);
	double contradicting = 0.0, compared = 0.0;

	for (int r = kSampledRows / 2; r < grid->height; r += kSampledRows) {
		v_float32x4 row_contradicting = zero, row_compared = zero;

		for (int c = 0; c < grid->width; c += 4) {
			const size_t i = static_cast<size_t>(r) * grid->width + c;
			const v_float32x4 light = luminance_of(observation->radiance + i);
			const v_float32x4 held = luminance_of(map->radiance + i);
			const v_float32x4 variance = cv::v_load(map->variance + i);
			const v_float32x4 marked = cv::v_reinterpret_as_f32(
				load_flags(observation->flags + i) == cv::v_setzero_s32());
			const v_float32x4 known = marked & (variance < cv::v_setall_f32(kKnown));
			const v_float32x4 limit = cv::v_setall_f32(kSlightGate * kSlightGate) *
						  (variance + noise.of(light, i));
			const v_float32x4 difference = light - held;

			row_compared = row_compared + cv::v_select(known, one, zero);
			row_contradicting =
				row_contradicting +
				cv::v_select(known & (difference * difference > limit), one, zero);
		}
		compared += cv::v_reduce_sum(row_compared) * grid->row_solid_angle_sr[r];
		contradicting += cv::v_reduce_sum(row_contradicting) * grid->row_solid_angle_sr[r];
	}
	return static_cast<float>(compared > 0.0 ? contradicting / compared : 0.0);
}

extern "C" const float *lp_radiance_map_before(const struct lp_radiance_map *map, int cell,
					       double most_s)
{
	/* nothing has changed, nearly always: then the cells before are not worth a look */
	if (map->remembered_s < 0.0 || map->t_s - map->remembered_s > most_s)
		return map->radiance[cell];
	const struct lp_cell_before &before = map->before[cell];

	return before.t_s < 0.0 || map->t_s - before.t_s > most_s ? map->radiance[cell]
								  : before.radiance;
}

extern "C" void lp_radiance_map_restore(struct lp_radiance_map *map, int cell, double most_s)
{
	struct lp_cell_before &before = map->before[cell];

	if (before.t_s < 0.0 || map->t_s - before.t_s > most_s)
		return;
	std::memcpy(map->radiance[cell], before.radiance, sizeof(before.radiance));
	map->variance[cell] = before.variance;
	map->bound_scale[cell] = before.bound_scale;
	map->flags[cell] = before.flags;
	before.t_s = -1.0;
}

extern "C" void lp_radiance_map_turn(struct lp_radiance_map *map, struct lp_lookup *lookup,
				     const struct lp_rotation *rotation)
{
	/* what lies between cells is known the less, the more they differ */
	constexpr float kPlace = 0.05F;
	const int cells = map->grid->width * map->grid->height;
	float *step2 = lookup->across; /* read before it is written, cell by cell */

	lp_lookup_set(lookup, rotation);
	lp_lookup_marks(lookup, map->flags, map->turned_flags);
	lp_lookup_largest(lookup, map->variance, map->turned_variance);
	lp_lookup_largest(lookup, map->bound_scale, map->turned_scale);
	lp_lookup_radiance(lookup, map->radiance, map->turned, step2);
	for (int i = 0; i < cells; i++)
		map->variance[i] = map->turned_variance[i] >= kKnown
					   ? LP_VARIANCE_UNKNOWN
					   : map->turned_variance[i] + kPlace * step2[i];
	std::swap(map->radiance, map->turned);
	std::swap(map->flags, map->turned_flags);
	std::swap(map->bound_scale, map->turned_scale);
	for (int i = 0; i < cells; i++)
		map->flags[i] &= static_cast<uint8_t>(
			~(LP_CELL_BESIDE | LP_CELL_BESIDE_DARK | LP_CELL_COVERED));
	for (int i = 0; i < cells; i++) /* cells lie elsewhere now */
		map->before[i].t_s = -1.0;
	map->remembered_s = -1.0;
}
