/* SPDX-License-Identifier: Apache-2.0 */
#include "vision/alignment.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <memory>
#include <new>
#include <vector>

#include "include/luminance.h"
#include "include/panorama.h"
#include "vision/alignment_level.hpp"
#include "vision/radiance_map.h"
#include "vision/response.h"
#include "vision/sphere.hpp"

extern "C" {
#include "light/grid.h"
}

using cv::v_float32x4;
using lp::kDetail, lp::kEnough;
using lp::level, lp::picture, lp::samples;

namespace
{

/* Chosen by hand, on the scenes of docs/users/accuracy.md, "While the camera turns". */

constexpr int kWidth = 120; /* columns of the fine level, about */
/* After kDetail, what the residuals say, but no less than this. */
constexpr float kLeastDetail = 0.01F;
constexpr float kRobust = 0.15F; /* residuals of log luminance from here on count less */
constexpr float kFirstRobust = 0.5F;
constexpr double kCorrelated = 20.0; /* neighbours err alike: so many count as one */
constexpr int kIterations = 6;
constexpr double kConverged = 2e-4; /* rad */
/* Relative noise above which a pixel is not compared. */
constexpr float kMostNoise = 0.5F;
/* Beyond this uncertainty of the guess the coarse level comes first. */
constexpr double kFineOnly = 0.02;

/* ln x of positive numbers, to 1e-4: exponent, and a polynomial of the mantissa on 1..2. */
v_float32x4 logarithm(const v_float32x4 &x)
{
	const cv::v_int32x4 bits =
		cv::v_reinterpret_as_s32(cv::v_max(x, cv::v_setall_f32(1.2e-38F)));
	const cv::v_int32x4 exponent = (bits >> 23) - cv::v_setall_s32(127);
	const v_float32x4 m = cv::v_reinterpret_as_f32((bits & cv::v_setall_s32(0x007fffff)) |
						       cv::v_setall_s32(0x3f800000));
	v_float32x4 p = cv::v_setall_f32(-0.056570851F);

	p = cv::v_fma(p, m, cv::v_setall_f32(0.44717955F));
	p = cv::v_fma(p, m, cv::v_setall_f32(-1.4699568F));
	p = cv::v_fma(p, m, cv::v_setall_f32(2.8212026F));
	p = cv::v_fma(p, m, cv::v_setall_f32(-1.7417939F));
	return cv::v_fma(cv::v_cvt_f32(exponent), cv::v_setall_f32(0.69314718F), p);
}

/* Normal equations in the three components of a rotation vector and the offset. */
struct equations {
	double matrix[4][4], right[4];
	double agreeing, compared;
	double squares, weights; /* of what is left, each by its robust weight */
};

/* Value and weight of `known` at four places. */
void look(const level &l, const lp::places &at, float value[4], float weight[4])
{
	float column[4], row[4];

	cv::v_store(column, at.column);
	cv::v_store(row, at.row);
	for (int k = 0; k < 4; k++) {
		const float y = std::min(std::max(row[k], 0.0F), static_cast<float>(l.height - 1));
		const int y0 = std::min(static_cast<int>(y), l.height - 2);
		const float fy = y - static_cast<float>(y0);
		const float floor = std::floor(column[k]);
		const int x0 = static_cast<int>(floor) < 0 ? l.width - 1 : static_cast<int>(floor);
		const int x1 = x0 + 1 < l.width ? x0 + 1 : 0;
		const float fx = column[k] - floor;
		const int i[4] = {y0 * l.width + x0, y0 * l.width + x1, (y0 + 1) * l.width + x0,
				  (y0 + 1) * l.width + x1};
		const float share[4] = {(1.0F - fx) * (1.0F - fy), fx * (1.0F - fy),
					(1.0F - fx) * fy, fx * fy};
		float sum = 0.0F, all = 0.0F;

		for (int j = 0; j < 4; j++) {
			const float w = share[j] * l.known.weight[i[j]];

			sum += w * l.known.value[i[j]];
			all += w;
		}
		value[k] = all > 0.0F ? sum / all : 0.0F;
		weight[k] = all >= kEnough ? all : 0.0F;
	}
}

/* Residuals of the map over the picture at a rotation. */
void residuals(const level &l, const struct lp_rotation &rotation, std::vector<float> &residual,
	       std::vector<float> &weight)
{
	const samples &s = l.list;
	v_float32x4 m[3][3];

	for (int a = 0; a < 3; a++)
		for (int b = 0; b < 3; b++)
			m[a][b] = cv::v_setall_f32(static_cast<float>(rotation.m[a][b]));
	for (size_t k = 0; k < s.count; k += 4) {
		const v_float32x4 x = cv::v_load(&s.direction[0][k]);
		const v_float32x4 y = cv::v_load(&s.direction[1][k]);
		const v_float32x4 z = cv::v_load(&s.direction[2][k]);
		v_float32x4 to[3];
		float value[4], known[4];

		for (int a = 0; a < 3; a++)
			to[a] = cv::v_fma(m[a][0], x, cv::v_fma(m[a][1], y, m[a][2] * z));
		look(l, lp::places(to[0], to[1], to[2], l.width, l.height), value, known);
		cv::v_store(&residual[k], cv::v_load(value) - cv::v_load(&s.value[k]));
		cv::v_store(&weight[k], cv::v_load(known) * cv::v_load(&s.weight[k]));
	}
}

equations accumulate(const samples &s, const std::vector<float> &residual,
		     const std::vector<float> &weight, double offset, float robust)
{
	const v_float32x4 zero = cv::v_setzero_f32(), one = cv::v_setall_f32(1.0F);
	v_float32x4 product[15] = {}, agreeing = zero, compared = zero;
	v_float32x4 squares = zero, weights = zero;
	equations e = {};

	std::fill(product, product + 15, zero);
	for (size_t k = 0; k < s.count; k += 4) {
		const v_float32x4 j[4] = {cv::v_load(&s.slope[0][k]), cv::v_load(&s.slope[1][k]),
					  cv::v_load(&s.slope[2][k]), cv::v_load(&s.certainty[k])};
		const v_float32x4 r = j[3] * (cv::v_load(&residual[k]) -
					      cv::v_setall_f32(static_cast<float>(offset)));
		const v_float32x4 w0 = cv::v_load(&weight[k]);
		const v_float32x4 u = r * cv::v_setall_f32(1.0F / robust), v = one + u * u;
		const v_float32x4 w = w0 / (v * v);
		int n = 0;

		for (int a = 0; a < 4; a++)
			for (int b = a; b < 4; b++, n++)
				product[n] = cv::v_fma(w * j[a], j[b], product[n]);
		for (int a = 0; a < 4; a++, n++)
			product[n] = cv::v_fma(w * j[a], r, product[n]);
		compared = compared + w0;
		squares = cv::v_fma(w * r, r, squares);
		weights = weights + w;
		agreeing = agreeing +
			   cv::v_select(cv::v_abs(r) < cv::v_setall_f32(2.0F * kRobust), w0, zero);
	}
	int n = 0;

	for (int a = 0; a < 4; a++)
		for (int b = a; b < 4; b++, n++)
			e.matrix[a][b] = e.matrix[b][a] = cv::v_reduce_sum(product[n]);
	for (int a = 0; a < 4; a++, n++)
		e.right[a] = cv::v_reduce_sum(product[n]);
	e.agreeing = cv::v_reduce_sum(agreeing);
	e.compared = cv::v_reduce_sum(compared);
	e.squares = cv::v_reduce_sum(squares);
	e.weights = cv::v_reduce_sum(weights);
	return e;
}

/* A x = b by elimination; A is positive definite up to rounding. */
void solve(double a[4][4], double b[4], double x[4])
{
	for (int i = 0; i < 4; i++) {
		const double pivot = a[i][i] > 1e-12 ? a[i][i] : 1e-12;

		for (int j = i + 1; j < 4; j++) {
			const double factor = a[j][i] / pivot;

			for (int k = i; k < 4; k++)
				a[j][k] -= factor * a[i][k];
			b[j] -= factor * b[i];
		}
	}
	for (int i = 3; i >= 0; i--) {
		double sum = b[i];

		for (int k = i + 1; k < 4; k++)
			sum -= a[i][k] * x[k];
		x[i] = sum / (a[i][i] > 1e-12 ? a[i][i] : 1e-12);
	}
}

} /* namespace */

struct lp_alignment {
	const struct lp_grid *grid;
	int factor; /* grid cells in a row per pixel of the fine level */
	level fine, coarse;
	std::vector<float> residual, weight, sorted;

	void reduce(const float (*radiance)[4], const uint8_t *flags, const float *variance,
		    const struct lp_observation *noise, picture &to);
	void halve(const picture &from, picture &to);
	double median();
	void iterate(level &l, const struct lp_rotation &guess, const double prior[3][3],
		     struct lp_alignment_result &result);
};

/* Mean luminance of factor x factor cells, its logarithm, and 1 where it is known well enough. */
void lp_alignment::reduce(const float (*radiance)[4], const uint8_t *flags, const float *variance,
			  const struct lp_observation *noise, picture &to)
{
	const int f = factor, width = grid->width;
	const float share = 1.0F / static_cast<float>(f * f);

	for (int y = 0; y < fine.height; y++)
		for (int x = 0; x < fine.width; x++) {
			float sum = 0.0F, uncertain = 0.0F;
			uint8_t marks = 0;

			for (int v = 0; v < f; v++)
				for (int u = 0; u < f; u++) {
					const int cell = (y * f + v) * width + x * f + u;

					sum += radiance[cell][LP_LUMINANCE];
					marks |= flags[cell];
					if (variance)
						uncertain += variance[cell];
				}
			const int at = y * fine.width + x;
			const float mean = sum * share;
			float known2 = uncertain * share;

			if (noise && noise->coded)
				known2 = noise->scale * noise->scale /
					 lp_response_weight(noise->response, mean / noise->scale);
			to.value[at] = mean;
			to.weight[at] =
				!marks && mean > 0.0F &&
						known2 < kMostNoise * kMostNoise * mean * mean
					? 1.0F
					: 0.0F;
		}
	for (int i = 0; i < fine.width * fine.height; i += 4)
		cv::v_store(&to.value[i], logarithm(cv::v_load(&to.value[i])));
}

void lp_alignment::halve(const picture &from, picture &to)
{
	for (int y = 0; y < coarse.height; y++)
		for (int x = 0; x < coarse.width; x++) {
			float sum = 0.0F, all = 0.0F;

			for (int k = 0; k < 4; k++) {
				const int at = (2 * y + k / 2) * fine.width + 2 * x + k % 2;

				sum += from.weight[at] * from.value[at];
				all += from.weight[at];
			}
			to.value[y * coarse.width + x] = all > 0.0F ? sum / all : 0.0F;
			to.weight[y * coarse.width + x] = 0.25F * all;
		}
}

/* Of the residuals. */
double lp_alignment::median()
{
	size_t count = 0;

	for (size_t k = 0; k < residual.size() - 4; k++)
		if (weight[k] > 0.0F)
			sorted[count++] = residual[k];
	if (!count)
		return 0.0;
	std::nth_element(sorted.begin(), sorted.begin() + static_cast<long>(count / 2),
			 sorted.begin() + static_cast<long>(count));
	return sorted[count / 2];
}

void lp_alignment::iterate(level &l, const struct lp_rotation &guess, const double prior[3][3],
			   struct lp_alignment_result &result)
{
	double detail2 = kDetail * kDetail;
	float robust = kFirstRobust;
	double offset = 0.0;

	std::fill(weight.begin(), weight.end(), 0.0F);
	for (int iteration = 0; iteration < kIterations; iteration++) {
		const struct lp_rotation turned = lp_rotation_of_vector(result.turn);
		const struct lp_rotation rotation = lp_rotation_product(&guess, &turned);
		double step[4] = {};

		residuals(l, rotation, residual, weight);
		if (iteration == 0)
			offset = median();
		equations e = accumulate(l.list, residual, weight, offset, robust);

		if (iteration && e.weights > 0.0)
			detail2 = std::max(static_cast<double>(kLeastDetail * kLeastDetail),
					   e.squares / e.weights);
		const double scale = 1.0 / (kCorrelated * detail2);

		for (int a = 0; a < 4; a++) {
			e.right[a] *= scale;
			for (int b = 0; b < 4; b++)
				e.matrix[a][b] *= scale;
		}
		for (int a = 0; a < 3; a++) /* what the offset explains is no information */
			for (int b = 0; b < 3; b++)
				result.information[a][b] =
					e.matrix[a][b] -
					(e.matrix[3][3] > 0.0
						 ? e.matrix[a][3] * e.matrix[b][3] / e.matrix[3][3]
						 : 0.0);
		result.agreement =
			static_cast<float>(e.compared > 0.0 ? e.agreeing / e.compared : 0.0);
		result.compared = static_cast<float>(e.compared / l.all());
		result.log_gain = -offset;
		for (int a = 0; a < 3; a++)
			for (int b = 0; b < 3; b++) {
				e.matrix[a][b] += prior[a][b];
				e.right[a] += prior[a][b] * result.turn[b];
			}
		solve(e.matrix, e.right, step);
		for (int a = 0; a < 3; a++)
			result.turn[a] -= step[a];
		offset += step[3];
		robust = kRobust;
		if (iteration && std::hypot(step[0], step[1], step[2]) < kConverged)
			break;
	}
}

extern "C" int lp_alignment_create(const struct lp_grid *grid, struct lp_alignment **alignment)
try {
	auto a = std::make_unique<struct lp_alignment>();
	int factor = 1;

	while (grid->width / (2 * factor) >= kWidth && grid->height % (4 * factor) == 0)
		factor *= 2;
	a->grid = grid;
	a->factor = factor;
	a->fine.create(grid->width / factor, grid->height / factor);
	a->coarse.create(a->fine.width / 2, a->fine.height / 2);
	a->residual = a->weight = a->sorted = a->fine.list.value;
	*alignment = a.release();
	return 0;
} catch (const std::bad_alloc &) {
	return -ENOMEM;
}

extern "C" void lp_alignment_destroy(struct lp_alignment *alignment)
{
	delete alignment;
}

extern "C" void lp_alignment_load(struct lp_alignment *alignment, const struct lp_radiance_map *map,
				  const struct lp_observation *picture)
{
	struct lp_alignment &a = *alignment;

	a.reduce(map->radiance, map->flags, map->variance, nullptr, a.fine.known);
	a.reduce(picture->radiance, picture->flags, nullptr, picture, a.fine.seen);
	a.halve(a.fine.known, a.coarse.known);
	a.halve(a.fine.seen, a.coarse.seen);
	for (level *l : {&a.fine, &a.coarse}) {
		l->smooth(l->seen);
		l->smooth(l->known);
		l->collect();
	}
}

extern "C" struct lp_alignment_result lp_alignment_solve(struct lp_alignment *alignment,
							 const struct lp_rotation *guess,
							 const double prior[3][3],
							 double prior_sigma_rad)
{
	struct lp_alignment_result result = {};

	if (prior_sigma_rad > kFineOnly)
		alignment->iterate(alignment->coarse, *guess, prior, result);
	alignment->iterate(alignment->fine, *guess, prior, result);
	return result;
}
