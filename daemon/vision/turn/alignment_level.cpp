/* SPDX-License-Identifier: Apache-2.0 */
#include "vision/turn/alignment_level.hpp"

#include <algorithm>

extern "C" {
#include "light/turn/shear.h"
}

using cv::v_float32x4;

namespace lp
{

namespace
{

/* Chosen by hand, as those of the header. */
constexpr float kPlace = 0.15F;	     /* 1 sigma, in pixels, of where detail within one lies */
constexpr float kLeastSlope = 0.01F; /* log luminance per pixel: flatter ones say nothing */

} /* namespace */

void level::create(int w, int h)
{
	width = w;
	height = h;
	for (int x = 0; x < w; x++) {
		const double lambda = 2.0 * M_PI * ((x + 0.5) / w - 0.5);

		column_sin.push_back(static_cast<float>(std::sin(lambda)));
		column_cos.push_back(static_cast<float>(std::cos(lambda)));
	}
	for (picture *p : {&seen_raw, &known_raw, &seen, &known, &scratch})
		p->resize(static_cast<size_t>(w) * h);
	table.create(w, h);
	list.resize(static_cast<size_t>(w) * h);
}

namespace
{

/* Weighted mean of three, [1 2 1]; 0 where nothing is known. Offsets are of the first and the last
 * from the one in the middle. */
inline void blend(const picture &from, int at, int before, int after, picture &to)
{
	const float *weight = &from.weight[at], *value = &from.value[at];
	const float a = weight[before], b = 2.0F * weight[0], c = weight[after], all = a + b + c;

	to.value[at] =
		all > 0.0F ? (a * value[before] + b * value[0] + c * value[after]) / all : 0.0F;
	to.weight[at] = 0.25F * all;
}

/* The same for four next to each other. */
inline void blend_four(const picture &from, int at, int before, int after, picture &to)
{
	const float *weight = &from.weight[at], *value = &from.value[at];
	const v_float32x4 zero = cv::v_setzero_f32(), m = cv::v_load(weight);
	const v_float32x4 a = cv::v_load(weight + before), b = m + m;
	const v_float32x4 c = cv::v_load(weight + after), all = a + b + c;
	const v_float32x4 sum = a * cv::v_load(value + before) + b * cv::v_load(value) +
				c * cv::v_load(value + after);

	cv::v_store(&to.value[at], cv::v_select(all > zero, sum / all, zero));
	cv::v_store(&to.weight[at], cv::v_setall_f32(0.25F) * all);
}

} /* namespace */

/* Vectors may reach into the next row, which is written after them. */
void level::smooth(const picture &from, picture &to)
{
	for (int y = 0; y < height; y++) {
		const int row = y * width, last = row + width - 1;

		for (int at = row + 1; at < last; at += 4)
			blend_four(from, at, -1, 1, scratch);
		blend(from, row, width - 1, 1, scratch);
		blend(from, last, -1, 1 - width, scratch);
	}
	for (int y = 0; y < height; y++) {
		const int row = y * width;
		const int up = y ? -width : 0, down = y + 1 < height ? width : 0;

		for (int at = row; at < row + width; at += 4)
			blend_four(scratch, at, up, down, to);
	}
}

void level::prepare(const struct lp_shear &shear)
{
	smooth(seen_raw, seen);
	smooth(known_raw, known);
	table.fill(known);
	collect(shear);
}

void readable::create(int w, int h)
{
	width = w;
	height = h;
	pairs.assign(2 * static_cast<size_t>(w + 2) * h, 0.0F);
}

void readable::fill(const picture &from)
{
	float *pair = pairs.data();

	for (int y = 0; y < height; y++)
		for (int x = -1; x <= width; x++, pair += 2) {
			const int column = x < 0 ? width - 1 : x < width ? x : 0;
			const size_t at = static_cast<size_t>(y) * width + column;

			pair[0] = from.weight[at] * from.value[at];
			pair[1] = from.weight[at];
		}
}

void readable::at(const places &where, v_float32x4 &value, v_float32x4 &weight) const
{
	const v_float32x4 zero = cv::v_setzero_f32();
	const cv::v_int32x4 stride = cv::v_setall_s32(width + 2), left = cv::v_floor(where.column);
	const v_float32x4 y = cv::v_min(cv::v_max(where.row, zero),
					cv::v_setall_f32(static_cast<float>(height - 1)));
	const cv::v_int32x4 top = cv::v_min(cv::v_trunc(y), cv::v_setall_s32(height - 2));
	const v_float32x4 across = where.column - cv::v_cvt_f32(left);
	v_float32x4 between[4], sum_left, known_left, sum_right, known_right;
	int32_t first[4];
	float down[4];

	cv::v_store(first, (top * stride + left + cv::v_setall_s32(1)) << 1);
	cv::v_store(down, y - cv::v_cvt_f32(top));
	for (int k = 0; k < 4; k++) { /* two pairs: of the columns on the left and on the right */
		const float *upper = &pairs[first[k]], *lower = upper + 2 * (width + 2);
		const v_float32x4 above = cv::v_load(upper);

		between[k] = cv::v_fma(cv::v_load(lower) - above, cv::v_setall_f32(down[k]), above);
	}
	cv::v_transpose4x4(between[0], between[1], between[2], between[3], sum_left, known_left,
			   sum_right, known_right);
	const v_float32x4 known = cv::v_fma(known_right - known_left, across, known_left);
	const v_float32x4 enough = known >= cv::v_setall_f32(kEnough);

	value = cv::v_fma(sum_right - sum_left, across, sum_left) /
		cv::v_max(known, cv::v_setall_f32(kEnough));
	weight = cv::v_select(enough, known, zero);
}

void level::collect(const struct lp_shear &shear)
{
	list.count = 0;
	for (int y = 1; y + 1 < height; y++) {
		const double theta = M_PI * (y + 0.5) / height;
		const float st = static_cast<float>(std::sin(theta));
		const float ct = static_cast<float>(std::cos(theta));
		const float per_theta = static_cast<float>(height / M_PI) / 2.0F;
		const float per_lambda = static_cast<float>(width / (2.0 * M_PI)) / (2.0F * st);

		for (int x = y % 2; x < width; x += 2) {
			const int row = y * width, at = row + x;
			const int left = row + (x ? x - 1 : width - 1);
			const int right = row + (x + 1 < width ? x + 1 : 0);
			const float least =
				std::min(std::min(seen.weight[left], seen.weight[right]),
					 std::min(seen.weight[at - width],
						  seen.weight[at + width]));

			if (least < kEnough)
				continue;
			const float gy = seen.value[at + width] - seen.value[at - width];
			const float gx = seen.value[right] - seen.value[left];

			if (gx * gx + gy * gy < 4.0F * kLeastSlope * kLeastSlope)
				continue;
			const float sl = column_sin[x], cl = column_cos[x];
			float d[3] = {st * sl, ct, -st * cl};
			const float g[3] = {ct * sl * gy * per_theta + cl * gx * per_lambda,
					    -st * gy * per_theta,
					    -ct * cl * gy * per_theta + sl * gx * per_lambda};
			const float steep = kPlace / (2.0F * kDetail);
			const float certainty =
				1.0F / std::sqrt(1.0F + steep * steep * (gx * gx + gy * gy));
			const size_t k = list.count++;

			lp_shear_to_middle(&shear, d);
			for (int a = 0; a < 3; a++) {
				list.direction[a][k] = d[a];
				list.slope[a][k] = certainty * (d[(a + 1) % 3] * g[(a + 2) % 3] -
								d[(a + 2) % 3] * g[(a + 1) % 3]);
			}
			list.certainty[k] = certainty;
			list.value[k] = seen.value[at];
			list.weight[k] = st * seen.weight[at];
		}
	}
	for (size_t k = list.count; k < list.count + 4; k++) /* vectors reach beyond the last */
		list.weight[k] = 0.0F;
}

} /* namespace lp */
