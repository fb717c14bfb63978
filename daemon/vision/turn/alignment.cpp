/* SPDX-License-Identifier: Apache-2.0 */
#include "vision/turn/alignment.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <memory>
#include <new>
#include <vector>

#include "include/panorama.h"
#include "vision/camera/response.h"
#include "vision/map/radiance_map.h"
#include "vision/map/sphere.hpp"
#include "vision/turn/alignment_level.hpp"

extern "C" {
#include "light/math/grid.h"
#include "light/turn/shear.h"
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
constexpr size_t kMedianStep = 4;   /* of all residuals, so many tell where to begin */
constexpr double kConverged = 2e-4; /* rad */
/* Relative noise above which a pixel is not compared. */
constexpr float kMostNoise = 0.5F;
/* More than any variance, and small enough that some may be added up. */
constexpr float kUnknown = LP_VARIANCE_UNKNOWN;
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
		v_float32x4 to[3], value, known;

		for (int a = 0; a < 3; a++)
			to[a] = cv::v_fma(m[a][0], x, cv::v_fma(m[a][1], y, m[a][2] * z));
		l.table.at(lp::places(to[0], to[1], to[2], l.width, l.height), value, known);
		cv::v_store(&residual[k], value - cv::v_load(&s.value[k]));
		cv::v_store(&weight[k], known * cv::v_load(&s.weight[k]));
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
	bool has_coarse; /* of what has been loaded last */
	struct lp_shear shear;
	std::vector<float> residual, weight, sorted;
	std::vector<float> row_light, row_variance; /* workspace of reduce() */

	void add_rows(const float (*radiance)[4], const uint8_t *flags, const float *variance);
	void add_columns(std::vector<float> &row) const;
	void reduce(const float (*radiance)[4], const uint8_t *flags, const float *variance,
		    const struct lp_observation *noise, picture &to);
	void halve(const picture &from, picture &to);
	double median();
	void iterate(level &l, const struct lp_rotation &guess, const double prior[3][3],
		     struct lp_alignment_result &result);
};

/* Sums of `factor` rows of cells, column by column: luminance, and variance, which is unknown of
 * marked cells. */
void lp_alignment::add_rows(const float (*radiance)[4], const uint8_t *flags, const float *variance)
{
	const v_float32x4 zero = cv::v_setzero_f32(), unknown = cv::v_setall_f32(kUnknown);
	const int width = grid->width;
	float *row[2] = {row_light.data(), row_variance.data()};

	for (int x = 0; x < width; x += 4) {
		v_float32x4 light = zero, uncertain = zero;

		for (int at = x; at < factor * width; at += width) {
			const cv::v_int32x4 marks =
				cv::v_reinterpret_as_s32(cv::v_load_expand_q(flags + at));
			const v_float32x4 marked =
				cv::v_reinterpret_as_f32(marks != cv::v_setzero_s32());
			v_float32x4 r, g, b, luminance;

			cv::v_load_deinterleave(radiance[at], r, g, b, luminance);
			light = light + luminance;
			uncertain = uncertain + (marked & unknown);
			if (variance)
				uncertain = uncertain + cv::v_load(variance + at);
		}
		cv::v_store(row[0] + x, light);
		cv::v_store(row[1] + x, uncertain);
	}
}

/* Sums of `factor`, a power of two, values next to each other, in place. */
void lp_alignment::add_columns(std::vector<float> &row) const
{
	for (int width = grid->width; width > fine.width; width /= 2)
		for (int x = 0; x < width / 2; x += 4) {
			v_float32x4 even, odd;

			cv::v_load_deinterleave(&row[2 * x], even, odd);
			cv::v_store(&row[x], even + odd);
		}
}

/* Variance of four means of luminance in a picture of codes. */
static v_float32x4 code_noise(const v_float32x4 &mean, const struct lp_observation &noise)
{
	const v_float32x4 linear = mean * cv::v_setall_f32(1.0F / noise.scale);
	const v_float32x4 root = cv::v_sqrt(
		cv::v_min(cv::v_max(linear, cv::v_setzero_f32()), cv::v_setall_f32(1.0F)));
	const cv::v_int32x4 code = cv::v_trunc(root * cv::v_setall_f32(255.0F));

	return cv::v_setall_f32(noise.scale * noise.scale) /
	       cv::v_lut(noise.response->weight, code);
}

/* Logarithm of the mean luminance of factor x factor cells, and weight 1 where it is known well
 * enough. variance: of the cells; noise: of codes; NULL: none. */
void lp_alignment::reduce(const float (*radiance)[4], const uint8_t *flags, const float *variance,
			  const struct lp_observation *noise, picture &to)
{
	const v_float32x4 zero = cv::v_setzero_f32(), one = cv::v_setall_f32(1.0F);
	const v_float32x4 most = cv::v_setall_f32(kMostNoise * kMostNoise);
	const v_float32x4 share = cv::v_setall_f32(1.0F / static_cast<float>(factor * factor));

	for (int y = 0; y < fine.height; y++) {
		const size_t first = static_cast<size_t>(y) * factor * grid->width;

		add_rows(radiance + first, flags + first, variance ? variance + first : nullptr);
		add_columns(row_light);
		add_columns(row_variance);
		for (int x = 0; x < fine.width; x += 4) { /* the next row is written later */
			const v_float32x4 mean = share * cv::v_load(&row_light[x]);
			v_float32x4 noise2 = share * cv::v_load(&row_variance[x]);

			if (noise && noise->coded)
				noise2 = noise2 + code_noise(mean, *noise);
			cv::v_store(&to.value[y * fine.width + x], logarithm(mean));
			cv::v_store(&to.weight[y * fine.width + x],
				    one & (mean > zero) & (noise2 < most * mean * mean));
		}
	}
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

	for (size_t k = 0; k < residual.size() - 4; k += kMedianStep)
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
	double detail2 = kDetail * kDetail; /* before anything has been compared */
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

		if (e.weights > 0.0)
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
	a->row_light.resize(grid->width + 8); /* vectors reach beyond the last */
	a->row_variance.resize(grid->width + 8);
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
				  const struct lp_observation *picture,
				  const struct lp_shear *shear)
{
	struct lp_alignment &a = *alignment;

	a.reduce(map->radiance, map->flags, map->variance, nullptr, a.fine.known_raw);
	a.reduce(picture->radiance, picture->flags, nullptr, picture, a.fine.seen_raw);
	a.shear = *shear;
	a.fine.prepare(a.shear);
	a.has_coarse = false;
}

extern "C" struct lp_alignment_result lp_alignment_solve(struct lp_alignment *alignment,
							 const struct lp_rotation *guess,
							 const double prior[3][3],
							 double prior_sigma_rad)
{
	struct lp_alignment_result result = {};

	struct lp_alignment &a = *alignment;

	if (prior_sigma_rad > kFineOnly) {
		if (!a.has_coarse) {
			a.halve(a.fine.known_raw, a.coarse.known_raw);
			a.halve(a.fine.seen_raw, a.coarse.seen_raw);
			a.coarse.prepare(a.shear);
			a.has_coarse = true;
		}
		a.iterate(a.coarse, *guess, prior, result);
	}
	a.iterate(a.fine, *guess, prior, result);
	return result;
}
