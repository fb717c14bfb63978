/* SPDX-License-Identifier: Apache-2.0 */
/* How an observation corrects the cells of the map, four at a time: included by radiance_map.cpp
 * alone. */
#ifndef LP_VISION_MAP_RADIANCE_MAP_CELLS_HPP
#define LP_VISION_MAP_RADIANCE_MAP_CELLS_HPP

#include <algorithm>
#include <cmath>
#include <cstring>

#include "include/luminance.h"
#include "include/panorama.h"
#include "vision/camera/response.h"
#include "vision/map/radiance_map.h"
#include "vision/picture/simd.hpp"

using cv::v_float32x4;

namespace
{

/* Chosen by hand, on the scenes of docs/users/accuracy.md, "While the camera turns". */

/* Random walk of a cell's radiance, relative, per root second. */
constexpr float kWalk = 0.1F;
/* Response and exposure of a camera: relative 1 sigma that more frames do not lessen. */
constexpr float kCameraSigma = 0.03F;
/* Sigmas beyond which an observation is a change of light. */
constexpr float kGate = 5.0F;
/* While the camera turns: how much the rest of the light may have changed, 1 sigma of each cell's:
 * so many times the share that has, and at most. */
constexpr float kElsewhere = 4.0F, kMostElsewhere = 0.5F;
/* Sigmas beyond which a lower bound contradicts a known radiance. */
constexpr float kBoundGate = 3.0F;
/* Relative 1 sigma of a known radiance that is old: any lower bound above it contradicts it,
 * because the frame that shows the cell clipped is newer than those that did not. */
constexpr float kVague = 0.2F;
/* A lower bound that is higher than a known radiance by this share of it contradicts it, too: a
 * lamp comes into a dark cell, even where its place is not known well. */
constexpr float kFarBrighter = 1.0F;
/* Codes cannot be negative, so that the darkest are too bright on average: below kDark (the root of
 * the linear value, in 255ths) up to so many more codes of sigma. */
constexpr float kDark = 12.0F;
constexpr float kDarkCodes = 2.0F;
/* A cell that is darker than this share of full scale holds no clipped pixel, of 64. */
constexpr float kNoneClipped = 0.01F;
/* What neighbours say of a cell's light: relative 1 sigma. */
constexpr float kFilledSigma = 0.3F;
/* Beside a clipped cell, light below this share of what is known is a change: where the lamp falls
 * within its own cell makes less of a difference. */
constexpr float kFarDarker = 0.25F;
/* In the mean of a cell of middle brightness, clipped pixels do not show if they are few: up to an
 * eighth of them. So a cell that a shorter exposure has found clipped, but below this share of full
 * scale, is not darker because a longer exposure says so... */
constexpr float kFewClipped = 0.25F;
/* ...but each time that it does, the shorter exposure counts so much less. */
constexpr float kFade = 0.8F;

constexpr float kKnown = 0.1F * LP_VARIANCE_UNKNOWN;

/* Four cells, a vector per channel: R, G, B, luminance. */
struct four_cells {
	v_float32x4 channel[4];

	explicit four_cells(const float (*radiance)[4])
	{
		cv::v_load_deinterleave(radiance[0], channel[0], channel[1], channel[2],
					channel[3]);
	}

	void store(float (*radiance)[4]) const
	{
		cv::v_store_interleave(radiance[0], channel[0], channel[1], channel[2], channel[3]);
	}
};

/* All bits set where the flag is. */
v_float32x4 mask_of(const cv::v_int32x4 &flags, int flag)
{
	const cv::v_int32x4 bit = cv::v_setall_s32(flag);

	return cv::v_reinterpret_as_f32((flags & bit) == bit);
}

cv::v_int32x4 load_flags(const uint8_t *flags)
{
	return cv::v_reinterpret_as_s32(cv::v_load_expand_q(flags));
}

/* Variance of what is observed of four cells. */
class noise_model
{
	bool coded;
	float of_code[256]; /* of rounding and noise, by the root of the linear value */
	const float *place_variance, *veil, *veil_variance;
	v_float32x4 full, relative2;

      public:
	explicit noise_model(const struct lp_observation &seen)
	    : coded(seen.coded), place_variance(seen.place_variance), veil(seen.veil),
	      veil_variance(seen.veil_variance), full(cv::v_setall_f32(1.0F / seen.scale)),
	      relative2(cv::v_setall_f32(kCameraSigma * kCameraSigma +
					 seen.flicker_sigma * seen.flicker_sigma +
					 kWalk * kWalk * seen.late_s))
	{
		for (auto code = 0; coded && code < 256; code++) {
			const float dark = kDarkCodes *
					   std::max(1.0F - static_cast<float>(code) / kDark, 0.0F);

			of_code[code] = (dark * dark + seen.code_variance) * seen.scale *
					seen.scale / seen.response->weight[code];
		}
	}

	v_float32x4 of(const v_float32x4 &luminance, size_t i) const
	{
		const v_float32x4 zero = cv::v_setzero_f32(), one = cv::v_setall_f32(1.0F);
		v_float32x4 variance = zero;

		if (coded) {
			const v_float32x4 linear =
				cv::v_min(cv::v_max((veil ? luminance + cv::v_load(veil + i)
							  : luminance) *
							    full,
						    zero),
					  one);
			const v_float32x4 root = cv::v_sqrt(linear) * cv::v_setall_f32(255.0F);

			variance = cv::v_fma(relative2, luminance * luminance,
					     cv::v_lut(of_code, cv::v_trunc(root)));
		}
		if (place_variance)
			variance = variance + cv::v_load(place_variance + i);
		if (veil_variance)
			variance = variance + cv::v_load(veil_variance + i);
		return variance;
	}
};

/* Sums over the sphere, each cell by its solid angle. */
struct sums {
	double changed, all, clipped, clipped_light, unseen, filled, variance;
};

struct row_sums {
	v_float32x4 changed = cv::v_setzero_f32(), all = cv::v_setzero_f32(),
		    variance = cv::v_setzero_f32(), clipped = cv::v_setzero_f32(),
		    clipped_light = cv::v_setzero_f32(), unseen = cv::v_setzero_f32(),
		    filled = cv::v_setzero_f32();

	void add_to(sums &total, double solid_angle_sr) const
	{
		total.changed += cv::v_reduce_sum(changed) * solid_angle_sr;
		total.all += cv::v_reduce_sum(all) * solid_angle_sr;
		total.clipped += cv::v_reduce_sum(clipped) * solid_angle_sr;
		total.clipped_light += cv::v_reduce_sum(clipped_light) * solid_angle_sr;
		total.unseen += cv::v_reduce_sum(unseen) * solid_angle_sr;
		total.filled += cv::v_reduce_sum(filled) * solid_angle_sr;
		total.variance += cv::v_reduce_sum(variance) * solid_angle_sr * solid_angle_sr;
	}
};

/* Changes of a cell that follow each other faster than this are one. */
constexpr double kOneChangeS = 0.5;

/* Keep what four cells hold, those that change. */
void remember(struct lp_radiance_map *map, size_t i, const v_float32x4 &changes)
{
	const int changing = cv::v_signmask(changes);

	for (auto k = 0; k < 4; k++) {
		struct lp_cell_before &before = map->before[i + k];

		if (!(changing >> k & 1) ||
		    (before.t_s >= 0.0 && map->t_s - before.t_s < kOneChangeS))
			continue;
		std::memcpy(before.radiance, map->radiance[i + k], sizeof(before.radiance));
		before.variance = map->variance[i + k];
		before.bound_scale = map->bound_scale[i + k];
		before.flags = map->flags[i + k];
		before.t_s = map->remembered_s = map->t_s;
	}
}

/* What four measured cells say to what is known of them with variance `before`. */
struct lesson {
	v_float32x4 both, difference, contradicts, gain, variance;

	lesson(const v_float32x4 &light, const v_float32x4 &held, const v_float32x4 &before,
	       const v_float32x4 &observed)
	{
		both = cv::v_max(before + observed, cv::v_setall_f32(1e-36F));
		difference = light - held;
		contradicts = difference * difference > cv::v_setall_f32(kGate * kGate) * both;
		gain = cv::v_setall_f32(1.0F) -
		       cv::v_select(contradicts, cv::v_setzero_f32(), observed / both);
		variance = gain * observed;
	}
};

/* A frame's exposure beside the shortest ones that have shown four cells clipped lately. */
struct clipping {
	v_float32x4 scale, held, shorter, longer;

	clipping(const struct lp_radiance_map *map, const struct lp_observation *seen, size_t i)
	{
		const v_float32x4 same = cv::v_setall_f32(LP_SAME_EXPOSURE);

		scale = cv::v_setall_f32(seen->scale);
		held = cv::v_load(map->bound_scale + i);
		shorter = scale > held * same;
		longer = scale * same < held;
	}

	/* Whether clipped pixels may hide in the mean of a cell that was known as brighter. */
	v_float32x4 hides(const v_float32x4 &light, const v_float32x4 &known) const
	{
		return longer & (light >= scale * cv::v_setall_f32(kNoneClipped)) &
		       (known < held * cv::v_setall_f32(kFewClipped));
	}

	/* Keep what this frame, where it counts, says of it: `clipped`, beyond what was known
	 * (`refuted`), or `hidden`. */
	void store(struct lp_radiance_map *map, size_t i, const v_float32x4 &counts,
		   const v_float32x4 &clipped, const v_float32x4 &refuted,
		   const v_float32x4 &hidden) const
	{
		const v_float32x4 zero = cv::v_setzero_f32();
		const v_float32x4 plain = counts & (clipped == zero);
		v_float32x4 next =
			cv::v_select(counts & clipped,
				     cv::v_select(refuted, scale, cv::v_max(held, scale)), held);

		next = cv::v_select(plain & (shorter == zero) & (longer == zero), zero, next);
		next = cv::v_select(hidden, held * cv::v_setall_f32(kFade), next);
		cv::v_store(map->bound_scale + i, next);
	}
};

/* Move `cell` towards what is seen now; a gain of 1 takes it to the bit, whatever it was before. */
void move(four_cells &cell, const four_cells &now, const v_float32x4 &gain)
{
	const v_float32x4 whole = gain == cv::v_setall_f32(1.0F);

	for (auto c = 0; c < 4; c++)
		cell.channel[c] = cv::v_select(whole, now.channel[c],
					       cv::v_fma(now.channel[c] - cell.channel[c], gain,
							 cell.channel[c]));
}

/* Luminance of four cells. */
v_float32x4 luminance_of(const float (*radiance)[4])
{
	return four_cells(radiance).channel[LP_LUMINANCE];
}

/* Four cells of the map that are known, seen without any mark, and not contradicted: nearly all
 * there are. False: they are not like that, and nothing has been done. */
bool correct_plain(struct lp_radiance_map *map, const struct lp_observation *seen,
		   const noise_model &noise, const v_float32x4 &walk, size_t i, row_sums &sum)
{
	uint32_t known, marks;

	std::memcpy(&known, map->flags + i, sizeof(known));
	std::memcpy(&marks, seen->flags + i, sizeof(marks));
	if (known | marks)
		return false;
	const float(*now)[4] = seen->radiance + i;
	float(*cells)[4] = map->radiance + i;
	const v_float32x4 light = luminance_of(now), held = luminance_of(cells);
	const v_float32x4 before = cv::v_fma(walk, held * held, cv::v_load(map->variance + i));
	const lesson learned(light, held, before, noise.of(light, i));
	float gain[4];

	if (cv::v_check_any(learned.gain == cv::v_setall_f32(1.0F)))
		return false;
	cv::v_store(gain, learned.gain);
	for (auto k = 0; k < 4; k++) {
		const v_float32x4 cell = cv::v_load(cells[k]);

		cv::v_store(cells[k],
			    cv::v_fma(cv::v_load(now[k]) - cell, cv::v_setall_f32(gain[k]), cell));
	}
	cv::v_store(map->variance + i, learned.variance);
	sum.all = sum.all + cv::v_fma(learned.difference, learned.gain, held);
	sum.variance = sum.variance + learned.variance;
	return true;
}

/* Correct four cells from `i` on, whatever is known and seen of them. Seldom called: inlined, it
 * would take the registers of those that are plain. */
[[gnu::noinline]] void correct(struct lp_radiance_map *map, const struct lp_observation *seen,
			       const noise_model &noise, const v_float32x4 &walk, bool unsettled,
			       size_t i, row_sums &sum)
{
	const v_float32x4 zero = cv::v_setzero_f32(), one = cv::v_setall_f32(1.0F);
	const v_float32x4 unknown = cv::v_setall_f32(LP_VARIANCE_UNKNOWN);
	const four_cells now(seen->radiance + i);
	four_cells cell(map->radiance + i);
	const v_float32x4 light = now.channel[LP_LUMINANCE], held = cell.channel[LP_LUMINANCE];
	const cv::v_int32x4 seen_flags = load_flags(seen->flags + i);
	cv::v_int32x4 flags = load_flags(map->flags + i);
	const v_float32x4 beside = mask_of(seen_flags, LP_CELL_BESIDE);
	const v_float32x4 fresh = mask_of(flags, LP_CELL_UNSEEN);
	/* beside a clipped cell nothing is learned, but of a cell of which nothing is known */
	const v_float32x4 seen_is_clipped = mask_of(seen_flags, LP_CELL_CLIPPED);
	const v_float32x4 clipped = seen_is_clipped | (beside & fresh);
	const v_float32x4 before =
		cv::v_min(cv::v_fma(walk, held * held, cv::v_load(map->variance + i)), unknown);
	const v_float32x4 known = before < cv::v_setall_f32(kKnown);
	const v_float32x4 filled = mask_of(seen_flags, LP_CELL_FILLED);
	const v_float32x4 observed =
		cv::v_select(filled, cv::v_setall_f32(kFilledSigma * kFilledSigma) * light * light,
			     noise.of(light, i));
	const lesson learned(light, held, before, observed);
	/* what neighbours say replaces what is less certain, and adds nothing to what is more: the
	 * next frame would say the same again */
	const v_float32x4 replaced =
		filled & (seen_is_clipped == zero) &
		(fresh |
		 (known & (before > cv::v_setall_f32(kFilledSigma * kFilledSigma) * held * held)));
	const v_float32x4 difference = learned.difference;
	/* ...and that a cell is far darker than was known: a neighbour's light only adds to it.
	 * Else what a misplaced frame has left beside a lamp would stay */
	const v_float32x4 darker = (learned.contradicts | mask_of(flags, LP_CELL_CLIPPED)) &
				   (light < held * cv::v_setall_f32(kFarDarker)) &
				   (light < cv::v_setall_f32(kNoneClipped * seen->scale)) &
				   (mask_of(seen_flags, LP_CELL_BESIDE_DARK) == zero);
	v_float32x4 gain = learned.gain, variance = learned.variance;
	/* a lower bound of a known cell, or one more of a cell that has only been seen clipped */
	const v_float32x4 above = difference > zero;
	const v_float32x4 vague = before > cv::v_setall_f32(kVague * kVague) * held * held;
	const v_float32x4 bound = mask_of(flags, LP_CELL_CLIPPED);
	const clipping bounds(map, seen, i);
	/* a longer exposure clips in more cells, and shorter ones tell what they hold */
	const v_float32x4 shortest = cv::v_setall_f32(seen->longer ? 1.0F : 0.0F) == zero;
	const v_float32x4 known_is_refuted =
		(shortest & (vague | (difference > held * cv::v_setall_f32(kFarBrighter)))) |
		(difference * difference >
		 cv::v_setall_f32(kBoundGate * kBoundGate) * learned.both);
	const v_float32x4 refuted =
		cv::v_select(known, above & known_is_refuted,
			     mask_of(flags, LP_CELL_UNSEEN) |
				     (bound & (bounds.shorter | (bounds.longer & above))));
	const v_float32x4 below =
		(difference < zero) &
		cv::v_select(known, learned.contradicts,
			     difference * difference >
				     cv::v_setall_f32(kBoundGate * kBoundGate) * observed);
	const v_float32x4 hidden = bounds.hides(light, held) & below & (seen_is_clipped == zero) &
				   (cv::v_setall_f32(unsettled ? 1.0F : 0.0F) == zero) &
				   (fresh == zero);
	const v_float32x4 changed =
		cv::v_select(filled, zero,
			     known & cv::v_select(clipped, refuted, learned.contradicts));
	const v_float32x4 overruled = changed & (cv::v_setall_f32(seen->late_s) > zero);
	const v_float32x4 missing = mask_of(seen_flags, LP_CELL_UNSEEN) |
				    mask_of(seen_flags, LP_CELL_COVERED) |
				    (beside & (fresh == zero) & (darker == zero)) | overruled |
				    hidden | (filled & (replaced == zero) & (fresh == zero));
	const v_float32x4 mean = bound & (refuted == zero) & (bounds.longer == zero);
	/* a bound that misplaced frames may explain moves a known cell as any observation does */
	const v_float32x4 bound_gain =
		cv::v_select(refuted, one,
			     cv::v_select(known & above, learned.gain,
					  cv::v_select(mean, cv::v_setall_f32(0.5F), zero)));

	gain = cv::v_select(clipped, bound_gain, gain);
	variance = cv::v_select(clipped, cv::v_select(refuted, unknown, before), variance);
	gain = cv::v_select(missing, zero, cv::v_select(replaced, one, gain));
	variance = cv::v_select(missing, before, cv::v_select(replaced, observed, variance));

	if (unsettled)
		remember(map, i, known & (missing == zero));
	else if (cv::v_check_any(changed & (missing == zero)))
		remember(map, i, changed & (missing == zero));
	move(cell, now, gain);

	const cv::v_int32x4 kept = cv::v_reinterpret_as_s32(
		missing | (clipped & (cv::v_reinterpret_as_f32(cv::v_setall_s32(-1)) ^ refuted)));
	const cv::v_int32x4 marks =
		cv::v_reinterpret_as_s32(clipped) & cv::v_setall_s32(LP_CELL_CLIPPED);

	flags = cv::v_select(kept, flags, marks);
	cell.store(map->radiance + i);
	cv::v_store(map->variance + i, variance);
	bounds.store(map, i, missing == zero, clipped, refuted, hidden);
	for (auto k = 0; k < 4; k++) {
		int32_t four[4];

		cv::v_store(four, flags);
		map->flags[i + k] = static_cast<uint8_t>(four[k]);
	}
	sum.changed = sum.changed +
		      cv::v_select(changed & (missing == zero), cv::v_abs(difference), zero);
	sum.all = sum.all + cell.channel[LP_LUMINANCE];
	sum.variance =
		sum.variance + cv::v_select(variance < cv::v_setall_f32(kKnown), variance, zero);
	sum.clipped = sum.clipped + cv::v_select(mask_of(flags, LP_CELL_CLIPPED), one, zero);
	sum.clipped_light = sum.clipped_light + cv::v_select(mask_of(flags, LP_CELL_CLIPPED),
							     cell.channel[LP_LUMINANCE], zero);
	sum.unseen = sum.unseen + cv::v_select(mask_of(flags, LP_CELL_UNSEEN), one, zero);
	sum.filled = sum.filled + cv::v_select(replaced & (missing == zero), one, zero);
}

} /* namespace */

#endif
