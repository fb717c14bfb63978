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

/* Cosines are even and sines odd: columns c and kWidth - c are taken together. */
constexpr int kHalf = kWidth / 2;

/* All orders of a row. */
void transform(struct lp_spread *s, const float (*row)[4], int r)
{
	float even[kHalf + 1][4], odd[kHalf + 1][4];

	for (int c = 0; c <= kHalf; c++) {
		const bool alone = c == 0 || c == kHalf;
		const cv::v_float32x4 one = cv::v_load(row[c]);
		const cv::v_float32x4 other =
			alone ? cv::v_setzero_f32() : cv::v_load(row[kWidth - c]);

		cv::v_store(even[c], one + other);
		cv::v_store(odd[c], one - other);
	}
	for (int m = 0; m < kOrders; m++) {
		cv::v_float32x4 cosine = cv::v_setzero_f32(), sine = cv::v_setzero_f32();

		for (int c = 0, k = 0; c <= kHalf; c++) {
			cosine = cv::v_fma(cv::v_load(even[c]), cv::v_setall_f32(s->cosine[k]),
					   cosine);
			sine = cv::v_fma(cv::v_load(odd[c]), cv::v_setall_f32(s->sine[k]), sine);
			k += k + m < kWidth ? m : m - kWidth;
		}
		cv::v_store(s->from[m][r].cosine, cosine);
		cv::v_store(s->from[m][r].sine, sine);
	}
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

/* A row of all its orders. */
void back(const struct lp_spread *s, int r, float (*row)[4])
{
	for (int c = 0; c <= kHalf; c++) {
		cv::v_float32x4 even = cv::v_setzero_f32(), odd = cv::v_setzero_f32();

		for (int m = 0, k = 0; m < kOrders; m++) {
			const wave &one = s->to[m][r];

			even = cv::v_fma(cv::v_load(one.cosine), cv::v_setall_f32(s->cosine[k]),
					 even);
			odd = cv::v_fma(cv::v_load(one.sine), cv::v_setall_f32(s->sine[k]), odd);
			k += k + c < kWidth ? c : c - kWidth;
		}
		cv::v_store(row[(kWidth - c) % kWidth], even - odd);
		cv::v_store(row[c], even + odd);
	}
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
	for (int r = 0; r < kHeight; r++)
		transform(spread, from + r * kWidth, r);
	for (int m = 0; m < kOrders; m++)
		for (int r = 0; r < kHeight; r++)
			mix(spread, m, r, spread->to[m][r]);
	for (int r = 0; r < kHeight; r++)
		back(spread, r, to + r * kWidth);
}
