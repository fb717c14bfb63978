/* SPDX-License-Identifier: Apache-2.0 */
#include "vision/map/cube_sample.h"

#include <algorithm>
#include <cmath>

#include "light/send/cube.h"
#include "vision/map/sphere.hpp"

extern "C" {
#include "light/math/grid.h"
}

using cv::v_float32x4;

namespace
{

constexpr int kSamples = LP_CUBE_MOST;

/* (s, t) of the samples of a row. */
float place_of(int index)
{
	return (2.0F * static_cast<float>(index) + 1.0F) / static_cast<float>(kSamples) - 1.0F;
}

/* The plane of a face in the grid's frame: a sample looks along main + s across + t down. */
struct turned_face {
	float main[3], across[3], down[3];

	turned_face(int face, const struct lp_rotation &rotation)
	{
		float from[3][3];

		lp_cube_vector(face, 0.0F, 0.0F, from[0]);
		lp_cube_vector(face, 1.0F, 0.0F, from[1]);
		lp_cube_vector(face, 0.0F, 1.0F, from[2]);
		for (int a = 0; a < 3; a++) {
			main[a] = across[a] = down[a] = 0.0F;
			for (int b = 0; b < 3; b++) {
				const auto m = static_cast<float>(rotation.m[a][b]);

				main[a] += m * from[0][b];
				across[a] += m * (from[1][b] - from[0][b]);
				down[a] += m * (from[2][b] - from[0][b]);
			}
		}
	}

	v_float32x4 at(int a, const v_float32x4 &s, float t) const
	{
		return cv::v_fma(cv::v_setall_f32(across[a]), s,
				 cv::v_setall_f32(main[a] + t * down[a]));
	}
};

/* Bilinear; columns go round, rows end at the poles. */
v_float32x4 radiance_at(const struct lp_grid *grid, const float (*cells)[4], float column,
			float row)
{
	const int width = grid->width;
	const int left = static_cast<int>(column + 1.0F) - 1; /* column is above -1 */
	const float across = column - static_cast<float>(left);
	const float y = std::min(std::max(row, 0.0F), static_cast<float>(grid->height - 1));
	const int top = std::min(static_cast<int>(y), grid->height - 2);
	const float down = y - static_cast<float>(top);
	const int l = left < 0 ? left + width : left >= width ? left - width : left;
	const int r = l + 1 == width ? 0 : l + 1;
	const float(*const upper)[4] = cells + static_cast<ptrdiff_t>(top) * width;
	const float(*const lower)[4] = upper + width;
	const v_float32x4 a = cv::v_setall_f32(across), d = cv::v_setall_f32(down);
	const v_float32x4 u =
		cv::v_fma(cv::v_load(upper[r]) - cv::v_load(upper[l]), a, cv::v_load(upper[l]));
	const v_float32x4 v =
		cv::v_fma(cv::v_load(lower[r]) - cv::v_load(lower[l]), a, cv::v_load(lower[l]));

	return cv::v_fma(v - u, d, u);
}

/* Solid angle of the samples of a row, up to a factor. */
struct row_weights {
	float sample[kSamples];

	explicit row_weights(float t)
	{
		for (int k = 0; k < kSamples; k++) {
			const float s = place_of(k), far2 = 1.0F + s * s + t * t;

			sample[k] = 1.0F / (far2 * std::sqrt(far2));
		}
	}
};

/* Add a row of samples to the row of texels that they lie in. */
void add_row(const struct lp_grid *grid, const float (*cells)[4], const turned_face &face, float t,
	     int samples_per_texel, const row_weights &weights, v_float32x4 *sum)
{
	float column[4], row[4];

	for (int k = 0; k < kSamples; k += 4) {
		const v_float32x4 s(place_of(k), place_of(k + 1), place_of(k + 2), place_of(k + 3));
		const lp::places at(face.at(0, s, t), face.at(1, s, t), face.at(2, s, t),
				    grid->width, grid->height);

		cv::v_store(column, at.column);
		cv::v_store(row, at.row);
		for (int i = 0; i < 4; i++) {
			v_float32x4 &texel = sum[(k + i) / samples_per_texel];

			texel = cv::v_fma(cv::v_setall_f32(weights.sample[k + i]),
					  radiance_at(grid, cells, column[i], row[i]), texel);
		}
	}
}

} /* namespace */

extern "C" void lp_cube_sample(const struct lp_grid *grid, const float (*cells)[4],
			       const struct lp_rotation *rotation, int size, float *const rgb[3])
{
	const int step = kSamples / size;
	v_float32x4 sum[6][kSamples];
	float weight[kSamples], colour[4];

	for (int row = 0; row < size; row++) {
		std::fill(sum[0], sum[0] + 6 * kSamples, cv::v_setzero_f32()); /* {} would not */
		std::fill(weight, weight + size, 0.0F);
		for (int k = 0; k < step; k++) {
			const float t = place_of(row * step + k);
			const row_weights weights(t);

			for (int i = 0; i < kSamples; i++)
				weight[i / step] += weights.sample[i];
			for (int f = 0; f < 6; f++)
				add_row(grid, cells, turned_face(f, *rotation), t, step, weights,
					sum[f]);
		}
		for (int texel = 0; texel < 6 * size; texel++) {
			const int f = texel / size, column = texel % size;

			cv::v_store(colour, sum[f][column]);
			for (int c = 0; c < 3; c++)
				rgb[c][(f * size + row) * size + column] =
					colour[c] / weight[column];
		}
	}
}
