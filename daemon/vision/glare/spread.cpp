/* SPDX-License-Identifier: Apache-2.0 */
#include "vision/glare/spread.h"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdlib>

#include "vision/picture/simd.hpp"

namespace
{

constexpr int kWidth = LP_VEIL_WIDTH, kHeight = LP_VEIL_HEIGHT;
constexpr int kOrders = kWidth / 2 + 1;

/* One order of one row. */
struct wave {
	float cosine[4], sine[4];
};

double kernel(double angle_rad, double width_rad)
{
	return std::pow(1.0 + angle_rad * angle_rad / (width_rad * width_rad), -1.5);
}

} /* namespace */

struct lp_spread {
	float cosine[kWidth], sine[kWidth]; /* of whole columns */
	/* Of each order, from one row to another; with the norm of the way back. */
	float gain[kOrders][kHeight][kHeight];
	wave from[kOrders][kHeight], to[kOrders][kHeight];
};

namespace
{

/* How much one row gives another in each order. */
void set_gain(struct lp_spread *s, int a, int b, double width_rad)
{
	const double theta_a = M_PI * (a + 0.5) / kHeight, theta_b = M_PI * (b + 0.5) / kHeight;
	double by_column[kWidth];

	for (int d = 0; d < kWidth; d++) {
		const double cosine =
			std::cos(theta_a) * std::cos(theta_b) +
			std::sin(theta_a) * std::sin(theta_b) * std::cos(2.0 * M_PI * d / kWidth);

		by_column[d] = kernel(std::acos(std::max(-1.0, std::min(1.0, cosine))), width_rad);
	}
	for (int m = 0; m < kOrders; m++) {
		const double twice = m == 0 || 2 * m == kWidth ? 1.0 : 2.0;
		double sum = 0.0;

		for (int d = 0; d < kWidth; d++)
			sum += by_column[d] * std::cos(2.0 * M_PI * m * d / kWidth);
		s->gain[m][a][b] = static_cast<float>(twice * sum / kWidth);
	}
}

void transform(const struct lp_spread *s, const float (*row)[4], int m, wave &to)
{
	cv::v_float32x4 cosine = cv::v_setzero_f32(), sine = cv::v_setzero_f32();

	for (int c = 0, k = 0; c < kWidth; c++, k = (k + m) % kWidth) {
		const cv::v_float32x4 light = cv::v_load(row[c]);

		cosine = cv::v_fma(light, cv::v_setall_f32(s->cosine[k]), cosine);
		sine = cv::v_fma(light, cv::v_setall_f32(s->sine[k]), sine);
	}
	cv::v_store(to.cosine, cosine);
	cv::v_store(to.sine, sine);
}

void mix(const struct lp_spread *s, int m, int row, wave &to)
{
	cv::v_float32x4 cosine = cv::v_setzero_f32(), sine = cv::v_setzero_f32();

	for (int r = 0; r < kHeight; r++) {
		const cv::v_float32x4 gain = cv::v_setall_f32(s->gain[m][row][r]);

		cosine = cv::v_fma(cv::v_load(s->from[m][r].cosine), gain, cosine);
		sine = cv::v_fma(cv::v_load(s->from[m][r].sine), gain, sine);
	}
	cv::v_store(to.cosine, cosine);
	cv::v_store(to.sine, sine);
}

cv::v_float32x4 back(const struct lp_spread *s, int row, int column)
{
	cv::v_float32x4 light = cv::v_setzero_f32();

	for (int m = 0, k = 0; m < kOrders; m++, k = (k + column) % kWidth) {
		const wave &one = s->to[m][row];

		light = cv::v_fma(cv::v_load(one.cosine), cv::v_setall_f32(s->cosine[k]), light);
		light = cv::v_fma(cv::v_load(one.sine), cv::v_setall_f32(s->sine[k]), light);
	}
	return light;
}

} /* namespace */

extern "C" int lp_spread_create(float width_deg, struct lp_spread **spread)
{
	auto *s = static_cast<struct lp_spread *>(std::calloc(1, sizeof(struct lp_spread)));

	if (!s)
		return -ENOMEM;
	for (int c = 0; c < kWidth; c++) {
		s->cosine[c] = static_cast<float>(std::cos(2.0 * M_PI * c / kWidth));
		s->sine[c] = static_cast<float>(std::sin(2.0 * M_PI * c / kWidth));
	}
	for (int a = 0; a < kHeight; a++)
		for (int b = 0; b < kHeight; b++)
			set_gain(s, a, b, static_cast<double>(width_deg) * M_PI / 180.0);
	*spread = s;
	return 0;
}

extern "C" void lp_spread_destroy(struct lp_spread *spread)
{
	std::free(spread);
}

extern "C" void lp_spread_apply(struct lp_spread *spread, const float (*from)[4], float (*to)[4])
{
	for (int m = 0; m < kOrders; m++)
		for (int r = 0; r < kHeight; r++)
			transform(spread, from + r * kWidth, m, spread->from[m][r]);
	for (int m = 0; m < kOrders; m++)
		for (int r = 0; r < kHeight; r++)
			mix(spread, m, r, spread->to[m][r]);
	for (int r = 0; r < kHeight; r++)
		for (int c = 0; c < kWidth; c++)
			cv::v_store(to[r * kWidth + c], back(spread, r, c));
}
