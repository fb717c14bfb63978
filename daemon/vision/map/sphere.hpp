/* SPDX-License-Identifier: Apache-2.0 */
/* Four directions at a time to places on an equirectangular grid. */
#ifndef LP_VISION_MAP_SPHERE_HPP
#define LP_VISION_MAP_SPHERE_HPP

#include <cmath>

#include "vision/picture/simd.hpp"

extern "C" {
#include "light/math/rotation.h"
}

namespace lp
{

/* atan2(y, x) of y >= 0, to 2e-5 rad: a polynomial on 0..1 (Abramowitz & Stegun 4.4.49), and its
 * symmetries. 0 for (0, 0). */
inline cv::v_float32x4 upper_arc_tangent(const cv::v_float32x4 &y, const cv::v_float32x4 &x)
{
	const cv::v_float32x4 zero = cv::v_setzero_f32(), ax = cv::v_abs(x);
	const cv::v_float32x4 most = cv::v_max(cv::v_max(ax, y), cv::v_setall_f32(1e-30F));
	const cv::v_float32x4 t = cv::v_min(ax, y) / most, s = t * t;
	cv::v_float32x4 a = cv::v_setall_f32(0.0208351F);

	a = cv::v_fma(a, s, cv::v_setall_f32(-0.0851330F));
	a = cv::v_fma(a, s, cv::v_setall_f32(0.1801410F));
	a = cv::v_fma(a, s, cv::v_setall_f32(-0.3302995F));
	a = cv::v_fma(a, s, cv::v_setall_f32(0.9998660F)) * t;
	a = cv::v_select(y > ax, cv::v_setall_f32(static_cast<float>(M_PI_2)) - a, a);
	return cv::v_select(x < zero, cv::v_setall_f32(static_cast<float>(M_PI)) - a, a);
}

/* The same for any y. */
inline cv::v_float32x4 arc_tangent(const cv::v_float32x4 &y, const cv::v_float32x4 &x)
{
	const cv::v_float32x4 zero = cv::v_setzero_f32(), a = upper_arc_tangent(cv::v_abs(y), x);

	return cv::v_select(y < zero, zero - a, a);
}

/* A row of directions (sin t sin l, cos t, -sin t cos l), turned: linear in sin l and cos l. */
struct turned_row {
	float constant[3], sine[3], cosine[3];

	turned_row(const struct lp_rotation &rotation, float row_sin, float row_cos)
	{
		for (int a = 0; a < 3; a++) {
			constant[a] = static_cast<float>(rotation.m[a][1]) * row_cos;
			sine[a] = static_cast<float>(rotation.m[a][0]) * row_sin;
			cosine[a] = -static_cast<float>(rotation.m[a][2]) * row_sin;
		}
	}

	cv::v_float32x4 at(int a, const cv::v_float32x4 &sin, const cv::v_float32x4 &cos) const
	{
		return cv::v_fma(cv::v_setall_f32(sine[a]), sin,
				 cv::v_fma(cv::v_setall_f32(cosine[a]), cos,
					   cv::v_setall_f32(constant[a])));
	}
};

/* Where four unit vectors lie on a grid of width x height, in cells: 0 is the centre of the first.
 * column: -1/2 .. width - 1/2; row: -1/2 .. height - 1/2. */
struct places {
	cv::v_float32x4 column, row;

	places(const cv::v_float32x4 &x, const cv::v_float32x4 &y, const cv::v_float32x4 &z,
	       int width, int height)
	{
		const cv::v_float32x4 zero = cv::v_setzero_f32(), half = cv::v_setall_f32(0.5F);
		const cv::v_float32x4 level = cv::v_sqrt(cv::v_fma(x, x, z * z));
		const float per_rad = static_cast<float>(width / (2.0 * M_PI));
		const float rows_per_rad = static_cast<float>(height / M_PI);

		column = cv::v_fma(arc_tangent(x, zero - z), cv::v_setall_f32(per_rad),
				   cv::v_setall_f32(0.5F * static_cast<float>(width) - 0.5F));
		row = cv::v_fma(upper_arc_tangent(level, y), cv::v_setall_f32(rows_per_rad),
				zero - half);
	}
};

} /* namespace lp */

#endif
